"""Bounds of a scene or a simulator, with warnings.

In:   a scene or a simulator, a method and a box.
Out:  Bounds with warnings. `propagate` reduces the box (`reductions`), bounds, and checks: `doubts` has the warnings,
      and `check_runs` makes further runs for methods without an estimated error. `study` keeps what answers need for
      further runs.
"""

from symmb._doors import open_door

open_door(__name__)
