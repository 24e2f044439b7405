"""Impacts, and switches of time and state: detection, location and the states after them.

The solvers that use this are in `integrate`.
"""

from symmb.events.impulses import Event, ImpactLaws, PostImpactState, evaluate_padded, event_doubts
from symmb.events.location import Location, Steps
from symmb.events.switches import Kinks, Pulses, broken, kinks, longest_step, time_switches
from symmb.events.time_switches import TimeSwitches
