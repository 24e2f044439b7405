"""Events of contacts and joints, and switches of time and of the state.

`time_switches` finds the times of switches before a run. `step_ends` in `integrate` passes these times to the
solvers, and `find_stop` in `codegen/c/switches.h` ends steps at these times.
"""

from symmb._doors import open_door

open_door(__name__)
