"""Patches of the distinguished boundary of a polyellipse, and discs that hold polynomials there.

The ellipse of parameter rho is z = (rho e^(i a) + e^(-i a) / rho) / 2, on which T_k = (rho^k e^(i k a) + e^(-i k a) /
rho^k) / 2 is at most cosh(k log rho). A patch is a part of the angles a of each variable.
"""

import math
from collections.abc import Sequence

import numpy as np

from symmb._types import Array
from symmb.enclosures.chebyshev import along
from symmb.enclosures.discs import Disc, disc
from symmb.enclosures.rounding import above

_SUMS = 1e-9
"""Share of the sum of moduli that covers the rounding of centres and radii."""
_ROUNDED = 4e-15
"""Covers the rounding of sums of a middle and its distances."""


class Patches:
    """Patches of the boundaries of ellipses, one for each variable.

    With rho = 1 a variable is real, in [-1, 1]. One patch stands for the whole ellipse, with its interior. Values at
    conjugate points are conjugate, so that half the ellipse of the first variable is enough.

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
        self.centres = [centre for centre, _, _ in factors]
        self._sizes = [size for _, size, _ in factors]
        self._reaches = [above(size + swing) for _, size, swing in factors]

    def discs(self, c: Array) -> list[Disc]:
        """Polynomials (m, n0, ..., nd) over the patches (P0, ..., Pd)."""
        lengths = c.shape[1:]
        modulus = np.abs(c)
        centres = along([matrix[:, :n] for matrix, n in zip(self.centres, lengths, strict=True)], c)
        reaches = along([a[None, :n] for a, n in zip(self._reaches, lengths, strict=True)], modulus)
        sizes = along([a[None, :n] for a, n in zip(self._sizes, lengths, strict=True)], modulus)
        radii = above(reaches * (1.0 + _SUMS) - sizes)
        return [disc(centre, radius.ravel()[:1]) for centre, radius in zip(centres, radii, strict=True)]

    def linear(self, middle: float, radius: float, variable: int, error: float = 0.0) -> Disc:
        """The discs of middle + radius z for one variable z, where the middle has an error."""
        shape = [-1 if i == variable else 1 for i in range(len(self.centres))]
        centres = middle + radius * self.centres[variable][:, 1].reshape(shape)
        swing = self._reaches[variable][1] - self._sizes[variable][1]
        return disc(centres, above(radius * swing * (1 + _SUMS) + _SUMS * (radius * self._reaches[variable][1])
                                   + _ROUNDED * abs(middle) + error))  # fmt: skip


def largest_on(rho: Sequence[float], c: Array) -> Array:
    """Bounds (m,) of polynomials (m, n0, ..., nd) on a polyellipse."""
    factors: list[Array | None] = [cosh_powers(r, n)[None] for r, n in zip(rho, c.shape[1:], strict=True)]
    return above(along(factors, np.abs(c)).reshape(len(c)))


def cosh_powers(rho: float, n: int) -> Array:
    """(n,) bounds of |T_k| on an ellipse."""
    return above(np.cosh(np.arange(n) * math.log(rho))) if rho > 1.0 else np.ones(n)


def _factors(rho: float, count: int, degree: int, half: bool) -> tuple[Array, Array, Array]:
    """T_k at the centres (count, degree + 1), its modulus there, and how far it is from it in a patch (degree + 1,)."""
    k = np.arange(degree + 1)
    top = cosh_powers(rho, degree + 1)
    if count == 1:
        first = (k == 0).astype(float)
        return first[None], first, np.where(k == 0, 0.0, top)
    whole = math.pi if half else 2.0 * math.pi
    angles = (np.arange(count) + 0.5) * whole / count
    swing = above(np.minimum(2.0, k * (0.5 * whole / count)) * top)
    if rho == 1.0:
        return np.cos(np.outer(angles, k)), top, swing
    turned = np.outer(angles, k)
    size = np.exp(k * math.log(rho))
    return 0.5 * (size * np.exp(1j * turned) + np.exp(-1j * turned) / size), top, swing
