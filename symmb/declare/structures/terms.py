"""Structures with parameters: their matrices are sums of constant matrices times expressions."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import SAME, SMALL
from symmb._options import number_text, numbers_of, shown
from symmb._types import Array, Expr, Indices
from symmb.declare.structures.beams import Beam, Mesh, mesh
from symmb.declare.structures.mass_samples import MassSamples, Sparse, joined
from symmb.declare.structures.validation import is_law
from symmb.declare.symbolic import batch

OWNER = "FiniteElements.modes"
_SAME = 1e-11
"""Largest relative difference of laws that is treated as a rounding error."""
_PROPORTIONAL = ([0], [3], [4, 2], [5, 1], [6], [7], [8])
"""Groups of laws of a beam. Element shapes depend on the proportions of laws in a group and along the beam. So these
proportions must not depend on parameters."""


@dataclass(frozen=True, eq=False)
class Ranges:
    """Intervals of parameters by name. A number is an interval of zero width."""

    intervals: dict[str, tuple[float, float]]

    @classmethod
    def given(cls, at: Mapping[str, Any] | None, owner: str) -> "Ranges":
        """Intervals from a `Box`, from `Parameters`, or from a mapping with numbers and pairs."""
        if at is not None and not hasattr(at, "keys"):
            raise DeclarationError(
                f"{owner}: the argument 'at' must be a Box, Parameters, or a dictionary of values, got {shown(at)}."
            )
        intervals = {}
        for name, value in dict(at or {}).items():
            ends = numbers_of(value)
            if ends is None or ends.shape not in ((), (2,)) or not np.isfinite(ends).all():
                raise DeclarationError(
                    f"{owner}: at[{shown(name)}] must be a number or a pair (lower, upper), got {shown(value)}."
                )
            low, high = np.broadcast_to(ends, 2).tolist()
            if low > high:
                raise DeclarationError(f"{owner}: at[{name!r}] has lower {low:g} above upper {high:g}. Exchange them.")
            intervals[name] = low, high
        return cls(intervals)

    @property
    def widened(self) -> "Ranges":
        """The ranges, widened so that the interval of every parameter has a width above 0."""
        # A parameter without an interval is varied a little, to see what depends on it.
        near = {name: (SMALL * abs(low) or SAME) * (low == high) for name, (low, high) in self.intervals.items()}
        return Ranges({name: (low - near[name], high + near[name]) for name, (low, high) in self.intervals.items()})

    def points(self, names: Iterable[str], most_corners: int = 32, inner: int = 32) -> list[dict[str, float]]:
        """Middle, corners and inner points for parameters with these names. Other parameters have middle values."""
        middle = {name: low + 0.5 * (high - low) for name, (low, high) in self.intervals.items()}
        names, random = list(names), np.random.default_rng(0)
        if not names:
            return [middle]
        few = 2 ** len(names) <= most_corners
        corners = list(product([0, 1], repeat=len(names))) if few else random.integers(0, 2, (most_corners, len(names)))
        ends = np.array([self.intervals[name] for name in names])
        shares = np.vstack([corners, random.random((inner, len(names)))])
        places = ends[:, 0] * (1 - shares) + ends[:, 1] * shares
        return [middle, *(middle | dict(zip(names, place.tolist(), strict=True)) for place in places)]

    def values(self, laws: Sequence[Expr], points: Sequence[dict[str, float]], owner: str) -> Array:
        """Values (N, m) of laws at points. Raises DeclarationError for missing values, or if a value is not finite."""
        stacked = ca.vertcat(*map(ca.SX, laws))
        symbols = ca.symvar(stacked)
        for name in names_in(laws):
            if name not in self.intervals:
                raise DeclarationError(
                    f"{owner}: {name!r} has no value. Give its interval, at=mb.Box({name}=(lower, upper)), or its "
                    "nominal value, at=parameters."
                )
        if not symbols:
            return np.tile(np.array(laws, dtype=float), (len(points), 1))
        f = ca.Function("laws", [ca.vertcat(*symbols)], [ca.densify(stacked)])
        places = np.array([[point[symbol.name()] for symbol in symbols] for point in points])
        found = batch(f, places)[0].reshape(len(points), len(laws))
        for law, column in zip(laws, found.T, strict=True):
            if is_law(law) and not np.isfinite(column).all():
                worst = points[int(np.argmin(np.isfinite(column)))]
                raise DeclarationError(f"{owner}: {law} is not finite at {place_text(worst, [law])}.")
        return found

    def shaping(self, laws: Sequence[Sequence[Expr]], owner: str) -> list[str]:
        """Names of the parameters that change the proportions of the laws in at least one list."""
        wide, known = self.widened, names_in([law for some in laws for law in some])
        return [
            name
            for name in self.intervals
            if name in known and any(not _proportional(self.values(some, wide.points([name]), owner)) for some in laws)
        ]


def names_in(laws: Sequence[Expr]) -> dict[str, None]:
    """Names of the symbols in laws, in the order of the symbols."""
    return dict.fromkeys(symbol.name() for symbol in ca.symvar(ca.vertcat(*map(ca.SX, laws))))


def place_text(point: Mapping[str, float], laws: Sequence[Expr]) -> str:
    """The values of the parameters in some laws, as a text."""
    return ", ".join(f"{name} = {number_text(point[name])}" for name in names_in(laws))


@dataclass(frozen=True, eq=False)
class Terms:
    """K = Σ c K_i and M = Σ d M_j with expressions c and d. The nominal sums are for the middles of all ranges."""

    ranges: Ranges
    stiffness: tuple[tuple[Expr, Sparse], ...]
    mass: tuple[tuple[Expr, Sparse, MassSamples], ...]

    def with_mass(self, added: MassSamples) -> "Terms":
        """The terms with additional mass that depends on no parameter. All mass terms get the same samples."""
        none = _massless(added)
        kept = [(law, M, joined([samples, none])) for law, M, samples in self.mass]
        own = 1.0, added.mass_matrix(), joined([_massless(self.mass[0][2]), added])
        return replace(self, mass=(*kept, own))

    @property
    def has_laws(self) -> bool:
        """Whether a factor is an expression."""
        return any(is_law(law) for law, *_ in (*self.stiffness, *self.mass))

    def middle(self, law: Expr) -> float:
        """The value of a law for the middles of the ranges."""
        return float(self.ranges.values([law], self.ranges.points([]), OWNER)[0, 0])

    def box(self, free: Indices) -> dict[str, tuple[float, float]]:
        """Intervals of the parameters that change the shapes of modes of the `free` degrees of freedom."""
        stiff, massive = (
            [law for law, A, *_ in terms if abs(A[free][:, free]).max() > 0] for terms in (self.stiffness, self.mass)
        )
        box = {name: self.ranges.intervals[name] for name in self.ranges.shaping([stiff, massive], OWNER)}
        for name, (low, high) in box.items():
            if low == high:
                raise DeclarationError(
                    f"{OWNER}: {name!r} changes the shapes of the modes, but has only the value {low:g}. Give its "
                    f"interval: at=mb.Box({name}=(lower, upper)), or at={{**parameters, **box}}."
                )
        return box

    def matrices(self, free: Indices, names: Iterable[str]) -> tuple[list[tuple[Sparse, Sparse]], list[str]]:
        """K and M of the `free` degrees of freedom at points of the box of parameters, and texts of these points."""
        points, sums, laws = self.ranges.points(names), [], []
        for terms in (self.stiffness, self.mass):
            own = [law for law, *_ in terms]
            parts = [A[free][:, free] for _, A, *_ in terms]
            sums.append([summed(factors, parts) for factors in self.ranges.values(own, points, OWNER)])
            laws += own
        return list(zip(*sums, strict=True)), [place_text(point, laws) for point in points]


def _massless(samples: MassSamples) -> MassSamples:
    return replace(samples, mass=0.0 * samples.mass, rotary=0.0 * samples.rotary)


def beam_terms(beams: Sequence[Beam], ranges: Ranges, owner: str) -> tuple[Mesh, Terms]:
    """The mesh of beams for the middles of the ranges, and its terms."""
    if not any(is_law(number) for beam in beams for number in beam.numbers):
        meshed = mesh(beams)
        return meshed, numeric_terms(meshed.stiffness, meshed.samples.mass_matrix(), meshed.samples, ranges)
    wide = ranges.widened
    points = [*ranges.points([]), *wide.points(wide.intervals)[1:]]
    tried = [_evaluated(beam, ranges.values(beam.numbers, points, owner), points) for beam in beams]
    nominal = [some[0] for some in tried]
    factors = [np.array([beam.laws() for beam in some]) / np.array(some[0].laws()) for some in tried]
    if any(not _is_one_law(some[:, :, k]) for some in factors for k in _PROPORTIONAL):
        raise DeclarationError(
            f"{owner}: parameters change the proportions along a beam, or the ratio of bending to shear "
            "stiffness. "
            "This would change the shapes of elements. Use one section for the whole beam, and section.without_shear()."
        )
    stiff, massive = (_distinct(beams, nominal, factors, which) for which in (range(6), range(6, 9)))
    stiffness = tuple((law, part.stiffness) for law, part in stiff)
    mass = tuple((law, part.samples.mass_matrix(), part.samples) for law, part in massive)
    return mesh(nominal), Terms(ranges, stiffness, mass)


def _distinct(
    beams: Sequence[Beam], nominal: Sequence[Beam], factors: Sequence[Array], which: Iterable[int]
) -> Iterator[tuple[Expr, Mesh]]:
    """Distinct laws of all beams, each with the mesh of the parts that are proportional to the law.

    `which` are the indices of the laws that are compared. `factors` of each beam are its laws at points, divided by the
    laws at the first point.
    """
    left = [(b, k) for b in range(len(beams)) for k in which]
    while left:
        b, k = left[0]
        own = [x for x in left if _is_one_law(np.stack([factors[i][:, 0, j] for i, j in (x, (b, k))], axis=1))]
        shares = np.zeros((len(beams), 9))
        shares[tuple(np.transpose(own))] = 1.0
        yield beams[b].laws()[0][k] / nominal[b].laws()[0][k], mesh(nominal, shares)
        left = [x for x in left if x not in own]


def numeric_terms(K: Sparse, M: Sparse, samples: MassSamples, ranges: Ranges) -> Terms:
    """The terms of a structure without parameters."""
    return Terms(ranges, ((1.0, K),), ((1.0, M, samples),))


def _evaluated(beam: Beam, values: Array, points: Sequence[dict[str, float]]) -> list[Beam]:
    """The beam at N points, with values (N, m) of its `numbers`."""
    found = []
    for numbers, point in zip(values, points, strict=True):
        try:
            found.append(beam.with_numbers(numbers))
        except DeclarationError as error:
            raise DeclarationError(f"{error} The parameters are {place_text(point, beam.numbers)}.") from None
    return found


def _is_one_law(factors: Array) -> bool:
    """Whether all columns of factors (N, ...) at N points are equal."""
    flat = factors.reshape(len(factors), -1)
    return bool(np.allclose(flat, flat[:, :1], rtol=_SAME, atol=0))


def summed(factors: Array, matrices: Sequence[Sparse]) -> Sparse:
    """The sum Σ factor matrix."""
    parts = [c * A for c, A in zip(factors, matrices, strict=True)]
    return sum(parts[1:], parts[0])


def _proportional(values: Array) -> bool:
    """Whether all rows are positive multiples of the first row."""
    norm = np.linalg.norm(values, axis=1, keepdims=True)
    rows = values / np.where(norm > 0, norm, 1.0)
    return bool(np.abs(rows - rows[0]).max(initial=0.0) <= _SAME)
