"""What is proved about switches of laws of time over a step."""

import numpy as np

from symmb._types import Array
from symmb.enclosures import discs
from symmb.enclosures.curves import TimeStep
from symmb.enclosures.ellipses import patches_on, reaches
from symmb.enclosures.errors import ProofError
from symmb.enclosures.patches import Patches
from symmb.enclosures.problem import Problem
from symmb.enclosures.rounding import above
from symmb.enclosures.schedule import Window
from symmb.enclosures.step import SINGULAR, Proof, is_regular
from symmb.enclosures.tape import Tape

_PATCHES = 8
"""Patches of time on which rates are bounded in a window."""
_TRIALS = 8
"""Candidates for how far states are off in a window."""


def holds(tape: Tape, problem: Problem, begin: float, end: float, least: float) -> bool:
    """Whether conditions (x, p, t) -> (m,) of parameters and time are above 0 from one time to another.

    Intervals of time are halved down to a length, or where they end at either time, to what rounding leaves.
    """
    pending, smallest = [(begin, end)], 1e-6 * least
    while pending:
        a, b = pending.pop()
        if all(map(discs.is_positive, tape.run(discs.OPERATIONS, discs.disc, _on_box(problem, a, b))[0])):
            continue
        if b - a < (smallest if a == begin or b == end else least):
            return False
        middle = 0.5 * (a + b)
        pending += [(a, middle), (middle, b)]
    return True


def _on_box(problem: Problem, begin: float, end: float) -> list[list[discs.Disc]]:
    """States of zeros, and parameters and time over the whole box, for what does not depend on states."""
    d = problem.d
    patches = Patches([1.0] * (d + 1), [1] * (d + 1), [1] * (d + 1))
    middle = 0.5 * (begin + end)
    time = patches.linear(middle, np.nextafter(max(end - middle, middle - begin), np.inf), 0)
    errors = np.broadcast_to(problem.errors, problem.middle.shape)
    p = [
        discs.disc(float(m)) if j < 0 else patches.linear(m, r, 1 + j, error)
        for m, r, j, error in zip(problem.middle, problem.radius, problem.variables, errors, strict=True)
    ]
    return [[discs.disc(0.0)] * problem.n, p, [time]]


def off_while_switching(step: TimeStep, proof: Proof, window: Window | None) -> Array:
    """Bounds (n,) of how far states are off the motion of the old equations at the end of a window, which is a step.

    Both move by at most the length of the window times the rates, of which one of the window's is the true one.

    Raises
    ------
    ProofError         if the rates cannot be bounded, or another law may switch
    """
    assert window is not None
    problem, rho = step.problem, [1.0] * (step.problem.d + 1)
    if not holds(Tape(window.steady), problem, step.t0, step.t0 + step.h, 0.1 * step.h):
        raise ProofError(problem.why_switch)
    tapes = [Tape(rates) for rates in window.rates]
    if any(tape.unknown(discs.OPERATIONS) for tape in tapes):  # the next phase is one of them
        raise ProofError(problem.why_switch)
    own = above(step.B_largest @ proof.W)
    beside = np.zeros(problem.n)
    for _ in range(_TRIALS):
        states = step.on_patches(patches_on(step, rho, (_PATCHES, 1)), above(own + beside))
        most = np.max([reaches(tape.run(discs.OPERATIONS, discs.disc, states)[0]) for tape in tapes], axis=0)
        moved = above(2.0 * step.h * most)
        if not np.isfinite(moved).all():
            break
        if (moved < beside).all():
            if not is_regular(step, above(own + beside), (_PATCHES, 1)):
                raise ProofError(SINGULAR)
            return moved
        beside = above(np.maximum(2.0 * moved, beside))
    raise ProofError(problem.why_switch)
