"""Taylor expansions of the responses about the centres of subintervals, bounded by interval arithmetic."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from symmb._errors import PropagationError
from symmb._limits import require_memory, require_runs
from symmb._options import constructor_text, require_whole
from symmb._types import Array
from symmb.bound.answers import Bounds, Kind
from symmb.bound.methods.method import Method
from symmb.bound.nodes import Grid, grid
from symmb.bound.polynomials import Expansion, MultiIndices, TotalDegree, homogeneous
from symmb.bound.polynomials.ranges import Piecewise, last_terms
from symmb.bound.responses import DOUBTFUL, MOST_NUMBERS, RunsOverBox, parameter_samples
from symmb.connect import Kinked, noise_from_runs
from symmb.equations.model import Box

_MOST_EVALUATIONS = 100_000
"""Largest number of evaluations of all parts. If an evaluation takes 1 ms, all take two minutes."""
_MOST_DIRECTIONS = 2000
"""Largest number of directions of derivatives. The solution of their equations takes ten seconds."""


@dataclass(frozen=True)
class Taylor(Method):
    """Bounds of the truncated Taylor expansion sum c_beta xi^beta, |beta| <= order, over xi in [-1, 1]^d.

    The bounds follow by natural interval arithmetic with even powers in [0, 1]. The remainder is left out, so that the
    bounds are not proved. If a run meets kinks, jumps or events, differences of runs give the coefficients. Expansions
    are not valid where events pass an output time. ``caution`` names the kinks and jumps if runs at the ends of
    intervals differ from the expansion. Mixed coefficients follow from univariate Taylor coefficients along the
    directions alpha / order, |alpha| = order. The j-th coefficient along a direction u is sum c_beta u^beta over
    |beta| = j. Each part counts as C(d + order, d) evaluations, because it has this number of
    coefficients. Differences take 16 runs for each direction instead. The executor is not used.

    Parameters
    ----------
    order : highest total degree
    subintervals : number of equal parts of the interval of each parameter. Each of the ``subintervals**d`` parts has an
        expansion. The bounds are the union of the bounds of all parts

    Raises
    ------
    PropagationError
        Raised by ``bounds`` if derivatives are missing or not finite.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Taylor(order=2)
    Taylor(order=2)

    References
    ----------
    Wu, Zhang, Chen and Luo, Computer Methods in Applied Mechanics and Engineering (2013), Taylor inclusion
    functions. Griewank, Utke and Walther, Mathematics of Computation 69 (2000), mixed derivatives from
    univariate ones. Moore, Kearfott and Cloud, Introduction to Interval Analysis (2009), chapter 6,
    refinement.
    """

    order: int = 2
    subintervals: int = 1

    requires: ClassVar[str] = "jets"
    kind: ClassVar[Kind] = "estimate"

    def __post_init__(self) -> None:
        require_whole(self, "order", 1)
        require_whole(self, "subintervals", 1)

    def planned_runs(self, d: int) -> int:
        return self.subintervals**d * math.comb(d + self.order, d)

    def bounds(self, runs: RunsOverBox) -> Bounds:
        simulator, box, d = runs.simulator, runs.box, len(runs.box)
        directions = math.comb(d + self.order - 1, self.order)
        if directions > _MOST_DIRECTIONS:
            raise PropagationError(
                f"{self!r} takes derivatives along {directions} directions in {d} parameters, but at most "
                f"{_MOST_DIRECTIONS} are allowed. Use a lower order."
            )
        require_runs(self, self.planned_runs(d), "Use fewer subintervals.")
        if self.planned_runs(d) > _MOST_EVALUATIONS:
            raise PropagationError(
                f"{self!r} takes {self.subintervals**d} expansions in {d} parameters. These count as "
                f"{self.planned_runs(d)} evaluations, but at most {_MOST_EVALUATIONS} are allowed. "
                "Use fewer subintervals, PolynomialChaos() or Optimization()."
            )
        outputs = len(simulator.times) * len(simulator.outputs)
        require_memory(self, "the derivatives", 3 * (self.order + 1) * directions * outputs)
        unit = np.array(homogeneous(d, self.order)) / self.order
        radius = 1.0 / self.subintervals
        middles = radius * np.arange(1.0 - self.subintervals, self.subintervals, 2.0)
        centers = grid(middles, d)
        lower = np.full((len(simulator.times), len(simulator.outputs)), np.inf)
        upper = -lower
        kinked = simulator if isinstance(simulator, Kinked) else None
        kinks: list[tuple[float, str]] = []
        kept = self.planned_runs(d) * outputs <= MOST_NUMBERS
        parts = list[list[Array]]()
        for done, center in enumerate(centers, start=1):
            jets = runs.unit_jets(center, unit * radius, self.order)
            part = self._coefficients(jets, unit)
            below, above = _range(part)
            if kept:
                parts.append(part)
            lower, upper = np.minimum(lower, below), np.maximum(upper, above)
            if kinked:
                ends = np.vstack([np.zeros(d), np.eye(d), -np.eye(d)])
                P = parameter_samples(simulator, box, center + radius * ends)
                if own := list(filter(None, map(kinked.kink, P))):
                    off = np.abs(_values(part, ends) - simulator.run(P).Y).max(axis=0)
                    noise = noise_from_runs(simulator)
                    least = DOUBTFUL * (above - below).max(axis=0) + (0.0 if noise is None else 2 * noise)
                    kinks += own if not (off <= least).all() else []
            if runs.progress is not None:
                runs.progress(done, len(centers))
        surrogate = _polynomials(parts, centers, radius, box) if kept else None
        details = {"caution": _caution(kinks), "surrogate": surrogate}
        return self._result(runs, lower, upper, self.planned_runs(d), **details)

    def _coefficients(self, jets: Array, unit: Array) -> list[Array]:
        """Coefficients (n_b, n_t, n_y) of each degree from jets along the directions ``unit`` (m, d)."""
        beta = [np.array(homogeneous(unit.shape[1], degree)) for degree in range(1, self.order + 1)]
        return [jets[0, :1], *(_mixed(b, unit, along) for b, along in zip(beta, jets[1:], strict=True))]

    def __repr__(self) -> str:
        return constructor_text(self, f"order={self.order}")


def _caution(kinks: list[tuple[float, str]]) -> str:
    """The warning about kinks or jumps in runs."""
    if not kinks:
        return ""
    time, which = min(kinks)
    return f"not valid from t = {time + 0.0:g} s on, because the expansion does not contain the {which}"


def _polynomials(parts: Sequence[Sequence[Array]], centers: Array, radius: float, box: Box) -> Piecewise:
    """Legendre expansions of all parts, with centres (k, d) and a half width.

    Their expected error is the size of their last terms.
    """
    d, order = len(box), len(parts[0]) - 1
    beta, lattice = TotalDegree().indices(d, order), Grid(d)
    lattice.add(set(map(tuple, beta.tolist())))
    change = lattice.coefficients(np.prod(lattice.nodes[:, None] ** beta, axis=2))
    coefficients = [np.tensordot(change, np.concatenate(part), axes=1) for part in parts]
    expansions = tuple(Expansion(lattice.alpha, each, box.names) for each in coefficients)
    error = np.max([last_terms(own) for own in expansions], axis=0)
    return Piecewise(centers, np.full_like(centers, radius), expansions, error, exact=False)


def _mixed(beta: MultiIndices, unit: Array, along: Array) -> Array:
    """Coefficients (n_b, n_t, n_y) of xi^beta from the coefficients ``along`` (m, n_t, n_y) directions ``unit`` (m, d).
    The directions are the principal lattice of a simplex: they determine all homogeneous polynomials up to the
    order."""
    monomials = np.prod(unit[:, None, :] ** beta[None, :, :], axis=2)
    return np.tensordot(np.asarray(np.linalg.pinv(monomials), dtype=float), along, axes=1)


def _values(part: Sequence[Array], points: Array) -> Array:
    """Values (N, n_t, n_y) of an expansion at points (N, d), from its coefficients of each degree."""
    beta = np.concatenate([np.array(homogeneous(points.shape[1], degree)) for degree in range(len(part))])
    monomials = np.prod(points[:, None] ** beta, axis=2)
    return np.asarray(np.tensordot(monomials, np.concatenate(part), axes=1), dtype=float)


def _range(part: Sequence[Array]) -> tuple[Array, Array]:
    """Bounds (n_t, n_y) of an expansion from its coefficients of each degree. xi^beta is in [0, 1] if all powers are
    even, otherwise in [-1, 1]."""
    d = len(part[1])
    lower = upper = part[0][0]
    for degree, c in enumerate(part[1:], start=1):
        even = (np.array(homogeneous(d, degree)) % 2 == 0).all(axis=1)
        swing = np.abs(c[~even]).sum(axis=0)
        lower = lower + (np.minimum(c[even], 0.0).sum(axis=0) - swing)
        upper = upper + (np.maximum(c[even], 0.0).sum(axis=0) + swing)
    return lower, upper
