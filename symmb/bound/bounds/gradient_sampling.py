"""Local search along creases: the largest value of the minimum of several smooth functions, over the unit box."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import linprog

from symmb._types import Array
from symmb.bound.bounds.direct_search import Found

RADII, STEPS = (0.5, 0.25, 0.12, 0.06), 12
"""Distances from the best place within which gradients are sampled, and the largest number of steps. After a step
without a gain, the next distance is used."""
POINTS = 5
"""Number of gradients of a step. Five random points are on both sides of a crease with a probability of 15/16."""
LENGTHS = (2.0, 1.0, 0.5, 0.25)
"""Largest steps, divided by the radius. Gradients are less valid at longer distances."""
DIFFERENCE = 1e-3
"""Distance of the differences that approximate gradients. Errors of 1e-6 of values cause errors of 1e-3 of
gradients."""


def gradient_sampling(f: Callable[[Array], Array], x: Array, fx: float, sufficient: float, enough: float) -> Found:
    """Search for the largest value of f from a place x (d,) at which polls stop, because f has a crease there.

    For instance, the smallest maximum over time of a response with two peaks is at a crease, where both peaks are
    equal. Each step takes gradients at random points around the best place, so that all smooth pieces of f are sampled.
    Linear programs then maximise the minimum of the linearised pieces within several distances. (Burke, Lewis, Overton
    2005, A robust gradient sampling algorithm for nonsmooth, nonconvex optimization)

    Parameters
    ----------
    f : values (N,) at points (N, d), minus infinity if there is no value
    sufficient : smallest gain of a step at which the distances stay the same
    enough : value above which the search ends
    """
    d, rng, gain, radii = len(x), np.random.default_rng(0), np.inf, list(RADII)
    for _ in range(STEPS):
        # The place itself is often on the crease, where differences mix the pieces.
        points = np.clip(x + radii[0] * rng.uniform(-1.0, 1.0, (POINTS, d)), -1.0, 1.0)
        values, gradients = _gradients(f, points)
        pieces = np.isfinite(values) & np.isfinite(gradients).all(axis=1)
        if not pieces.any():
            break
        known = points[pieces], values[pieces], gradients[pieces]
        steps = np.stack([_largest_of_least(x, *known, length * radii[0]) for length in LENGTHS])
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
    """The place (d,) of the box, at most `length` from x, at which the minimum of linear pieces is largest."""
    d = len(x)
    rows = np.column_stack([-gradients, np.ones(len(points))])  # t <= value + gradient (y - point)
    right = values - (gradients * points).sum(axis=1)
    sides = np.column_stack([np.maximum(x - length, -1.0), np.minimum(x + length, 1.0)])
    found = linprog(-np.eye(d + 1)[d], A_ub=rows, b_ub=right, bounds=[*sides, (None, None)])
    return x if found.x is None else np.clip(found.x[:d], -1.0, 1.0)
