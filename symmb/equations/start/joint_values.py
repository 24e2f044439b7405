"""Listed joint values as constraint rows for the start only, and start values of states."""

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._magnitudes import SLIGHT
from symmb._types import Array, Indices
from symmb.declare.symbolic import Symbol, t
from symmb.equations.model import DAE, JointValue, Prescribed, Scene, System


def of_positions(listed: Prescribed) -> tuple[JointValue, ...]:
    """The listed angles and displacements."""
    return tuple(value for value in listed.joints if not value.is_rate)


def of_rates(listed: Prescribed) -> tuple[JointValue, ...]:
    """The listed rates."""
    return tuple(value for value in listed.joints if value.is_rate)


def with_position_rows(system: System, dae: DAE, values: Sequence[JointValue]) -> DAE:
    """The DAE with additional rows of Phi, which are 0 if angles and displacements have their listed values."""
    if not values:
        return dae
    rows = ca.vertcat(*[value.row for value in values])
    return _with_rows(system, dae, values, rows, ca.jtimes(rows, system.q, system.qdot), dae.n_c)


def with_rate_rows(system: System, dae: DAE, values: Sequence[JointValue]) -> DAE:
    """The DAE with additional velocity-only rows, which are 0 if rates have their listed values."""
    if not values:
        return dae
    return _with_rows(system, dae, values, ca.SX(0, 1), ca.vertcat(*[value.row for value in values]), dae.n_r)


def _with_rows(system: System, dae: DAE, values: Sequence[JointValue], rows: ca.SX, rates: ca.SX, at: int) -> DAE:
    """The DAE with additional position rows, rates and Jacobian rows, inserted at row `at`."""
    names, z = ["q", "v", "s", "p", "t"], [system.q, system.v, system.s, system.p, t]
    if not dae.n_s:
        names, z = names[:2] + names[3:], z[:2] + z[3:]
    jacobian = ca.jacobian(rates, system.v)
    own = {name: f(*z) for name in ("Phi", "Phi_dot", "G") if (f := getattr(dae, name)) is not None}
    parts = {
        "Phi": ca.vertcat(own["Phi"], rows),
        "Phi_dot": ca.vertcat(own["Phi_dot"][:at], rates, own["Phi_dot"][at:]),
        "G": ca.sparsify(ca.vertcat(own["G"][:at, :], jacobian, own["G"][at:, :])),
    }
    n = len(values)
    slices = {
        name: where if where.stop <= at else slice(where.start + n, where.stop + n) for name, where in dae.rows.items()
    }
    slices |= {value.name: slice(at + k, at + k + 1) for k, value in enumerate(values)}
    functions = {name: ca.Function(name, z, [expression], names, [name]) for name, expression in parts.items()}
    row_names = (*dae.row_names[:at], *(value.name for value in values), *dae.row_names[at:])
    return replace(dae, rows=slices, row_names=row_names, **functions)


def residuals(scene: Scene) -> ca.Function | None:
    """The Function (q, v, p) -> residuals of listed joint values; None without listed joint values."""
    values, system = scene.prescribed.joints, scene.system
    if not values:
        return None
    rows = ca.densify(ca.vertcat(*[value.row for value in values]))
    return ca.Function("listed", [system.q, system.v, system.p], [rows])


def angles(scene: Scene) -> Indices:
    """Indices of the states that count the turns of angles in Phi."""
    inside = {symbol.element_hash() for symbol in ca.symvar(scene.system.Phi)}
    states = enumerate(scene.system.collected.states)
    return np.array([k for k, s in states if s.sx.element_hash() in inside and _is_angle(s)], dtype=np.intp)


def _is_angle(state: Symbol) -> bool:
    """Whether a state counts the turns of an angle."""
    return not state.owner and state.name.endswith(".angle")


