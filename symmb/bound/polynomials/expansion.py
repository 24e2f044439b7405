"""Legendre expansions of the responses, and their mean, variance and Sobol indices."""

from dataclasses import dataclass, field

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._magnitudes import ROUNDING
from symmb._options import require_names, require_numbers, shown
from symmb._table import aligned
from symmb._types import Array, Mask
from symmb.bound.polynomials.legendre import MultiIndices, basis_values, mean_squares
from symmb.results.files import NAMES, TIMES, Record, Saved, entry

_SHARES = "fractions of the variance, alone / with others, over all times"


@dataclass(frozen=True, eq=False)
class Expansion:
    """Responses as sums of Legendre products, y(xi) = sum a_i phi_i(xi) over [-1, 1]^d, eq. (20).

    Attributes
    ----------
    alpha : (n_b, d) degrees of the products, the constant first; phi_n(1) = 1
    coefficients : (n_b, n_t, n_y)
    parameters : d names, in the order of the columns of ``alpha``

    Examples
    --------
    >>> import symmb as mb
    >>> square = mb.FunctionSimulator(lambda a: [[a**2]], {"a": 1.0}, [0.0], ["y"])
    >>> bounds = mb.propagate(square, mb.PolynomialChaos(order=2), mb.Box(a=(0.0, 2.0)))
    >>> bounds.expansion.coefficients[:, 0, 0].round(6)
    array([1.333333, 2.      , 0.666667])
    >>> bounds.expansion.values([[0.0], [1.0]])[:, 0, 0].round(6)
    array([1., 4.])
    """

    alpha: MultiIndices
    coefficients: Array
    parameters: tuple[str, ...]

    def __post_init__(self) -> None:
        names = require_names("Expansion", "parameter", self.parameters, self.parameters)
        alpha = require_numbers("Expansion", "alpha", self.alpha, None, len(names))
        if not (alpha >= 0).all() or (alpha % 1).any():
            raise DeclarationError(f"Expansion: alpha must contain integers from 0 on, got {shown(self.alpha)}.")
        coefficients = require_numbers("Expansion", "coefficients", self.coefficients, len(alpha), None, None)
        values = {"alpha": alpha.astype(np.intp), "coefficients": coefficients, "parameters": tuple(names)}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _repr_html_(self) -> str:
        n_b, n_t, n_y = self.coefficients.shape
        rows = [[name, str(degree)] for name, degree in zip(self.parameters, self.alpha.max(axis=0), strict=True)]
        head = html.text(f"Expansion of {n_y} outputs at {n_t} times in {n_b} products of Legendre polynomials")
        return html.page(head, html.table([["parameter", "largest degree"], *rows]))

    def values(self, points: Array) -> Array:
        """Responses (N, n_t, n_y) at points (N, d) of [-1, 1]^d."""
        points = require_numbers("Expansion", "points", points, None, self.alpha.shape[1])
        return np.tensordot(basis_values(self.alpha, points), self.coefficients, axes=1)

    def without(self, parameters: Mask, outputs: Mask) -> "Expansion":
        """The expansion without the terms of some parameters (d,). The outputs of a mask (n_y,) become constant."""
        if not parameters.any() and not outputs.any():
            return self
        coefficients = self.coefficients.copy()
        coefficients[self.alpha[:, parameters].sum(axis=1) > 0] = 0.0
        coefficients[1:, :, outputs] = 0.0
        return Expansion(self.alpha, coefficients, self.parameters)


