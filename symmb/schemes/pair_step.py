"""One step of the Dormand-Prince pair with its interpolant, for lanes that each take steps of their own."""

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.schemes import dop853


def pair_step(rates: ca.Function) -> ca.Function:
    """(x, p, t, h) -> x at t + h, error estimates of orders 3 and 5, coefficients (n_x, 7) for `interpolated`.

    Parameters
    ----------
    rates : Function         (x (n_x,), p, t) -> x'
    """
    x, p = ca.MX.sym("x", rates.numel_in(0)), ca.MX.sym("p", rates.numel_in(1))
    t, h = ca.MX.sym("t"), ca.MX.sym("h")
    k: list[ca.MX] = []

    def total(weights: dict[int, float]) -> ca.MX:
        return sum((weight * k[j] for j, weight in weights.items()), ca.MX.zeros(x.shape))

    for row, c in zip(dop853.A, dop853.C, strict=True):
        k.append(rates(x + h * total(row), p, t + c * h))
    d = h * total(dop853.B)
    first, last = h * k[0], h * k[12]
    F = [d, first - d, 2 * d - last - first, *(h * total(row) for row in dop853.D)]
    errors = [h * total(weights) for weights in dop853.E]
    return ca.Function("step", [x, p, t, h], [x + d, *errors, ca.horzcat(*F)])


def interpolated(x: Array, F: Array, theta: Array) -> Array:
    """States (N, n_x) at shares theta (N,) of steps from x (N, n_x), F (N, n_x, 7)."""
    s = theta[:, None]
    r, f = 1 - s, np.moveaxis(F, 2, 0)
    return x + s * (f[0] + r * (f[1] + s * (f[2] + r * (f[3] + s * (f[4] + r * (f[5] + s * f[6]))))))


def error_norm(x: Array, x_new: Array, e3: Array, e5: Array, rtol: float, atol: float) -> Array:
    """The norm of Hairer's DOP853 (N,); inf where a state is not finite."""
    scale = 1.0 / (atol + rtol * np.maximum(np.abs(x), np.abs(x_new)))
    sum3, sum5 = (np.square(e * scale).sum(axis=1) for e in (e3, e5))
    denominator = sum5 + 0.01 * sum3
    norm = sum5 / np.sqrt(np.where(denominator > 0, denominator, 1.0) * x.shape[1])
    return np.where(np.isfinite(norm) & np.isfinite(x_new).all(axis=1), norm, np.inf)
