"""Kinks, jumps and functions of time in equations of motion."""

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.declare.symbolic import (
    Branches,
    On,
    batch,
    branches,
    has_kinks,
    laws,
    margins,
    switching,
    with_common_expressions,
)
from symmb.equations.model import DAE
from symmb.run.events.time_switches import TimeSwitches

_LOOKS = 20_000
"""Number of equally spaced times at which functions of time are evaluated, in addition to the output times."""
_SUSPECTS, _HALVINGS = 20, 30
"""Number of intervals with the largest changes of a law of time, and number of bisections of each. Bisections show
whether the law jumps there."""
_CLEAR, _NEAR = 1e-6, 2e-4
"""A switch is clearly on one side if its value is above the first fraction of its largest value. The second number is
the largest error of the times of passes, divided by the horizon: twice the value in integrate/side_walk.py."""
_INPUTS = On.STATE, On.PARAMETERS, On.TIME


@dataclass(frozen=True)
class Kinks:
    """Kinks and jumps of forces, constraints and first-order rates, as far as they depend on the state or on time.

    Attributes
    ----------
    names : tuple of str     operations that have kinks or jumps
    switches                 (x, p, t) -> values (m,), which change their sign at the kinks and jumps
    on_state : (m,) bool     whether each switch depends on the state; other switches depend on time
    located : (m,) bool      whether a switch depends on the state, and steps of solvers end at it
    moving : TimeSwitches    switches of time that depend on parameters; None if there are none
    """

    names: tuple[str, ...]
    switches: ca.Function
    on_state: Mask
    located: Mask
    moving: TimeSwitches | None = None

    @property
    def spoil_derivatives(self) -> bool:
        """Whether derivatives with respect to parameters may jump at each switch."""
        return self.moving is not None or bool(self.on_state.any())

    def values(self, X: Array, p: Array, times: Array) -> Array:
        """The values of the switches (n_t, m) at states X (n_t, n_x) of the times (n_t,)."""
        return batch(self.switches, X, p, times[:, None])[0]

    def met(self, values: Array) -> int:
        """Number of sign changes of values (n_t, m) over time. Two changes between two times are not counted."""
        return int(np.count_nonzero(np.diff(values > 0, axis=0)))

    def passed_over(self, values: Array, times: Array, passes: Array) -> float:
        """The time [s] before the first sign change of values (n_t, m) without a known pass; nan if there is none.

        `passes` (k,) [s] are the passes that the run itself has stored. Values close to 0 count as 0.
        """
        if not len(values):
            return np.nan
        sides = np.where(np.abs(values) > _CLEAR * np.abs(values).max(axis=0, initial=0.0), np.sign(values), 0.0)
        changed = np.any((sides[1:] * sides[:-1] < 0) & self.located, axis=1)
        if not sides[0, self.located].all():  # the motion begins on a switch, and other switches may jump with it
            changed[:1] = False
        near, passes = _NEAR * float(np.ptp(times) if len(times) else 0.0), np.sort(passes)
        met = np.searchsorted(passes, times[1:] + near) > np.searchsorted(passes, times[:-1] - near)
        missed = changed & ~met
        return float(times[:-1][missed.argmax()]) if missed.any() else np.nan

    def first(self, X: Array, p: Array, times: Array) -> float:
        """The first time [s] at which states X (n_t, n_x) have passed a switch; nan if there is none. Switches that
        depend only on time are ignored."""
        changed = (np.diff(self.values(X, p, times) > 0, axis=0) & self.on_state).any(axis=1)
        moving = np.empty(0) if self.moving is None else self.moving(p[None])[0]
        first = min(float(times[1:][changed].min(initial=np.inf)), float(moving.min(initial=np.inf)))
        return first if np.isfinite(first) else np.nan

    def __str__(self) -> str:
        return f"kinks or jumps ({', '.join(self.names)})"


def kinks(dae: DAE, times: Array) -> Kinks | None:
    """Kinks and jumps of equations of motion and of sampled laws over the output times (n_t,), if there are any."""
    f = dae.remembered(_equations)
    x, p, t = symbols = f.sx_in()
    if dae.sampling is not None:
        held = [law(*dae.arguments(x, p, t)) for law in dae.sampling.laws]
        f = ca.Function("equations", symbols, [ca.densify(ca.vertcat(f(*symbols), *held))])
    if not has_kinks(f):
        return None
    f = dae.remembered(_common_equations) if dae.sampling is None else with_common_expressions(f)
    at = [*zip(symbols, _INPUTS, strict=True)]
    expression = switching(f, at)
    if not expression.kinks:
        return None
    on_state = np.array(ca.which_depends(expression.switches, x, 1, True), dtype=bool)
    branch = branches(f, at) if dae.sampling is not None else dae.remembered(_branches)
    moved = [switch for switch in ca.vertsplit(branch.times) if ca.depends_on(switch, p)]
    knots = [knot for knot in branch.knots if ca.depends_on(knot[0], p)]
    moving = TimeSwitches(ca.vertcat(ca.SX(0, 1), *moved), p, t, times, knots=knots) if moved or knots else None
    located = on_state & np.array(expression.located, dtype=bool)
    return Kinks(expression.kinks, ca.Function("switches", symbols, [expression.switches]), on_state, located, moving)


