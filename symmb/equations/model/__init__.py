"""From a declaration to equations: System, Scene, and DAE, the compiled equations for solvers.

`validation` and `assembly` check declarations, and report all faults at once. `tolerance_list` and `iso_grades` read
tolerances for `Box`, and `choices` its finite sets and its constraints.
"""

from symmb._doors import open_door

open_door(__name__)
