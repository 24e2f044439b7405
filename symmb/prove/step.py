"""The proof of a step: a bound of the distance of the true motion from the polynomials, in the coordinates of a frame.

The motion is x = u + B w. Here u and B are polynomials of time and parameters, and C is approximately the inverse of B:

    w' = B^-1 ((A B - B') w + (int A(u + s B w) - A(u) ds) B w - d),      d = u' - f(u),      A = df/dx at u.

In a stiff step, w' = L w + B^-1 ((A B - B' - B L) w + ...) with the rates L of decay.

Bounds of |C d|, |C (A B - B')|, |I - C B| and of the change of A over the candidate box W give a bound F(W). As long as
|w| <= W, |w| is at most F(W). If F(W) < W, w cannot leave the box during the step. The effect of d follows from
integrals of C d, which are often much smaller than C d because d changes its sign.

References
----------
Picard and Lindelof's theorem in the form of Nedialkov, Jackson and Corliss, Applied Mathematics and Computation 105
(1999), section 5. Lohner (1988), thesis, Karlsruhe, chapter 3, frames. Makino and Berz, International Journal of
Differential Equations and Applications 10 (2005), preconditioned Taylor models. Lin and Stadtherr, Applied Numerical
Mathematics 57 (2007), parameters as intervals. Neumaier, Reliable Computing 9 (2003).
"""

from dataclasses import dataclass

import numpy as np

from symmb._magnitudes import SMALL
from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove import discs
from symmb.prove.defects import defect_of_frame, defect_of_motion, defects_of_models, exact_defects, largest_defects
from symmb.prove.ellipses import MOST_PATCHES, Control, adapted
from symmb.prove.errors import ProofError
from symmb.prove.patches import largest_on
from symmb.prove.rounding import U, above
from symmb.prove.several_parameters import discs_on_motion, on_step
from symmb.prove.tape import Tape
from symmb.prove.time_step import TimeStep

MOST_CANDIDATES = 12
"""Largest number of candidates W until F(W) < W. W bounds w, or the time to a pass."""


@dataclass(frozen=True)
class Proof:
    """Bounds W (m,) of |w| during a step, and `end` (m,) at the end of the step."""

    W: Array
    end: Array


@np.errstate(all="ignore")
def prove(step: TimeStep, w0: Array, control: Control) -> Proof:
    """Bounds of |w| over a step. At the start, |w| is at most w0 (m,). ProofError if no W has F(W) < W.

    Bounds of C d are its largest value, its largest integral from the begin over h, and its mean, as (3, n).
    """
    defects, patches = exact_defects(step), control.choice.patches
    if defects is not None:
        defect, growth = defects
        # exact defects need no ellipses, but the room of the states needs them
        rho = [1.5] * len(step.degrees)
    elif step.problem.weights:
        defect, growth, rho = defects_of_models(step, w0, control)
    else:
        chosen = adapted(step, control)
        rho, patches = chosen.rho, chosen.choice.patches
        most, most_of_frame = largest_defects(step, rho, chosen.rates, chosen.slopes)
        defect = defect_of_motion(step, rho, most, w0, control)
        growth = defect_of_frame(step, rho, most_of_frame, w0 + step.h * defect[2])
    if step.decay is not None:  # integrals with weights of decay are not known
        defect = defect[[0, 0, 0]]
    generators, n = w0[: -step.problem.n], step.problem.n
    # a little more than the remainder without growth: |w| must stay strictly inside of W
    W = np.concatenate([generators, above(1.001 * w0[-n:] + 1.1 * step.after(np.zeros(n), step.solved(*defect[:2])))])
    change = _Curvature(step, rho, patches, SMALL * (growth @ W + defect[0]))
    for _ in range(MOST_CANDIDATES):
        e = above(step.B_largest @ W)
        quadratic = above(step.C_largest @ (change(e) @ e))
        others = growth @ W + quadratic
        rate, mean = (step.solved(above(others + defect[0]), above(others + own)) for own in defect[1:])
        # during the step, |w| is at most the sum of its begin and of the effect of the rate
        end = above(w0[-n:] + step.after(np.zeros(n), rate))
        if not np.isfinite(end).all():
            break
        if stays(end, W[-n:]):
            # the equations are used in all of W, so rows of loops must determine the velocities there
            if not is_regular(step, e, patches):
                raise ProofError(step.problem.why_singular)
            return Proof(W, np.concatenate([generators, step.after(w0[-n:], mean)]))
        W[-n:] = above(np.maximum(W[-n:], 1.01 * end))
    raise ProofError("small deviations from the computed motion grow too fast")


