"""The control of step sizes of the pair of Dormand and Prince, order 8. The C code of `codegen` takes the steps.

References
----------
Hairer, Norsett, Wanner (1993), Solving Ordinary Differential Equations I, sections II.4 to II.6, code DOP853.
"""

from types import SimpleNamespace

STEP_CONTROL = SimpleNamespace(
    SAFETY=0.9,  # of the step that the error allows
    EXPONENT=1 / 8,  # of the error, for a method of order 8 whose error estimate is of order 7
    MEMORY=0.04,  # weight of the previous error, beta of DOP853, which damps oscillations of the step
    SHRINK_LEAST=0.2,  # smallest factor of a step that is rejected
    CHANGE_LEAST=0.333,
    CHANGE_MOST=6.0,  # bounds of the factor of a step that is accepted
    ERROR_LEAST=1e-4,  # smaller previous errors are replaced by this value
    MOST_MISSED=300.0,  # tolerances: smooth motions miss 5 to 30, up to 250 at rtol 1e-13. tests/benchmarks/lanes.py
)
"""The constants of the step control, as in the code DOP853."""
ROUNDED_STEP = 1e-6
"""Shortest step as a fraction of the time. In shorter steps, rounding of the end changes the length of the step."""
MOST_STEPS = 1_000_000
"""Maximum number of steps of a run. More steps take minutes in C, and hours in Python."""
