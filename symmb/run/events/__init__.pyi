"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .impulses import Event as Event, event_doubts as event_doubts, events_of as events_of

# `time_switches` is the function of `switches`, so this module follows.
from .time_switches import TimeSwitches as TimeSwitches
from .switches import (
    Break as Break,
    Kinks as Kinks,
    Pulses as Pulses,
    broken as broken,
    kinks as kinks,
    longest_step as longest_step,
    parameter_switches as parameter_switches,
    time_switches as time_switches,
)
