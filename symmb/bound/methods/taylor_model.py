"""Proved bounds: Taylor models of the motion, as polynomials with a remainder."""

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from symmb._errors import PropagationError, SymmbWarning
from symmb._limits import require_runs
from symmb._options import constructor_text, require_whole
from symmb._types import Array, Mask
from symmb.bound.answers import Bounds, Kind
from symmb.bound.methods.method import Method
from symmb.bound.responses import RunsOverBox
from symmb.prove import EXTRA_NODES, NO_START, SINGULAR, Enclosure, enclose, problem_of

_PARTS_OF_PROGRESS = 1000
"""Number of parts of the horizon at which progress is reported."""


@dataclass(frozen=True)
class TaylorModel(Method):
    """Proved bounds of the motions of mechanisms, as polynomials of the parameters with a remainder.

    All solutions for all parameters in the box are between lower and upper at every output time. The proof is for the
    expression graph of the model in exact arithmetic.

    Over each step, the motion x(xi, t) = u(xi, t) + B(xi, t) w has two parts. u is a polynomial of time and of the
    parameters in Chebyshev form. The remainder has the coordinates w in a frame B. The frame follows the variational
    equation, and is also a polynomial of the parameters. The polynomials need not be exact. The defect u' - f(u) is an
    analytic function. The method interpolates the defect at Chebyshev nodes, and bounds rounding errors. The largest
    value of the defect on ellipses around the box bounds the interpolation error. If the equations are polynomials,
    enough nodes give no error. With three or more parameters, the polynomials have a total degree. The defect is then a
    Taylor model in the parameters at nodes of time. The last step proves that w cannot leave a box. Ranges of the
    outputs follow by Bernstein coefficients and halving.

    The method takes chains, trees and closed loops, first-order states, and scenes without bodies that have expressions
    as outputs. In loops, the states are all coordinates and the independent velocities. The independent velocities give
    the dependent velocities. If other independent velocities suit the nominal run better, the method changes to these
    velocities. Frequencies and damping of a `ModalSimulator` are proved if no two frequencies can cross in the box. At
    a proved value of `critical`, one eigenvalue is imaginary or 0. Checks at a few points, without a proof, show that
    no other eigenvalue reaches the imaginary axis before. Proofs of frequencies and critical values need an
    equilibrium, or a steady motion in coordinates that do not rotate. Reactions and accelerations can be outputs.
    Multipliers of redundant constraints are those of smallest norm. Steps end at the instants of sampled values. A
    proof continues through a kink or jump of a force if all motions pass it once, transversally, and separately from
    other kinks. An example is drag by abs(w) w at w = 0. A force law that is not smooth on one side of a kink, such as
    w abs(w)**0.5, ends the proof. Impacts, and constraints that are redundant for some parameters only, raise an error.
    A proof also ends at a kink that only a part of the box meets, or close to a singular position of a loop. After the
    end of the proof, bounds are infinite, and ``caution`` states this time. Outputs that are not smooth, or have
    operations without a remainder, have infinite bounds. An executor proves parts of the box at the same time.

    Parameters
    ----------
    order : highest degree in each parameter; for three or more parameters, highest total degree. If polynomials of many
        parameters would have more than 1001 terms, the degree is lower. Parameters with a nearly linear effect then
        have terms of lower order than the others. ``remarks`` of the bounds state these orders
    boxes : largest number of parts of the box. A part is halved if its remainder makes steps much shorter than the
        motion needs, or if its proof is lost. The result is the union of the bounds

    Raises
    ------
    PropagationError
        Raised by ``bounds`` if the method does not accept the equations, or there are too many uncertain parameters for
        the order.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.TaylorModel(), mb.TaylorModel(order=12, boxes=4)
    (TaylorModel(order=8), TaylorModel(order=12, boxes=4))

    References
    ----------
    Makino and Berz, International Journal of Differential Equations and Applications 10 (2005), preconditioned Taylor
    models; International Journal of Pure and Applied Mathematics 4 (2003), their arithmetic. Lohner, thesis, Karlsruhe
    (1988), frames. Lin and Stadtherr, Applied Numerical Mathematics 57 (2007), parameters. Nedialkov, Jackson and
    Corliss, Applied Mathematics and Computation 105 (1999), a-priori enclosures. Neumaier, Reliable Computing 9 (2003),
    Taylor forms. Trefethen, Approximation Theory and Approximation Practice (2013), theorems 8.1 and 15.2,
    interpolation of analytic functions. Filippov, Differential Equations with Discontinuous Righthand Sides (1988),
    section 10, transversal passes.
    """

    order: int = 8
    boxes: int = 16

    kind: ClassVar[Kind] = "enclosure"
    unit_of_work: ClassVar[str] = "parts of the time"

    def __post_init__(self) -> None:
        # Highest order. Coefficients of higher order are only rounding for smooth motions.
        require_whole(self, "order", 1, 60)
        require_whole(self, "boxes", 1)

    def bounds(self, runs: RunsOverBox) -> Bounds:
        simulator, box = runs.simulator, runs.box
        problem = problem_of(self, simulator, box)
        if not problem.n:
            self._require_room(problem.d)

        if problem.meeting:
            warnings.warn(f"{self!r}: {problem.meeting}. The proof ends at this time.", SymmbWarning, stacklevel=2)
        outlook = _Outlook(self)

        def tell(share: float) -> None:
            outlook.note(share)
            if runs.progress is not None:
                runs.progress(min(int(share * _PARTS_OF_PROGRESS), _PARTS_OF_PROGRESS), _PARTS_OF_PROGRESS)

        require_runs(self, self.boxes, "Use fewer boxes.")
        found = enclose(problem, self.order, self.boxes, runs.executor, tell)
        tell(1.0)
        few = not problem.n or NO_START in found.why or SINGULAR in found.why
        remedy = "; try smaller intervals" if few else "; try a higher order, more boxes or smaller intervals"
        remedy = f". {problem.meeting}" if problem.meeting else remedy
        caution = _caution(found, remedy, runs.times, runs.outputs, problem.refused)
        varied = [name for name, (low, high) in zip(box.names, box.bounds, strict=True) if low < high]
        remarks = _orders(self.order, dict(zip(varied, found.orders, strict=True)) if problem.n else {})
        return self._result(runs, found.lower, found.upper, found.boxes, caution=caution, remarks=remarks)

    def _require_room(self, d: int) -> None:
        """Raise PropagationError if polynomials of outputs in d parameters have too many terms.

        An interpolation with a million terms takes half a minute.
        """
        terms, more = 1_000_000, EXTRA_NODES + 1
        if (self.order + more) ** d > terms:
            most = int(terms ** (1.0 / d) + 1e-9) - more
            lower = f"order={most}, " if most > 0 else ""
            raise PropagationError(
                f"{self!r}: polynomials of {d} parameters have {(self.order + more) ** d} terms, but at most "
                f"{terms} are allowed. Use {lower}fewer uncertain parameters, or PolynomialChaos()."
            )

    def __repr__(self) -> str:
        return constructor_text(self, f"order={self.order}")


