"""The choice of ellipses around the box for bounds of the equations, and of nodes for interpolations.

On larger ellipses bounds are larger, but bounds of neglected coefficients are smaller. Any choice gives a valid proof.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from symmb._types import Array, Mask
from symmb.prove import discs
from symmb.prove.errors import not_smooth
from symmb.prove.patches import largest_on
from symmb.prove.time_step import TimeStep


@dataclass(frozen=True)
class Choice:
    """Distances by which ellipses of time and of parameters move states, relative to `TimeStep.room`; and patches."""

    spread: tuple[float, float] = (0.5, 0.5)
    patches: tuple[int, int] = (8, 1)

    def turned(self, turn: int) -> "Choice":
        """The neighbour of this choice with the number `turn` modulo 8."""
        factor = 1.4 if turn % 2 else 1 / 1.4
        which = turn // 2 % 4
        (a, b), (k, m) = self.spread, self.patches
        if which == 0:
            return replace(self, spread=(a * factor, b))
        if which == 1:
            return replace(self, spread=(a, b * factor))
        if which == 2:
            return replace(self, patches=(_bounded(max(4.0, k * factor + 2 * (turn % 2))), m))
        return replace(self, patches=(k, _bounded(m * factor + 2 * (turn % 2))))


def _bounded(count: float) -> int:
    """The nearest allowed number of patches: 1, or 4 to 40. Two or three patches are not better than one."""
    return 1 if count < 3 else min(max(round(count), 4), 40)


@dataclass
class Control:
    """Settings that are adapted from step to step.

    Attributes
    ----------
    choice : ellipses and patches
    h : length of the next step [s]
    wanted : size of the defects of the last step, for comparison with errors of interpolation
    turn : number of the choice that is compared next
    rho : ellipse of time, for several parameters
    rough : outputs (n_y,) that the last step could not show to be smooth with any number of patches
    lost : number of attempts at steps beyond twice those that the motion needs; 0 if steps are long enough. It is
        infinite if the remainder is large at the start
    """

    choice: Choice
    h: float
    wanted: float = 1e-9
    turn: int = 0
    rho: float = 2.0
    rough: Mask | bool = False
    lost: float = 0.0


def ellipses(step: TimeStep, spread: tuple[float, float]) -> list[float]:
    """Parameters rho of ellipses. They move the states farther than the box does, by up to `spread` times `room`."""
    problem = step.problem
    rows = np.abs(step.x.c) / step.room[(slice(None), *(None,) * (step.x.c.ndim - 1))]
    if problem.d:  # parameters are linear polynomials of their variables
        own = np.zeros((problem.d, *rows.shape[1:]))
        for middle, radius, j in zip(problem.middle, problem.radius, problem.variables, strict=True):
            if j >= 0:
                place = (j, 0, *(int(i == j) for i in range(problem.d)))
                # parameters may move three times less than states
                own[place] = 3.0 * radius / max(abs(middle), radius)
        rows = np.concatenate([rows, own])
    rows[(slice(None), *(0,) * (rows.ndim - 1))] = 0.0
    rho = []
    for axis in range(1, rows.ndim):
        c = rows.sum(axis=tuple(i for i in range(1, rows.ndim) if i != axis))
        c[:, 0] = 0.0
        own, most = c.sum(axis=1), spread[0 if axis == 1 else 1]
        rho.append(
            _largest_below(lambda r, c=c, own=own, most=most: bool((largest_on([r], c) - own).max(initial=0.0) <= most))
        )
    own, allowed = rows.sum(axis=tuple(range(1, rows.ndim))), sum(spread)
    # together the ellipses move the states farther than each one alone, so all shrink by a common exponent
    share = _largest_below(
        lambda r: bool(
            (largest_on([max(s ** (r - 1.0), THINNEST) for s in rho], rows) - own).max(initial=0.0) <= allowed
        ),
        2.0,
    )
    return [max(r ** (share - 1.0), THINNEST) for r in rho]


def _largest_below(holds: Callable[[float], bool], top: float = 1000.0) -> float:
    """Approximately the largest number between 1 and `top` for which a condition holds.

    On an ellipse with the parameter 1000, an interpolation in six nodes has an error of 1e-18.
    """
    low, high = 1.0, top
    if holds(top):
        return top
    for _ in range(20):
        middle = 0.5 * (low + high) if high < 3.0 else math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


THINNEST = 1.02
"""Smallest parameter of an ellipse. Thinner ellipses need a thousand nodes, as aliasing decreases with rho^-nodes."""


def reaches(found: list[discs.Disc]) -> Array:
    """Largest moduli (m,) of discs."""
    return np.array([float(discs.reach(a).max()) for a in found])


@dataclass(frozen=True)
class Tried:
    """Ellipses, bounds of f (n,) and of its Jacobian (n, n) on them, the nodes that they need, and their cost.

    Nodes and cost are infinite if the equations have no bounds on the ellipses.
    """

    rho: list[float]
    rates: Array
    slopes: Array
    nodes: float = np.inf
    cost: float = np.inf
    choice: Choice = Choice()


def adapted(step: TimeStep, control: Control) -> Tried:
    """Ellipses and patches, with bounds of the equations on them.

    The ellipses of the last step are compared with others, and the cheapest ones are used. ProofError if the equations
    cannot be shown to be analytic on any ellipses.
    """
    best = _first(step, control)
    # two other choices are compared in a step, and up to 16 if very many nodes are needed
    for trial in range(16):
        if trial >= 2 and best.nodes <= 1e5:
            break
        control.turn += 1
        other = _tried(step, best.choice.turned(control.turn), control.wanted)
        best = min(best, other, key=lambda found: found.cost)
    control.choice = best.choice
    return best


def _first(step: TimeStep, control: Control) -> Tried:
    """The ellipses of the last step, or the largest ones that make the equations analytic with the fewest patches."""
    choice = control.choice
    # the ellipses are halved up to eight times until the equations are analytic on them
    for narrowing in range(8):
        # with smaller ellipses, more patches of each parameter are tried
        for count in sorted({choice.patches[1], *(1, 8, 24)[: 1 + narrowing // 2]}):
            found = _tried(step, replace(choice, patches=(choice.patches[0], count)), control.wanted)
            if np.isfinite(found.cost):
                return found
        choice = replace(choice, spread=(0.5 * choice.spread[0], 0.5 * choice.spread[1]))
    inputs = step.on_patches((choice.patches[0], 1), rho=ellipses(step, choice.spread))
    tape = step.problem.jacobian_tape
    raise not_smooth(tape.first(discs.OPERATIONS, discs.disc, inputs, lambda a: not np.isfinite(discs.reach(a)).all()))


def _tried(step: TimeStep, choice: Choice, wanted: float) -> Tried:
    """The ellipses of a choice."""
    n, rho = step.problem.n, ellipses(step, choice.spread)
    count = choice.patches[0] * float(choice.patches[1]) ** step.problem.d
    if count > MOST_PATCHES:
        return Tried(rho, np.empty(0), np.empty(0), choice=choice)
    rates, slopes = map(reaches, step.discs_of(step.problem.jacobian_tape, choice.patches, rho=rho))
    nodes = nodes_of_defect(step, rho, rates, slopes, wanted)
    # a patch takes 20 times as long as a node: numbers are complex, and the Jacobian is computed too
    return Tried(rho, rates, slopes.reshape(n, n).T, nodes, nodes + 20.0 * count, choice)


def nodes_of_defect(step: TimeStep, rho: list[float], rates: Array, slopes: Array, wanted: float) -> float:
    """Nodes that reduce the aliasing of the defect to `wanted`; infinite if the bounds on the ellipses are infinite."""
    if not (np.isfinite(rates).all() and np.isfinite(slopes).all()):
        return np.inf
    return nodes_needed(rho, wanted / float((rates + largest_on(rho, step.x.rate)).max()))


MOST_PATCHES = 3e4
"""Largest number of patches of all variables. More patches take seconds. A step that needs more becomes shorter, or the
proof ends."""


def nodes_needed(rho: list[float], ratio: float) -> float:
    """Nodes of a grid that reduce the aliasing to about `ratio` times the bound on the polyellipse."""
    return math.prod(max(1.0, m) for m in _wanted(rho, ratio))


def node_counts(rho: list[float], ratio: float) -> tuple[int, ...]:
    """Nodes of each variable that reduce the aliasing to about `ratio` times the bound, but at most 300."""
    return tuple(int(min(300, max(2, math.ceil(m)))) for m in _wanted(rho, ratio))


def _wanted(rho: list[float], ratio: float) -> list[float]:
    """Nodes of each variable as real numbers. Variables with rho = 1 are left out: they have no nodes.

    Source: the bound of `chebyshev.aliasing`, solved for the nodes.
    """
    rho = [r for r in rho if r > 1.0]
    product = math.prod(1.0 + 2.0 / (r - 1.0) for r in rho)
    return [math.log(4.0 * len(rho) * product / (1.0 - 1.0 / r) / max(ratio, 1e-290)) / math.log(r) for r in rho]
