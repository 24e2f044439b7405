"""Events of contacts and joints, and switches of time and of the state.

`time_switches` finds the times of switches before a run. `step_ends` in `integrate` passes these times to the
solvers, and `find_stop` in `codegen/c/switches.h` ends steps at these times.
"""

from symmb.run.events.impulses import Event, event_doubts, events_of
from symmb.run.events.switches import (
    Break,
    Kinks,
    Pulses,
    broken,
    kinks,
    longest_step,
    parameter_switches,
    time_switches,
)
from symmb.run.events.time_switches import TimeSwitches
