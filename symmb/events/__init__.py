"""Impacts and the states after them, and switches of time and state.

The solvers that use this are in `integrate`.
"""

from symmb.events.impulses import Event, ImpactLaws, event_doubts, events_of
from symmb.events.switches import Kinks, broken, kinks, longest_step, longest_steps, time_switches
from symmb.events.time_switches import TimeSwitches
