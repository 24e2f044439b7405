"""Roots of many functions at once."""

from collections.abc import Callable

import numpy as np

from symmb._types import Array

_ITERATIONS = 100
"""Maximum number of iterations. Bisection alone needs 60 iterations to reach rounding errors."""


def roots(f: Callable[[Array], Array], a: Array, b: Array, fa: Array, fb: Array) -> Array:
    """Roots (m,) of m functions, exact up to rounding. The values fa (m,) and fb (m,) have different signs.

    References
    ----------
    Chandrupatla (1997), Advances in Engineering Software 28, 145-149.
    """
    # (a, fa) is the newest point, b is the end on the other side of the root, and c is the previous newest point.
    a, b, c, fa, fb, fc = b.copy(), a.copy(), a.copy(), fb.copy(), fa.copy(), fa.copy()
    share = np.full(len(a), 0.5)
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            x = a + share * (b - a)
            fx = f(x)
            same = np.sign(fx) == np.sign(fa)
            c, fc = np.where(same, a, b), np.where(same, fa, fb)
            b, fb = np.where(same, b, a), np.where(same, fb, fa)
            a, fa = x, fx
            best = np.where(np.abs(fa) < np.abs(fb), a, b)
            least = 2 * np.finfo(float).eps * np.abs(best) / np.abs(b - a)
            if ((least > 0.5) | (fa == 0)).all():
                break
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            quadratic = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
            inverse = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
            share = np.where(quadratic & np.isfinite(inverse), inverse, 0.5)
            share = np.where(least < 0.5, np.clip(share, least, 1 - least), 0.5)
            share = np.where(fa == 0, 0.0, share)
    return np.where(np.abs(fa) <= np.abs(fb), a, b)
