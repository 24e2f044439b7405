"""Passes of switches: in a short time window, motions for all parameters pass one switch, or several at once.

The time from the start t of a window to the pass is approximately a polynomial tau(p). In scaled time, the old
equations lead from t to the surface of the switch for all parameters at once. The new equations then lead back to t.
From these states at t, the new equations continue as if they had always been valid. The time between tau and the true
pass is at most |g| / |dg/dt|. The error of the states is at most the product of this time and the difference of the
rates on both sides of the switch.

Source: Filippov (1988), Differential Equations with Discontinuous Righthand Sides, section 10, transversal passes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations, product
from operator import mul

import casadi as ca
import numpy as np

from symmb._magnitudes import SMALL
from symmb._types import Array, Indices
from symmb.declare.symbolic import common
from symmb.prove import discs
from symmb.prove.ellipses import reaches
from symmb.prove.errors import ProofError
from symmb.prove.flow import motion
from symmb.prove.front import Front
from symmb.prove.patches import cosh_powers
from symmb.prove.points import PLAIN, plain
from symmb.prove.problem import Phase, Problem
from symmb.prove.rounding import ERROR_OF_MODULI, LARGEST_ZERO, U, above
from symmb.prove.start import constant_step, require_known
from symmb.prove.step import MOST_CANDIDATES, on_motion
from symmb.prove.tape import Tape
from symmb.prove.terms import exponents, grid
from symmb.prove.time_step import TimeStep

_MOST_SWITCHES_AT_ONCE = 4
"""Largest number of switches that are passed at once. Each switch doubles the number of equations during passes."""
_STEPS_TO_PASS, _TIMES_OF_STEP, _NEWTON_STEPS = 16, 33, 8
"""Steps in which all parameters must pass; times of a step at which signs are compared; Newton steps after the secant.
If a pass and a return between two of the times are missed, the later proof of the conditions fails."""
_TIME_LEFT = 1 / 64
"""A step that ends closer to a pass leaves this fraction of the time to the pass. It must exceed a unit of times."""
_UNDERFLOW, _ROUNDING_OF_TIME = 1e-280, 1e-14
"""A number larger than the summand in `above`, to prove exact passes; 90 rounding errors of a scaled time of 1."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """A pass after a front.

    Attributes
    ----------
    which : numbers of the switches
    tau : (N + 1, ...) coefficients of the time from the front to the pass
    first, last : bounds of this time [s]
    place : the state (n,), the parameters (n_p,) and the time of one pass
    why : reason why the pass cannot be proved; empty if there is none
    """

    which: tuple[int, ...]
    tau: Array
    first: float
    last: float
    place: tuple[Array, Array, float] | None = None
    why: str = ""

    def nearer(self, unit: float) -> float:
        """Length of a step that ends closer to the pass [s], as a multiple of `unit`; 0 if the pass is too close."""
        return float(np.floor((1 - _TIME_LEFT) * self.first / unit)) * unit if _TIME_LEFT * self.first > unit else 0.0


def crossing(problem: Problem, x: Array, t0: float, h: float, terms: int, same: float) -> Crossing | None:
    """The next pass, if a motion (n, K + 1, N + 1, ...) leaves the sides of its phase in a step h; otherwise None.

    Parameters
    ----------
    terms : number of terms of the motions over further steps
    same : largest time between passes that count as simultaneous [s]
    """
    assert problem.valid is not None and problem.phase is not None
    at = grid(problem, x.shape[2:], 2)
    p = [np.broadcast_to(a, at.shape).ravel() for a in at.parameters(0)]
    tape, nodes = Tape(with_slopes(problem.valid, problem.rates)), int(np.prod(at.shape))
    found = np.full((problem.valid.numel_out(0), nodes), np.inf)
    states, begin = np.zeros((problem.n, nodes)), t0
    for number in range(_STEPS_TO_PASS):
        _look(tape, at.at(x).reshape(*x.shape[:2], nodes), p, begin, h, found, states)
        if number == 0 and np.isinf(found).all():
            return None
        if np.isfinite(found.min(axis=0)).all():
            break
        begin, x = begin + h, motion(problem, x.sum(axis=1), begin + h, h, terms).c
    else:
        return _refused(found - t0, "for a part of the box, the sign does not change within the next steps")
    earliest = found.min(axis=0)
    which = np.flatnonzero((found - earliest <= same).all(axis=1))
    if not 0 < len(which) <= _MOST_SWITCHES_AT_ONCE:
        return _refused(found - t0, "signs of other switches may change at about the same time")
    tau = at.fit((found[which[0]] - t0).reshape(at.shape))
    place = states[:, 0], np.array([a[0] for a in p]), float(earliest[0])
    middle, reach = float(tau.flat[0]), reach_of(problem, tau)
    return Crossing(tuple(which.tolist()), tau, middle - reach, middle + reach, place)


def _look(tape: Tape, c: Array, p: list[Array], begin: float, h: float, found: Array, states: Array) -> None:
    """Write times (m, P) at which conditions become negative in a step to `found`, and states (n, P) to `states`.

    The states belong to the first of these times. The motion has the coefficients c (n, K + 1, P).
    """

    def at(s: Array, which: Indices | slice = slice(None)) -> tuple[Array, list[list[Array]]]:
        """States (n, ..., P) at times s (..., P) of the step, conditions there, and their slopes."""
        T = np.cos(np.arange(c.shape[1]) * np.arccos(np.clip(s, -1.0, 1.0))[..., None])
        x = np.einsum("nkp,...pk->n...p", c[..., which], T)
        time = begin + 0.5 * h * (1.0 + s)
        found = tape.run(PLAIN, plain, [list(x), [own[which] for own in p], [time]])
        return x, [[np.broadcast_to(a, s.shape) for a in part] for part in found]

    s = -np.cos(np.linspace(0.0, np.pi, _TIMES_OF_STEP))
    values = at(np.broadcast_to(s[:, None], (len(s), c.shape[2])))[1][0]
    for k, value in enumerate(values):
        beyond = ~(value > 0)
        own = np.flatnonzero(beyond.any(axis=0) & np.isinf(found[k]))
        if not len(own):
            continue
        after = beyond.argmax(axis=0)[own]
        before = np.maximum(after - 1, 0)
        a, b = value[before, own], value[after, own]
        with np.errstate(all="ignore"):
            root = s[before] + np.where(a > b, a / (a - b), 0.0) * (s[after] - s[before])
            for _ in range(_NEWTON_STEPS):  # from the secant
                _, (g, slope) = at(root, own)
                root = np.clip(np.nan_to_num(root - 2.0 / h * g[k] / slope[k]), s[before], s[after])
        time = begin + 0.5 * h * (1.0 + root)
        is_first = time < found[:, own].min(axis=0)
        states[:, own[is_first]] = at(root, own)[0][:, is_first]
        found[k, own] = time


def _refused(times: Array, why: str) -> Crossing:
    """A pass that cannot be proved, at the first of the times (m, P)."""
    first = float(times.min())
    return Crossing((int(times.min(axis=1).argmin()),), np.array(first), first, first, None, why)


def reach_of(problem: Problem, tau: Array) -> float:
    """A bound of the distance of a polynomial from its constant term, including rounding errors of the parameters."""
    errors = np.broadcast_to(problem.errors, problem.middle.shape)
    rho = []
    for j in range(problem.d):
        k = problem.variables.index(j)
        excess = float(above(errors[k] / problem.radius[k]) + 8 * U)
        rho.append(1.0 + excess + np.sqrt(excess * (2.0 + excess)))  # an ellipse around [-1 - excess, 1 + excess]
    own = exponents(problem, tau.shape)
    sizes = [cosh_powers(r, int(own.max(initial=0)) + 1)[own[:, j]] for j, r in enumerate(rho)]
    return float(above((np.abs(tau).ravel() * np.prod(sizes, axis=0))[1:].sum())) if problem.d else 0.0


def with_slopes(g: ca.Function, rates: ca.Function) -> ca.Function:
    """(x, p, t) -> g, and the time derivative of g along the rates."""
    x, p, t = arguments = rates.sx_in()
    value = ca.densify(g(x, p, t))
    along = ca.jtimes(value, ca.vertcat(x, t), ca.vertcat(rates(x, p, t), 1))
    return common("slopes", arguments, [value, ca.densify(along)])


@dataclass(frozen=True, eq=False)
class Window:
    """Equations on both sides of switches that are passed at once.

    Attributes
    ----------
    old, new : the problems on both sides. They are valid as long as no other switch is passed, and these switches are
               passed only in this direction
    between : (x, p, t) -> rates, and (x, p, t) -> conditions, on all combinations of sides
    surface : (x, p, t) -> (m,), positive before the passes, and 0 at the passes
    sides : sides of all switches after the passes
    """

    old: Problem
    new: Problem
    between: tuple[tuple[ca.Function, ca.Function], ...]
    surface: ca.Function
    sides: Array


def _on_all_sides(phase: Phase, which: Sequence[int]) -> Iterator[tuple[tuple[float, ...], Array]]:
    """Signs of some switches relative to their present sides, and sides of all switches, for all combinations."""
    for signs in product((1.0, -1.0), repeat=len(which)):
        sides = phase.sides.copy()
        sides[list(which)] *= signs
        yield signs, sides


def window(problem: Problem, ahead: Crossing) -> Window:
    """The equations near a pass. ProofError if a switch depends on another one that is passed at once."""
    phase, which = problem.phase, list(ahead.which)
    assert phase is not None and problem.valid is not None and ahead.place is not None
    x, p, t = arguments = problem.rates.sx_in()
    surface = common("surface", arguments, [problem.valid(x, p, t)[which]])
    others = np.setdiff1d(np.arange(len(phase.sides)), which).tolist()
    found, changed = [], np.zeros(len(phase.sides), dtype=bool)
    for signs, sides in _on_all_sides(phase, which):
        if min(signs) < 0:
            sides = phase.settled(*ahead.place, sides, ahead.which)
        rates, place = phase.on(phase.rates, sides, *ahead.place), ahead.place
        if max(signs) < 0:  # after all passes: a table may have another piece shortly later
            place = _moved(rates, place, SMALL * ahead.first)
        conditions = phase.conditions(sides, *place)
        toward = ca.vertcat(
            with_slopes(conditions, rates)(x, p, t)[1][which] if max(signs) < 0 else ca.SX(0, 1),
            -with_slopes(surface, rates)(x, p, t)[1],
        )
        values = ca.vertsplit(conditions(x, p, t))
        valid = ca.vertcat(*(values[k] for k in others), toward)
        found.append((sides, rates, common("valid", arguments, [ca.densify(valid)])))
        require_known("the equations", *found[-1][1:])
        changed |= sides != phase.sides
    sides = ca.SX.sym("sides", len(changed))
    own = phase.switches(x, p, t, sides)[which]
    if ca.depends_on(own, sides[np.flatnonzero(changed).tolist()]):
        raise ProofError("this value depends on the side of another switch whose sign changes at the same time")
    (_, _, of_old), (new, _, of_new) = found[0], found[-1]
    after = problem.on_sides(new, *ahead.place)
    return Window(
        replace(problem, phase=None, valid=of_old, change=None),
        replace(after, phase=None, valid=of_new, change=None),
        tuple((rates, valid) for _, rates, valid in found),
        surface,
        new,
    )


def departure(
    problem: Problem, front: Front, own: Sequence[int], h: float
) -> tuple[Problem, Problem, tuple[Problem, ...]]:
    """The problems of a motion that starts on the switches `own`, perhaps also on others, and leaves them at once.

    The first problem is valid in the first step of about h, as long as the rates of the switches are positive on their
    sides. The second problem follows. The third value contains problems on all combinations of sides. ProofError if the
    switches are not 0 for all parameters of the box, or if the motion may leave them in two directions.
    """
    phase = problem.phase
    assert phase is not None and problem.valid is not None and problem.valid_tape is not None
    x, p, t = arguments = problem.rates.sx_in()
    begin = constant_step(problem, front.t, front.x, 0.0)
    which = np.flatnonzero(reaches(on_motion(begin, problem.valid_tape, front.reach, (1, 1))) <= LARGEST_ZERO).tolist()
    if not set(own) <= set(which) or len(which) > _MOST_SWITCHES_AT_ONCE:
        raise ProofError("its value may be 0 when the motion begins")
    place = front.middle, problem.middle, front.t
    later = _moved(problem.rates, place, SMALL * h)  # tables may have other pieces shortly later
    both, left = [], []
    for _, sides in _on_all_sides(phase, which):
        both.append(problem.on_sides(phase.settled(*place, sides, tuple(which)), *later))
        rates = with_slopes(both[-1].valid, both[-1].rates)
        if (rates(*place)[1].full().ravel()[which] > 0).all():
            left.append((both[-1], rates))
    if len(left) != 1:
        raise ProofError("its value may be 0 when the motion begins")
    [(after, rates)] = left
    values, slopes = rates(x, p, t)
    conditions = [(slopes if k in which else values)[k] for k in range(len(phase.sides))]
    valid = common("valid", arguments, [ca.densify(ca.vertcat(*conditions))])
    require_known("the equations", *(f for own in both for f in (own.rates, own.outputs)), valid)
    return replace(after, phase=None, valid=valid), after, tuple(both)


def _moved(rates: ca.Function, place: tuple[Array, Array, float], h: float) -> tuple[Array, Array, float]:
    """Approximately the state, the parameters and the time after a short time h [s]."""
    x, p, t = place
    return x + h * rates(*place).full().ravel(), p, t + h


class Scaled:
    """Functions (x, p, t) as functions of a scaled time s, with t = begin + s tau(p)."""

    def __init__(self, problem: Problem, begin: float, tau: Array) -> None:
        self._n, self._p, self._begin = problem.n, ca.SX.sym("p", len(problem.middle)), begin
        powers = []
        degrees = exponents(problem, tau.shape)
        for j in range(problem.d):
            k = problem.variables.index(j)
            xi = (self._p[k] - problem.middle[k]) / problem.radius[k]
            T = [ca.SX(1), xi]
            while len(T) <= degrees.max():
                T.append(2 * xi * T[-1] - T[-2])
            powers.append(T)
        self._tau = ca.SX(0)
        for own, value in zip(degrees, tau.ravel(), strict=True):
            if value:
                self._tau += float(value) * reduce(mul, (powers[j][k] for j, k in enumerate(own)), ca.SX(1))

    def of(self, f: ca.Function, factor: float = 0.0, is_back: bool = False) -> ca.Function:
        """f in scaled time, or `factor` times f tau. With `is_back`, scaled time runs from the pass to the start."""
        x, s = ca.SX.sym("x", self._n), ca.SX.sym("s")
        value = f(x, self._p, self._begin + (1 - s if is_back else s) * self._tau)
        return common(f.name(), [x, self._p, s], [ca.densify(factor * self._tau * value if factor else value)])

    def problem(self, problem: Problem, outputs: ca.Function, is_back: bool = False) -> Problem:
        """A problem over the scaled time from 0 to 1."""
        regular = problem.regular and self.of(problem.regular, is_back=is_back)
        return replace(
            problem,
            rates=self.of(problem.rates, -1.0 if is_back else 1.0, is_back),
            outputs=self.of(outputs, is_back=is_back),
            regular=regular,
            valid=None,
            refused=(),
            times=np.ones(1),
        )


def pass_errors(
    problem: Problem, scaled: Scaled, front: Front, about: Window, first: float, g: Array
) -> tuple[float, Array]:
    """Bounds of the time between passes and the polynomial [s], and of the resulting errors (n,) of the states.

    `front` is the front of the old equations at the times of the polynomial. The switches are at most g (m,) there. All
    motions stay within a region around the front during this time. `problem` is the old problem in scaled time.
    `first` is a lower bound of the polynomial [s]. ProofError if the pass is not transversal on all sides.
    """
    tapes = [tuple(Tape(scaled.of(f)) for f in pair) for pair in about.between]
    delay, shift = 0.0, np.zeros(problem.n)
    for _ in range(MOST_CANDIDATES):
        delay, shift = 2.0 * delay + _UNDERFLOW, 2.0 * shift + _UNDERFLOW
        share = 2.0 * delay / first + _ROUNDING_OF_TIME
        around = constant_step(problem, 1.0 - share, front.x, 2.0 * share)
        slowest, fastest, speed, differences, is_proved = _about_pass(around, above(front.reach + shift), tapes, len(g))
        new_delay = above(float((g / slowest).max()))
        if len(g) > 1:  # after an early pass of one switch, the others may be approached more slowly
            new_delay = above(new_delay * (2.0 + float((fastest / slowest).max())))
        new_shift = above(4.0 * new_delay * speed)
        if not (np.isfinite(new_shift).all() and is_proved):
            break
        if new_delay < delay and (new_shift < shift).all():
            return delay, above((1.0 if len(g) == 1 else 2.0) * delay * differences)
        delay, shift = new_delay, new_shift
    raise ProofError("it may reach 0 tangentially")


def _about_pass(
    step: TimeStep, e: Array, tapes: Sequence[tuple[Tape, ...]], own: int
) -> tuple[Array, Array, Array, Array, bool]:
    """Bounds near a pass, on all sides of its switches.

    Return the slowest and the fastest rates (m,) at which the switches are approached. Further values are the largest
    rates (n,) of the states, the differences (n,) of rates between sides, and whether all conditions are proved.
    """
    d = max(step.problem.d, 1)
    count = next(m for m in (32, 8, 4, 2, 1) if m**d <= 64 or m == 1)  # about 64 patches at most
    each = [[on_motion(step, tape, e, (1, count)) for tape in pair] for pair in tapes]
    toward = [conditions[len(conditions) - own :] for _, conditions in each]
    subtract = discs.OPERATIONS[ca.OP_SUB]
    differences = [reaches([*map(subtract, a, b)]) for (a, _), (b, _) in combinations(each, 2)]
    return (
        np.min([[_least(a) for a in part] for part in toward], axis=0),
        np.max([reaches(part) for part in toward], axis=0),
        np.max([reaches(rates) for rates, _ in each], axis=0),
        np.max(differences, axis=0),
        all(discs.is_positive(a) for _, conditions in each for a in conditions),
    )


def _least(a: discs.Disc) -> float:
    """A lower bound of positive real numbers."""
    return float((np.real(a.centre) - a.swing * (1.0 + ERROR_OF_MODULI)).min()) * (1.0 - ERROR_OF_MODULI)