def listed_states(scene: Scene) -> Array:
    """States (n_s,) at the nominal parameters: listed states, listed or guessed angles, and 0 for other states."""
    states = {**_angle_states(scene, scene.guessed), **_listed_states(scene)}
    collected = scene.system.collected
    s = np.zeros(len(collected.states)) if scene.restart is None else scene.restart.s.copy()
    if collected.joint_events and scene.restart is None:
        s[:] = [state.resting for state in collected.states]
    for k, value in states.items():
        s[k] = float(ca.Function("value", [scene.system.p], [value])(scene.system.parameters.nominal))
    return s


def with_turns(scene: Scene, q: Array, s: Array, counted: Indices) -> Array:
    """States s (n_s,) with correct turns of angles that are sums or differences of known angles at coordinates q.

    Gears, springs and outputs count their own turns. Known angles are the states in `counted`, or the listed and
    guessed angles if `counted` is empty.
    """
    system, values = scene.system, {v.name: v for v in (*scene.guessed.joints, *scene.prescribed.joints)}
    turning = [value for value in values.values() if value.handle == "angle" and not counted.size]
    states = [k for k, state in enumerate(system.collected.states) if _is_angle(state) and k not in counted]
    n = len(turning) + len(counted)
    if scene.restart is not None or not (n and states):
        return s
    rates = [*(value.joint.angle_rate for value in turning), *(system.s_rate[k] for k in (*counted.tolist(), *states))]
    numbers = ca.vertcat(*[value.value for value in turning])
    f = ca.Function("turns", [system.q, system.p], [ca.jacobian(ca.vertcat(*rates), system.v), numbers])
    J, listed = (part.full() for part in f(q, system.parameters.nominal))
    known = np.concatenate([listed.ravel(), s[counted]])
    # Only whole multiples are safe: a fraction of an unknown number of turns would be a wrong angle.
    factors = np.linalg.lstsq(J[:n].T, J[n:].T, rcond=None)[0].T
    whole = np.round(factors)
    follows = (np.abs(factors - whole) < SLIGHT).all(axis=1) & (np.abs(whole @ J[:n] - J[n:]) < SLIGHT).all(axis=1)
    s = s.copy()
    s[np.array(states)[follows]] = (whole @ known)[follows]
    return s


def with_states(scene: Scene, dae: DAE, s: Array) -> DAE:
    """The DAE with listed start values of states. Turns of angles are counted from states s (n_s,)."""
    listed, all_states = _listed_states(scene), scene.system.collected.states
    if scene.restart is not None:
        listed = {k: ca.SX(s[k]) for k, state in enumerate(all_states) if not _is_angle(state)} | listed
    counted = (k for k, state in enumerate(all_states) if _is_angle(state) and s[k])
    counting = {*angles(scene).tolist(), *counted}
    if dae.s_start is None or not (listed or counting):
        return dae
    q, p = ca.SX.sym("q", dae.n_q), scene.system.p
    values = dae.s_start(q, p)
    for k in counting:
        # The angle from atan2 differs from the state by less than half a turn, whatever the number of turns.
        ahead = values[k] - s[k]
        values[k] = s[k] + ca.atan2(ca.sin(ahead), ca.cos(ahead))
    for k, value in listed.items():
        values[k] = value
    return replace(dae, s_rest=s, s_start=ca.Function("s_start", [q, p], [values]))


def _listed_states(scene: Scene) -> dict[int, ca.SX]:
    """Listed states and states of listed angles, by index."""
    names = [state.name for state in scene.system.collected.states]
    own = {names.index(name): value for name, value in scene.prescribed.states.items()}
    return {**own, **_angle_states(scene, scene.prescribed)}


def _angle_states(scene: Scene, listed: Prescribed) -> dict[int, ca.SX]:
    """The states of listed angles by index, if the equations or outputs contain these states."""
    numbers = {state.sx.element_hash(): k for k, state in enumerate(scene.system.collected.states)}
    values = ((value.state, value.value) for value in of_positions(listed))
    found = ((numbers.get(state.sx.element_hash()), value) for state, value in values if state is not None)
    return {k: value for k, value in found if k is not None}
