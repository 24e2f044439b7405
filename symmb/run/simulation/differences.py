"""Taylor coefficients of runs with respect to parameters, from differences of runs. Events may happen in the runs."""

import numpy as np

from symmb._errors import SimulationError
from symmb._types import Array
from symmb.connect import Simulator

_LARGEST, _RATIO, _LEVELS, _TERMS = 0.1, 4.0, 8, 3
"""Largest step, divided by a direction. Ratio of successive steps. Number of steps, and of steps for one polynomial.
With larger steps, more events pass an output time within a step. Smaller steps magnify the errors of runs."""
HIGHEST_OF_DIFFERENCES = _TERMS
"""Highest order of Taylor coefficients from differences. Rounding errors spoil higher orders."""


def differences(simulator: Simulator, p: Array, directions: Array, order: int = 1) -> tuple[Array, Array]:
    """Taylor coefficients of the outputs along directions (m, d) at p (d,), and their estimated errors.

    Both arrays are (order + 1, m, n_t, n_y), with an order up to `HIGHEST_OF_DIFFERENCES`. Errors are large at times
    at which an output has a kink or jump with respect to the parameters. The first coefficient is then a slope on the
    side of the run at p.

    Each direction takes 16 runs, at p + h u and p - h u with eight steps h. Three successive steps give a polynomial.
    Events of the motion move with the parameters. So an output jumps within a step if an event passes the output time.
    Smaller steps do not contain the event. Therefore each output and time takes the three polynomials that agree best.

    Raises
    ------
    SimulationError
        If the run at p fails, or too many of the other runs
    """
    h = _LARGEST * _RATIO ** -np.arange(_LEVELS, dtype=float)
    steps = np.concatenate([h, -h])[:, None, None] * directions
    # The errors of differences are the errors of runs, divided by the steps.
    samples = getattr(simulator, "tighter", lambda: simulator)().run(
        np.concatenate([p[None], (p + steps).reshape(-1, len(p))])
    )
    at_p, (ahead, behind) = samples.Y[0], samples.Y[1:].reshape(2, _LEVELS, len(directions), *samples.Y.shape[1:])
    coefficients = np.empty((order + 1, len(directions), *at_p.shape))
    errors = np.zeros_like(coefficients)
    coefficients[0], size = at_p, h[:, None, None, None]
    with np.errstate(invalid="ignore"):
        # Odd and even parts, divided by h and h^2, are polynomials in h^2.
        parts = (ahead - behind) / (2 * size), ((ahead + behind) / 2 - at_p) / np.square(size)
        for k in range(1, order + 1):
            estimates = _polynomials(parts[(k - 1) % 2], np.square(h), (k - 1) // 2)
            coefficients[k], errors[k] = _agreed(estimates, 3 if k == 1 else 2)  # smaller steps spoil higher orders
        for one_sided in ((ahead - at_p) / size, (at_p - behind) / size):
            slope, error = _agreed(_polynomials(one_sided, h, 0), 3)
            coefficients[1] = np.where(error < errors[1], slope, coefficients[1])
            errors[1] = np.minimum(errors[1], error)
        coefficients[np.abs(coefficients) <= errors] = 0.0  # noise, for example of an output that is constant
        # At a kink with respect to a parameter, the even part is proportional to h.
        errors[1] = np.fmax(errors[1], np.fmin.reduce(np.abs(parts[1]) * size, axis=0))
    if not np.isfinite(coefficients).all():
        raise SimulationError(f"A run for a derivative fails: {samples.messages[0] if samples.messages else 'nan'}.")
    return coefficients, errors


def _polynomials(values: Array, x: Array, power: int) -> Array:
    """The coefficients of x^power in polynomials through values (_LEVELS, ...) at each _TERMS successive points x."""
    windows = np.lib.stride_tricks.sliding_window_view(values, _TERMS, axis=0)
    of_values = np.linalg.inv(np.vander(x[:_TERMS] / x[0], increasing=True))[power]
    scale = x[: len(windows)] ** -float(power)
    return (windows @ of_values) * scale.reshape(-1, *[1] * (values.ndim - 1))


def _agreed(estimates: Array, number: int) -> tuple[Array, Array]:
    """The best of estimates (n, ...), and its error (...), from two or three successive estimates that differ least.

    Of two estimates, the first is the result; of three, the middle one. The error is their largest difference.
    """
    gaps = np.abs(np.diff(estimates, axis=0))
    if number == 3:
        estimates, gaps = estimates[1:], np.maximum(gaps[1:], gaps[:-1])
    gaps = np.where(np.isfinite(gaps), gaps, np.inf)
    best = gaps.argmin(axis=0)[None]
    value, least = (np.take_along_axis(each, best, axis=0)[0] for each in (estimates, gaps))
    return value, least
