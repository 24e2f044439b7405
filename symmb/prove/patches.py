"""Patches of the distinguished boundary of a polyellipse, and discs that contain the values of polynomials there.

The ellipse with the parameter rho is z = (rho e^(i a) + e^(-i a) / rho) / 2. On it T_k = (rho^k e^(i k a) +
e^(-i k a) / rho^k) / 2 is at most cosh(k log rho). A patch is an interval of the angle a for each variable.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from symmb._types import Array
from symmb.prove.chebyshev import along
from symmb.prove.discs import Disc
from symmb.prove.rounding import ERROR_OF_MODULI, above

_ERROR_OF_DISTANCES = 4e-15
"""Relative error that covers the rounding of sums of a middle and distances from the middle."""


class Patches:
    """Patches of the boundaries of ellipses, one for each variable.

    With rho = 1 a variable is real, in [-1, 1]. A single patch of a variable is the whole ellipse. Values at conjugate
    points are conjugate. Half the ellipse of the first variable with several patches is thus enough.

    Parameters
    ----------
    rho : parameters of the ellipses, at least 1
    counts : patches of each variable
    degrees : highest degree of each variable
    """

    def __init__(self, rho: Sequence[float], counts: Sequence[int], degrees: Sequence[int]) -> None:
        self.rho = tuple(rho)
        halved = next((i for i, count in enumerate(counts) if count > 1), -1)
        factors = [
            _factors(r, count, max(n, 1), r == 1.0 or i == halved)
            for i, (r, count, n) in enumerate(zip(rho, counts, degrees, strict=True))
        ]
        self.centres, self._slopes, self._sizes, self._swings, _ = map(list, zip(*factors, strict=True))
        self._reaches = [above(of.sizes + of.swings + of.rests) for of in factors]

    def discs(self, c: Array) -> list[Disc]:
        """Discs of polynomials (m, n0, ..., nd) on the patches (P0, ..., Pd)."""
        modulus, variables = np.abs(c), range(len(self.rho))

        def with_one(matrices: list[Array], others: list[Array], j: int) -> list[Array]:
            return [matrices[i] if i == j else others[i] for i in variables]

        slopes = [_applied(with_one(self._slopes, self.centres, j), c) for j in variables]
        linear = [_applied(with_one(self._swings, self._sizes, j), modulus) for j in variables]
        reaches, sizes = _applied(self._reaches, modulus), _applied(self._sizes, modulus)
        # moduli on the patches that remain after the centres and the linear motion
        radii = above(reaches * (1.0 + ERROR_OF_MODULI) - sizes - sum(linear)).reshape(len(c), 1)
        parts = zip(_applied(self.centres, c), np.stack(np.broadcast_arrays(*slopes), axis=1), radii, strict=True)
        return [Disc(centre, np.moveaxis(own, 0, -1), radius) for centre, own, radius in parts]

    def linear(self, middle: float, radius: float, variable: int, error: float = 0.0) -> Disc:
        """The discs of middle + radius z for one variable z. The middle has an error up to `error`."""
        count = len(self.centres)
        shape = [-1 if i == variable else 1 for i in range(count)]
        slopes = np.zeros((count, len(self.centres[variable])), dtype=self._slopes[variable].dtype)
        slopes[variable] = radius * self._slopes[variable][:, 1]
        centres = middle + radius * self.centres[variable][:, 1].reshape(shape)
        reach, swing, size = (of[variable][1] for of in (self._reaches, self._swings, self._sizes))
        rest = radius * (reach * (1.0 + ERROR_OF_MODULI) - size - swing) + ERROR_OF_MODULI * radius * reach
        rest = rest + _ERROR_OF_DISTANCES * abs(middle) + error
        return Disc(centres, np.moveaxis(slopes.reshape(count, *shape), 0, -1), above(np.array([rest])))


def _applied(matrices: Sequence[Array], c: Array) -> Array:
    """Matrices with a column for each T_k, applied to polynomials (m, n0, ..., nd). A vector counts as one row."""
    return along([np.atleast_2d(matrix)[:, :n] for matrix, n in zip(matrices, c.shape[1:], strict=True)], c)


def largest_on(rho: Sequence[float], c: Array) -> Array:
    """Bounds (m,) of polynomials (m, n0, ..., nd) on a polyellipse."""
    factors: list[Array | None] = [cosh_powers(r, n)[None] for r, n in zip(rho, c.shape[1:], strict=True)]
    return above(along(factors, np.abs(c)).reshape(len(c)))


def cosh_powers(rho: float, n: int) -> Array:
    """(n,) bounds of |T_k| on an ellipse."""
    return above(np.cosh(np.arange(n) * math.log(rho))) if rho > 1.0 else np.ones(n)


class _Factors(NamedTuple):
    """T_k on the patches of a variable as centre + slope eps + rest for |eps| <= 1.

    Attributes
    ----------
    centres, slopes : (count, degree + 1) at the centres of the patches
    sizes, swings, rests : (degree + 1,) bounds of the moduli of the three parts
    """

    centres: Array
    slopes: Array
    sizes: Array
    swings: Array
    rests: Array


def _factors(rho: float, count: int, degree: int, half: bool) -> _Factors:
    """The factors of a variable. The n-th derivative of T_k by the angle is at most k^n cosh(k log rho)."""
    k = np.arange(degree + 1)
    top = cosh_powers(rho, degree + 1)
    if count == 1:  # z = rho / 2 eps + 1 / (2 rho eps) on the ellipse, with |eps| = 1
        first, slope = (k == 0).astype(float), (k == 1) * (1.0 if rho == 1.0 else 0.5 * rho)
        rests = above(np.where(k == 0, 0.0, np.where(k == 1, 0.0 if rho == 1.0 else 0.5 / rho, top)))
        return _Factors(first[None], slope[None], first, above(slope), rests)
    whole = math.pi if half else 2.0 * math.pi
    angles, turn = (np.arange(count) + 0.5) * whole / count, k * (0.5 * whole / count)
    is_linear = turn < 1.0
    swings = above(np.where(is_linear, turn, 0.0) * top)
    rests = above(np.where(is_linear, 0.5 * turn**2, np.minimum(2.0, turn)) * top)
    turned = np.outer(angles, k)
    if rho == 1.0:
        return _Factors(np.cos(turned), np.where(is_linear, -turn * np.sin(turned), 0.0), top, swings, rests)
    size = np.exp(k * math.log(rho))
    there, back = 0.5 * size * np.exp(1j * turned), 0.5 * np.exp(-1j * turned) / size
    return _Factors(there + back, np.where(is_linear, 1j * turn * (there - back), 0.0), top, swings, rests)
