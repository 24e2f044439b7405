"""Events of contacts and joints, and switches of time and of the state.

The solvers that use these are in `integrate`.
"""

from symmb.run.events.impulses import Event, event_doubts, events_of
from symmb.run.events.switches import Break, Kinks, Pulses, broken, kinks, longest_step, time_switches
from symmb.run.events.time_switches import TimeSwitches
