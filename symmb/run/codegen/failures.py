"""The reasons why samples fail."""

from enum import IntEnum

from symmb.run.schemes import MOST_STEPS


class FailureCode(IntEnum):
    """The number of a failure in the C code, which is an index of `REASONS`."""

    STEPS, OUTPUT, NEWTON, MANY, STICKS, IMMOVABLE, UNENDING, DEPENDENT, ENDLESS, OPEN = range(10)


REASONS = (
    "the step became too short, or a state became infinite or NaN",
    "an output is not finite",
    "Newton's method does not converge, even with the shortest step",
    f"{MOST_STEPS} steps are not enough",
    "the motion sticks to a switch of a force, because the force pushes it back from both sides",
    "Impact {} cannot rebound, because the constraints determine the rate of its gap",
    "the sequence of impacts of {} at one instant does not end",
    "the closed contacts {} depend on each other",
    "events of {} follow each other without end",
    "the constraints cannot be satisfied with the new parameters",
)
"""The text of each FailureCode. Names of contacts are put in the place of {}."""
