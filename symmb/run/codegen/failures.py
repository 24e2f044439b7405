"""Why samples fail."""

from enum import IntEnum

from symmb.run.schemes import MOST_STEPS


class FailureCode(IntEnum):
    """The reason of a failed sample in the C."""

    STEPS = 0
    OUTPUT = 1
    NEWTON = 2
    MANY = 3
    STICKS = 4
    IMMOVABLE = 5
    UNENDING = 6
    DEPENDENT = 7
    ENDLESS = 8
    OPEN = 9


REASONS = (
    "the step became too short, or the state infinite or NaN",
    "an output is not finite",
    "Newton's method does not converge, however short the step",
    f"{MOST_STEPS} steps are not enough",
    "the motion sticks to a switch of a force, which turns it back from both sides",
    "Impact {} cannot rebound: its gap closes as the constraints have it",
    "impacts of {} at one instant do not end",
    "the contacts {} that have closed depend on each other",
    "events of {} follow each other without end",
    "the constraints cannot be met with the new parameters",
)
"""The text of each FailureCode; names of contacts are put in."""