def time_switches(dae: DAE, times: Array) -> TimeSwitches | None:
    """The switches of time of the equations of motion, and sampling instants; None if there are none."""
    f = dae.remembered(_equations)
    instants = None if dae.sampling is None else dae.sampling.instants(times)
    if not has_kinks(f) and instants is None:
        return None
    _, p, t = f.sx_in()
    branch = dae.remembered(_branches) if has_kinks(f) else None
    switches, knots = (ca.SX(0, 1), []) if branch is None else (branch.times, branch.knots)
    if not switches.numel() and not knots and instants is None:
        return None
    return TimeSwitches(switches, p, t, times, instants, knots)


def parameter_switches(dae: DAE, y: ca.Function) -> ca.Function | None:
    """Kinks and jumps of parameters in the equations of motion and in the outputs y, of values without time and state.

    A Function p -> margins (m,), which change their sign at kinks and jumps, and values (k,) of products, minima and
    maxima of several such values, see `margins`; None if there are none.
    """
    f = dae.remembered(_equations)
    if not any(has_kinks(each) for each in (f, dae.inertia, y)):
        return None
    x, p, t = y.sx_in()
    inertia = dae.inertia(*dae.arguments(x, p, t), ca.DM([*range(1, dae.n_v + 1)])) if dae.n_v else ca.SX(0, 1)
    whole = ca.vertcat(f(x, p, t), ca.vec(inertia), ca.vec(y(x, p, t)))
    parts = ca.extract_parametric(whole, p)[2]
    switches, values = margins(ca.Function("parts", [p], [ca.vertcat(ca.SX(0, 1), *parts)]), p)
    return ca.Function("switches", [p], [switches, values]) if switches.numel() else None


def _branches(dae: DAE, _: Array) -> Branches:
    """The equations of motion on given sides of their switches. They have their own symbols."""
    f = dae.remembered(_equations)
    return branches(dae.remembered(_common_equations), [*zip(f.sx_in(), _INPUTS, strict=True)])


def longest_step(dae: DAE, times: Array) -> float:
    """A step [s] shorter than every pulse of a function of time at the nominal parameters; see `Pulses`."""
    return float(dae.remembered(Pulses, times)(dae.p_nominal[None])[0])


def _signals(dae: DAE, _: Array) -> ca.Function | None:
    """A Function (p, t) -> the functions of time in the equations; None if there are none."""
    f = dae.remembered(_equations)
    x, p, time = f.sx_in()
    time_laws = laws(dae.remembered(_common_equations)(x, p, time), p, time)
    if not time_laws.numel():
        return None
    return ca.Function("signals", [p, time], [ca.densify(time_laws)])


class Pulses:
    """Pulses of the functions of time in a DAE over the output times (n_t,).

    Step control does not detect a pulse between the evaluations of a step. A pulse is an interval, shorter than the
    horizon, in which a function is far from its median, or an interval between two jumps. Pulses shorter than 1/20,000
    of the horizon are detected only at output times. Pulses with a switch of time are ignored, because steps end there.
    """

    def __init__(self, dae: DAE, times: Array) -> None:
        self._signals, self._latest = None, (None, np.empty(0))
        if len(times) < 2 or not _is_timed(dae):
            return
        self._signals = dae.remembered(_signals)
        if self._signals is not None:
            self._t = np.union1d(np.linspace(times[0], times[-1], _LOOKS + 1), times)
            self._switches = dae.remembered(time_switches, times)

    @property
    def are_possible(self) -> bool:
        """Whether there are functions of time that may have pulses."""
        return self._signals is not None

    def __call__(self, P: Array) -> Array:
        """Steps (N,) [s] shorter than every pulse at parameters P (N, n_p); infinite without pulses."""
        if self._signals is None:
            return np.full(len(P), np.inf)
        latest = self._latest
        if latest[0] != P.tobytes():  # several solvers run at the same parameters
            stops = np.empty((len(P), 0)) if self._switches is None else self._switches(P)
            pulses = [self._shortest(self._signals, p, own) for p, own in zip(P, stops, strict=True)]
            self._latest = latest = P.tobytes(), np.array(pulses) / 2
        return latest[1]

    def _shortest(self, signals: ca.Function, p: Array, stops: Array) -> float:
        """Duration [s] of the shortest pulse with parameters p (n_p,)."""
        values = batch(signals, p, self._t[:, None])[0].T
        return min((_shortest_pulse(self._t, law, stops) for law in values), default=np.inf)