def is_regular(step: TimeStep, e: Array, patches: tuple[int, int]) -> bool:
    """Whether rows of loops determine the velocities in all states within e (n,) of the motion of a step."""
    tape = step.problem.regular_tape
    return tape is None or all(map(discs.is_regular, on_motion(step, tape, e, patches)))


def require_valid(step: TimeStep, e: Array) -> None:
    """ProofError unless the equations are proved to be those of the scene within e (n,) of the motion of a step."""
    tape, phase, shown = step.problem.valid_tape, step.problem.phase, [False]
    # numbers of patches of time and of each parameter
    for patches in (8, 1), (40, 1), (40, 8):
        if tape is None or all(shown):
            return
        if patches[0] * patches[1] ** step.problem.d <= MOST_PATCHES:
            shown = [discs.is_positive(a) for a in on_motion(step, tape, e, patches)]
    if all(shown):
        return
    if phase is None:
        raise ProofError("the sign of another switch may change at the same time, or the sign may change back")
    reason = "it may only touch 0, or change its sign only for a part of the box"
    raise ProofError(phase.sentence(shown.index(False), step.t0, reason))


def on_motion(step: TimeStep, tape: Tape, e: Array, patches: tuple[int, int]) -> list[discs.Disc]:
    """Discs of the first output vector of a tape, for all parameters and states within e (n,) of the motion."""
    return discs_on_motion(step, tape, e, patches)[0]


def stays(end: Array, W: Array) -> bool:
    """Whether |w| cannot reach W. As long as |w| <= W, |w| is at most `end`, and w is continuous."""
    return bool((end < W).all())


class _Curvature:
    """The change of the Jacobian between the motion u and a state u + e near it.

    Let |e| <= kappa r, and let the equations be analytic in all discs with the radii r. A(u + s e) is then analytic in
    s for |s| <= 1 / kappa. If A is in discs of radius R there, it changes by at most 2 R kappa s (Schwarz's lemma). Its
    mean over s in [0, 1] changes by at most R kappa.

    An effect of the change up to `harmless` (n,), in the coordinates of the frame [1/s], need not be reduced.
    """

    def __init__(self, step: TimeStep, rho: list[float], patches: tuple[int, int], harmless: Array) -> None:
        least = max(count for count in (1, 4, 40) if count ** (len(rho) - 1) <= 64)  # for each parameter, and for all
        self._step, self._patches, self._harmless = step, (patches[0], max(patches[1], least)), harmless
        own = ch.sums(step.x.c, step.x.c.ndim - 1)
        self._room = np.maximum(largest_on(rho, step.x.c) - own, 1e-9 * step.problem.scales)
        self._radius, self._change = np.zeros(0), np.zeros(0)

    def __call__(self, e: Array) -> Array:
        """Bounds (n, n) of the mean change of A between u and u + e, for all e with the moduli `e` (n,)."""
        if not self._radius.size or not (e <= self._radius).all():
            self._choose(e)
        kappa = above(float((e / self._radius).max()) * (1 + 4 * U))
        return above(self._change * kappa)

    def _choose(self, e: Array) -> None:
        """Choose radii around e. They are reduced until the change is harmless, or grows again."""
        largest = max(2.0, 0.5 / float((e / self._room).max()))
        least, self._radius = np.inf, np.zeros(0)
        # radii relative to the largest discs: they become smaller until the change grows again
        for factor in (1.0, 0.5, 0.2, 0.08, 0.03, 0.01):
            radius = above(e * max(2.0, factor * largest))
            change = self._changes(radius)
            kappa = float((e / radius).max())
            mean = float((change @ e).max() * kappa)
            if np.isfinite(least) and not mean < least:
                break
            if mean < least or not self._radius.size:
                self._radius, self._change, least = radius, change, mean
            if (self._step.C_largest @ (change @ e) * kappa <= self._harmless).all():
                break

    def _changes(self, radius: Array) -> Array:
        """Largest radii (n, n) of the discs of the Jacobian on all patches, for states within `radius` (n,)."""
        tape, n = self._step.problem.jacobian_tape, self._step.problem.n
        if self._step.problem.weights:
            entries = on_step(self._step, tape, radius)[1]
        else:
            entries = self._step.discs_of(tape, self._patches, radius)[1]
        return np.array([float(np.where(np.isnan(a.radius), np.inf, a.radius).max()) for a in entries]).reshape(n, n).T
