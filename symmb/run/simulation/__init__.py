"""Runs of scenes. `simulate` makes one run, and a `DAESimulator` runs samples of parameters.

`pilots` chooses the solver by short trial runs.
"""

from symmb._doors import open_door

open_door(__name__)