class _Outlook:
    """A message, issued once, about the duration of a proof that takes minutes.

    The remaining time is predicted from the last step and from the mean of all steps. The smaller prediction is used.
    The first steps are short, so the mean predicts too much time. Before an early end of the proof, the last step is
    also short and predicts too much time.
    """

    def __init__(self, method: TaylorModel) -> None:
        self._method, self._last, self._is_open = method, (time.monotonic(), 0.0), True
        self._begin = self._last[0]

    def note(self, share: float) -> None:
        """Store the fraction of the horizon that is proved."""
        (before, last), now = self._last, time.monotonic()
        self._last = now, share
        # The duration of a proof is predicted after this time [s].
        if not self._is_open or now < self._begin + 8.0 or not last < share < 1.0:
            return
        self._is_open = False
        minutes = (1.0 - share) * min((now - before) / (share - last), (now - self._begin) / share) / 60.0
        if minutes > 1.0:
            warnings.warn(
                f"{self._method!r}: {100 * share:.2g} % of the time is proved; the rest takes about {minutes:.0f} "
                "minutes. A lower order or fewer boxes take less time.",
                SymmbWarning,
                stacklevel=2,
            )


def _orders(order: int, found: dict[str, int]) -> tuple[str, ...]:
    """A remark if the polynomials of many parameters have lower orders than the method."""
    if all(own == order for own in found.values()):
        return ()
    orders = ", ".join(f"{name} {own}" for name, own in found.items())
    return (f"With order={order} the polynomials would have too many terms. Their highest orders are: {orders}.",)


def _caution(found: Enclosure, remedy: str, times: Array, outputs: Sequence[str], refused: Sequence[str]) -> str:
    """The warning about times or outputs for which nothing or little is proved."""
    begin = float(times[0])
    parts = [
        f"infinite for {name}, because {unknown} has no remainder"
        for name, unknown in zip(outputs, refused, strict=True)
        if unknown
    ]
    known = np.array([not unknown for unknown in refused], dtype=bool)
    upper, loose = found.upper[:, known], found.is_loose & known
    if found.why and not np.isfinite(upper).any():
        return "; ".join([*parts, f"not proved at any time: {found.why}{remedy}"])
    is_infinite = ~np.isfinite(found.upper) & known
    if found.why:
        parts.append(f"proved up to t = {begin + found.until:g} s only and infinite later: {found.why}{remedy}")
        is_infinite &= is_infinite.all(axis=0)  # other bounds are infinite because the motion is not known
    if is_infinite.any():
        names, when = _names(outputs, is_infinite), "" if is_infinite.all(axis=0).any() else " at some times"
        parts.append(
            f"infinite for {names}{when}, because smoothness over the box is not proved; try smaller intervals"
        )
    elif not found.why and loose.any():
        begin = times[loose.any(axis=1).argmax()]
        parts.append(
            f"proved, but wide from t = {begin:g} s on for {_names(outputs, loose)}: more than half of a width is "
            f"remainder{remedy}"
        )
    return "; ".join(parts)


def _names(outputs: Sequence[str], which: Mask) -> str:
    """At most three names of the outputs that a mask (n_t, n_y) selects at any time."""
    names = [name for name, marked in zip(outputs, np.any(which, axis=0).tolist(), strict=True) if marked]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more outputs" if len(names) > 3 else "")