def _shortest_pulse(t: Array, law: Array, stops: Array) -> float:
    """Duration of the shortest pulse of values `law` (m,) at times t (m,) [s]; infinite without pulses.

    The result is at most twice the true duration. Pulses that contain a stop are ignored.
    """
    if not (finite := np.isfinite(law)).all():
        t, law = t[finite], law[finite]
    if not law.size:
        return np.inf
    far = np.abs(law - np.median(law))
    top = far.max()
    if top <= 1e-9 * max(law.max(), -law.min()):  # rounding
        return np.inf
    # Fractions of the largest distance of a law from its median. A pulse starts above the first fraction, and ends
    # below the second.
    above = far > 0.25 * top
    changes = np.flatnonzero(above[1:] != above[:-1])
    # A pulse that has started before the first time, or ends after the last time, is cut there.
    changes = changes[int(above[0]) :]
    before, last = changes[: len(changes) // 2 * 2].reshape(-1, 2).T
    if not len(before):
        return np.inf
    stops = np.sort(stops)
    counts = np.searchsorted(stops, t[last + 1], "right") > np.searchsorted(stops, t[before])
    high = np.maximum.reduceat(far, np.column_stack([before + 1, last + 1]).ravel())[::2] > 0.5 * top
    lengths = np.maximum(t[last] - t[before + 1], (t[last + 1] - t[before]) / 2)  # the second for one sample
    return float(lengths[high & ~counts].min(initial=np.inf))


class Break(NamedTuple):
    """A constraint, and the time at which its positions or velocities would have to jump."""

    name: str
    time: float
    what: str

    def __str__(self) -> str:
        return f"{self.name!r} requires {self.what} that jump at t = {self.time:.6g} s"


def broken(dae: DAE, q: Array, times: Array) -> Break | None:
    """The first constraint with a jump or corner in time, at coordinates q (n_q,) and nominal parameters.

    Solvers integrate accelerations, in which a corner of this function is not visible.
    """
    if dae.Phi_dot is None or len(times) < 2:
        return None
    p, t = ca.DM(dae.p_nominal), ca.SX.sym("t")
    at = (q, ca.DM.zeros(dae.n_v), *((ca.DM.zeros(dae.n_s),) if dae.n_s else ()), p, t)
    breaks: list[Break] = []
    for f, what in ((dae.Phi, "positions"), (dae.Phi_dot, "velocities")):
        rows = ca.densify(f(*at)) if f is not None else ca.SX(0, 1)
        driven = np.flatnonzero(ca.which_depends(rows, t, 1, True)) if rows.numel() else np.empty(0, dtype=np.intp)
        for row in driven.tolist():
            name = next(name for name, where in dae.rows.items() if where.start <= row < where.stop)
            jumps = _jumps(ca.Function("law", [t], [rows[row]]), times)
            breaks += [Break(name, time, what) for time in jumps[:1].tolist()]
    return min(breaks, key=lambda b: b.time, default=None)


def _jumps(law: ca.Function, times: Array) -> Array:
    """Ordered times of jumps of a function of time. If an interval with a jump is halved, the difference remains."""

    def values(t: Array) -> Array:
        return batch(law, t.reshape(-1, 1))[0].reshape(t.shape)

    t = np.linspace(times[0], times[-1], _LOOKS + 1)
    y = values(t)
    bends = np.abs(np.diff(y, 2))
    sharpest = np.argsort(-bends, kind="stable")[:_SUSPECTS]
    a, b, which = t[sharpest], t[sharpest + 2], np.arange(len(sharpest))
    enough, closer = np.maximum(0.1 * bends[sharpest], 1e-9 * np.abs(y).max()), bends[sharpest, None]
    for _ in range(_HALVINGS):
        parts = np.linspace(a, b, 5, axis=1)
        closer = np.abs(np.diff(values(parts), 2))
        k = closer.argmax(axis=1)
        a, b = parts[which, k], parts[which, k + 2]
    jumps = np.sort(a[(closer.max(axis=1) > enough) & (b < times[-1])])
    return jumps[np.diff(jumps, prepend=-np.inf) > (t[1] - t[0]) / 100]


def _is_timed(dae: DAE) -> bool:
    """Whether equations depend on time. Explicit accelerations are not derived for this test, because they may have
    millions of operations."""
    return dae.remembered(_equations).jac_sparsity(0, _INPUTS.index(On.TIME)).nnz() > 0


def _equations(dae: DAE, _: Array) -> ca.Function:
    """A function (x, p, t) -> forces, right-hand sides of constraints, and first-order rates."""
    x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    at = dae.arguments(x, p, t)
    parts = [dae.Q(*at)]
    if dae.n_v:
        inertia = dae.inertia(*at, ca.DM([*range(1, dae.n_v + 1)]))  # for accelerations that differ from each other
        parts += [inertia[k] for k, moves in enumerate(ca.which_depends(inertia, t, 1, True)) if moves]
    if dae.gamma is not None:
        parts.append(dae.gamma(*at))
    if dae.n_s:
        parts.append(dae.s_rate(*at))
    return ca.Function("equations", [x, p, t], [ca.densify(ca.vertcat(*parts))])


def _common_equations(dae: DAE, _: Array) -> ca.Function:
    """The function of `_equations`, in which equal expressions are evaluated once."""
    return with_common_expressions(dae.remembered(_equations))
