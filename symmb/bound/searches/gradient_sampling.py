"""Local search along creases: the largest value of the minimum of several smooth functions, over the unit box."""

from collections.abc import Callable

import numpy as np

from symmb._types import Array
from symmb.bound.searches.direct_search import Found

RADII, STEPS = (1.0, 1.0, 0.4, 0.4, 0.16, 0.16, 0.064, 0.064), 40
"""Distances from the best place within which gradients are sampled, and the largest number of steps. After a step
without a gain, the next distance is used. Each distance is used twice, because random points may miss a piece."""
POINTS = 4
"""Number of random points of a step. They are on both sides of a crease with a probability of 7/8."""
LENGTHS = (2.0, 1.0, 0.5, 0.25)
"""Largest steps, divided by the radius. Gradients are less valid at longer distances."""
DIFFERENCE = 1e-3
"""Step of the finite differences that approximate gradients. Errors of 1e-6 in values cause errors of 1e-3 in
gradients."""


def gradient_sampling(f: Callable[[Array], Array], x: Array, fx: float, sufficient: float, enough: float) -> Found:
    """Search for the largest value of f from a place x (d,) at which polls stop, because f has a crease there.

    The lowest peak of a response over time, for instance, is in a crease between two peaks. Each step takes gradients
    at random points around the best place. Each gradient gives a linear function, and f is about the smallest of these
    functions. Linear programs find where this smallest value is largest, within several distances.
    (Burke, Lewis, Overton 2005, A robust gradient sampling algorithm for nonsmooth, nonconvex optimization)

    Parameters
    ----------
    f : values (N,) at points (N, d), minus infinity if there is no value
    sufficient : if a step gains at most this value, the next of the RADII is used
    enough : value above which the search ends
    """
    d, rng, gain, radii = len(x), np.random.default_rng(0), np.inf, list(RADII)
    # Gradients are evaluated beside places that are often on a crease, because differences there would mix the pieces.
    shortest, beside = np.empty((0, d)), 0.02
    known = np.empty((0, d)), np.empty(0), np.empty((0, d))
    for _ in range(STEPS):
        radius = radii[0]
        around = [shortest + beside * radius * rng.uniform(-1.0, 1.0, shortest.shape)]
        around += [x + radius * rng.uniform(-1.0, 1.0, (POINTS, d))]
        points = np.clip(np.concatenate(around), -1.0, 1.0)
        values, gradients = _gradients(f, points)
        ok = np.isfinite(values) & np.isfinite(gradients).all(axis=1)
        new = points[ok], values[ok], gradients[ok]
        known = tuple(np.concatenate(both) for both in zip(known, new, strict=True))
        near = np.abs(known[0] - x).max(axis=1) <= 2 * radius
        if not near.any():
            break
        pieces = [part[near] for part in known]
        steps = np.stack([_largest_of_least(x, *pieces, length * radius) for length in LENGTHS])
        shortest = steps[-1:]  # if this step gains nothing, a piece is missing there
        points, values = np.concatenate([points, steps]), np.concatenate([values, f(steps)])
        best = int(values.argmax())
        gain = max(float(values[best]) - fx, 0.0)
        if gain > 0:
            x, fx = points[best], float(values[best])
        if fx > enough:
            return Found(x, fx, np.inf)
        if gain <= sufficient:
            radii.pop(0)
            if not radii:
                break
    return Found(x, fx, 2.0 * gain)


def _gradients(f: Callable[[Array], Array], points: Array) -> tuple[Array, Array]:
    """Values (n,) and gradients (n, d) of f at points (n, d), from differences into the box."""
    n, d = points.shape
    side = np.where(points > 0, -DIFFERENCE, DIFFERENCE)
    values = f(np.concatenate([points[:, None], points[:, None] + side[:, :, None] * np.eye(d)], axis=1).reshape(-1, d))
    values = values.reshape(n, d + 1)
    with np.errstate(invalid="ignore"):
        return values[:, 0], (values[:, 1:] - values[:, :1]) / side


def _largest_of_least(x: Array, points: Array, values: Array, gradients: Array, length: float) -> Array:
    """The point (d,) of the box, at most a length from x, at which the smallest of the linear functions is largest."""
    from scipy.optimize import linprog

    d = len(x)
    rows = np.column_stack([-gradients, np.ones(len(points))])  # t <= value + gradient (y - point)
    right = values - (gradients * points).sum(axis=1)
    sides = np.column_stack([np.maximum(x - length, -1.0), np.minimum(x + length, 1.0)])
    found = linprog(-np.eye(d + 1)[d], A_ub=rows, b_ub=right, bounds=[*sides, (None, None)])
    return x if found.x is None else np.clip(found.x[:d], -1.0, 1.0)
