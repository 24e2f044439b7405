"""The choice of ellipses around the box, on which the equations are bounded, and of nodes for interpolations.

Large ellipses make coefficients small that are cut, but bounds large. Any choice gives a proof.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symmb._types import Array
from symmb.enclosures import discs
from symmb.enclosures.curves import Step
from symmb.enclosures.errors import ProofError
from symmb.enclosures.patches import Patches, largest_on


@dataclass
class Control:
    """What is adapted from step to step.

    Attributes
    ----------
    spread : how far states move on the ellipses of time and of the parameters, over their room
    wanted : size of the defects of the last step, to which errors of their interpolation are compared
    turn : which ellipses are compared next
    """

    spread: tuple[float, float] = (0.5, 0.5)
    wanted: float = 1e-12
    turn: int = 0


def ellipses(step: Step, spread: tuple[float, float]) -> list[float]:
    """Parameters of ellipses on which states and parameters move from their means by a share of their sizes."""
    problem = step.problem
    rows = np.abs(step.x.c) / step.room[(slice(None), *(None,) * (step.x.c.ndim - 1))]
    if problem.d:  # parameters are linear polynomials of their variables
        own = np.zeros((problem.d, *rows.shape[1:]))
        for middle, radius, j in zip(problem.middle, problem.radius, problem.variables, strict=True):
            if j >= 0:
                place = (j, 0, *(int(i == j) for i in range(problem.d)))
                own[place] = _STIFFER * radius / max(abs(middle), radius)
        rows = np.concatenate([rows, own])
    rows[(slice(None), *(0,) * (rows.ndim - 1))] = 0.0
    rho = []
    for axis in range(1, rows.ndim):
        c = rows.sum(axis=tuple(i for i in range(1, rows.ndim) if i != axis))
        c[:, 0] = 0.0
        allowed = spread[0 if axis == 1 else 1]
        rho.append(_least_above(lambda r, c=c, most=allowed: largest_on([r], c).max(initial=0.0) <= most, _MOST))
    allowed = sum(spread)
    share = _least_above(lambda r: largest_on([max(s ** (r - 1.0), _LEAST) for s in rho], rows).max() <= allowed, 2.0)
    return [max(r ** (share - 1.0), _LEAST) for r in rho]


def _least_above(holds: Callable[[float], bool], top: float) -> float:
    """About the largest number between 1 and `top` for which a condition holds."""
    low, high = 1.0, top
    if holds(top):
        return top
    for _ in range(20):
        middle = 0.5 * (low + high) if high < 3.0 else math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


_STIFFER = 3.0
"""How much less parameters may move than states."""
_LEAST, _MOST = 1.02, 30.0
"""Ellipses that are tried. With parameter 30 an interpolation in 12 nodes errs by 1e-17."""
PATCHES = 14
"""Patches in each variable: discs are then half as large as a motion that spreads over the whole ellipse."""


def reaches(found: list[discs.Disc]) -> Array:
    """Largest moduli of discs, (m,)."""
    return np.array([float(discs.reach(a).max()) for a in found])


def _on_ellipses(step: Step, rho: list[float]) -> tuple[Array, Array]:
    """Bounds of f (n,) and of its Jacobian (n, n) on a polyellipse."""
    n = step.problem.n
    patches = Patches(rho, [PATCHES] * len(rho), step.degrees)
    rates, slopes = step.problem.jacobian_tape.run(discs.OPERATIONS, discs.disc, step.on_patches(patches))
    return reaches(rates), reaches(slopes).reshape(n, n).T


def adapted(step: Step, control: Control) -> tuple[list[float], Array, Array]:
    """Ellipses, with bounds of f and of its Jacobian there.

    Those of the last step are compared with larger or smaller ones, of which the fewest nodes suffice for a defect.

    Raises
    ------
    ProofError         if the equations cannot be shown to be analytic in any of them
    """

    def tried(spread: tuple[float, float]) -> tuple[float, tuple[float, float], list[float], Array, Array]:
        rho = ellipses(step, spread)
        rates, slopes = _on_ellipses(step, rho)
        if not (np.isfinite(rates).all() and np.isfinite(slopes).all()):
            return np.inf, spread, rho, rates, slopes
        most = rates + largest_on(rho, step.x.rate)
        return _nodes_needed(rho, control.wanted / float(most.max())), spread, rho, rates, slopes

    best = tried(control.spread)
    for _ in range(_NARROWINGS):
        if np.isfinite(best[0]):
            break
        control.spread = (0.6 * control.spread[0], 0.6 * control.spread[1])
        best = tried(control.spread)
    else:
        raise ProofError("the equations cannot be shown to be smooth over the box")
    for _ in range(_COMPARED):
        control.turn = (control.turn + 1) % 4
        factor = (1.4, 1 / 1.4)[control.turn // 2]
        a, b = control.spread
        other = tried((a * factor, b) if control.turn % 2 else (a, b * factor))
        best = min(best, other, key=lambda found: found[0])
        control.spread = best[1]
    return best[2], best[3], best[4]


def _nodes_needed(rho: list[float], ratio: float) -> float:
    """About the nodes of a grid with which the aliasing is a given share of the bound on the polyellipse."""
    return math.prod(max(1.0, m) for m in _wanted(rho, ratio))


_NARROWINGS = 10
"""Smaller ellipses that are tried where the equations cannot be shown to be analytic."""
_COMPARED = 2
"""Other ellipses that are compared in a step."""


def node_counts(rho: list[float], ratio: float, most: tuple[int, ...]) -> tuple[int, ...]:
    """Nodes with which the aliasing is about a given share of the bound on the polyellipse."""
    return tuple(int(min(top, max(2, math.ceil(m)))) for m, top in zip(_wanted(rho, ratio), most, strict=True))


def _wanted(rho: list[float], ratio: float) -> list[float]:
    product = math.prod(1.0 + 2.0 / (r - 1.0) for r in rho)
    return [math.log(4.0 * len(rho) * product / (1.0 - 1.0 / r) / max(ratio, 1e-30)) / math.log(r) for r in rho]