@dataclass(frozen=True, eq=False, repr=False)
class Moments(Saved):
    """Mean, variance and Sobol indices over time, for parameters that are uniform and independent in their
    intervals.

    A first-order index is the fraction of the variance that one parameter explains alone. A total index includes the
    interactions of this parameter with other parameters. Indices are nan if the variance is only a rounding error.

    Attributes
    ----------
    t : (n_t,) times [s]
    names : n_y outputs
    parameters : d names
    mean, variance : (n_t, n_y)
    first, total : (d, n_t, n_y)

    Examples
    --------
    >>> import symmb as mb
    >>> square = mb.FunctionSimulator(lambda a: [[a**2]], {"a": 1.0}, [0.0], ["y"])
    >>> bounds = mb.propagate(square, mb.PolynomialChaos(order=2), mb.Box(a=(0.0, 2.0)))
    >>> moments = bounds.moments()
    >>> moments.mean.round(6), moments.variance.round(6)
    (array([[1.333333]]), array([[1.422222]]))
    """

    t: Array = field(metadata=TIMES)
    names: tuple[str, ...] = field(metadata=NAMES)
    parameters: tuple[str, ...] = field(metadata=NAMES)
    mean: Array = field(metadata=entry(Record.array, "t", "names"))
    variance: Array = field(metadata=entry(Record.array, "t", "names"))
    first: Array = field(metadata=entry(Record.with_nan, "parameters", "t", "names"))
    total: Array = field(metadata=entry(Record.with_nan, "parameters", "t", "names"))

    @classmethod
    def _of_record(cls, record: Record) -> "Moments":
        moments = super()._of_record(record)
        shares = np.nan_to_num([moments.first, moments.total], posinf=np.inf)
        if (moments.variance < 0).any() or (np.abs(shares - 0.5) > 0.5 + ROUNDING).any():
            raise DeclarationError("variance must be at least 0, and first and total must be between 0 and 1.")
        return moments

    def __repr__(self) -> str:
        return f"Moments({len(self.names)} outputs x {len(self.t)} times, {len(self.parameters)} parameters)"

    def __str__(self) -> str:
        return "\n".join([_SHARES, *aligned(self._rows())])

    def _repr_html_(self) -> str:
        return html.page(html.text(_SHARES), html.table(self._rows()))

    def _rows(self) -> list[list[str]]:
        is_known = ~np.isnan(self.first[0])
        limits = np.finfo(float)
        size = np.clip(self.variance, limits.tiny, limits.max)  # the variance may underflow or overflow
        weights = np.where(is_known, size / size.max(axis=0), 0.0)
        alone, along = (np.nansum(each * weights, axis=1).T for each in (self.first, self.total))
        rows = [["", *self.parameters]]
        for name, whole, *shares in zip(self.names, weights.sum(axis=0).tolist(), alone, along, strict=True):
            texts = [f"{a / whole:.3f} / {b / whole:.3f}" for a, b in zip(*shares, strict=True)] if whole else []
            rows.append([name, *(texts or ["no variance", *[""] * (len(self.parameters) - 1)])])
        return rows


def moments(expansion: Expansion, t: Array, names: tuple[str, ...]) -> Moments:
    """Moments of an expansion. The variance is the sum of squared coefficients times mean squares of polynomials. The
    first-order index is the fraction from polynomials of this parameter alone. The total index is the fraction from all
    polynomials that contain the parameter.

    Examples
    --------
    2 + 3 x + 4 x y has the variance 3^2 / 3 + 4^2 / 9:

    >>> alpha, coefficients = np.array([[0, 0], [1, 0], [1, 1]]), np.array([2.0, 3.0, 4.0])
    >>> result = moments(Expansion(alpha, coefficients[:, None, None], ("x", "y")), np.zeros(1), ("f",))
    >>> result.mean[0, 0].round(6), result.variance[0, 0].round(6)
    (np.float64(2.0), np.float64(4.777778))
    >>> result.first[:, 0, 0].round(4), result.total[:, 0, 0].round(4)
    (array([0.6279, 0.    ]), array([1.    , 0.3721]))

    References
    ----------
    Sudret, Reliability Engineering and System Safety 93 (2008), Sobol indices from polynomial chaos.
    """
    involved = expansion.alpha.T > 0
    varies, alone = involved.any(axis=0), involved & (involved.sum(axis=0) == 1)
    # Squares may underflow or overflow. Scaling by powers of two avoids this without rounding.
    power = np.frexp(np.abs(expansion.coefficients).max(axis=(0, 1)))[1]
    parts = mean_squares(expansion.alpha)[:, None, None] * np.ldexp(expansion.coefficients, -power) ** 2
    mean = expansion.coefficients[~varies].sum(axis=0)
    variance = parts[varies].sum(axis=0)
    # Standard deviations below this fraction of the output's largest root mean square are only rounding.
    least = ROUNDING**2 * parts.sum(axis=0).max(axis=0)
    shares = np.full((2, len(involved), *variance.shape), np.nan)
    for share, chosen in zip(shares, (alone, involved), strict=True):
        np.divide(np.tensordot(chosen.astype(float), parts, axes=1), variance, out=share, where=variance > least)
    with np.errstate(over="ignore"):
        return Moments(t, names, expansion.parameters, mean, np.ldexp(variance, 2 * power), *shares)
