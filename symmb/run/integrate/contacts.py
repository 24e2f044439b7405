"""The equations of contacts for the engine: gaps as switches of the state, forces, impulses and states in contact."""

import math
from dataclasses import replace

import casadi as ca

from symmb.declare.mechanics import RESTITUTION
from symmb.declare.symbolic import common
from symmb.equations.model import DAE, Impacts, JointEvents
from symmb.run.codegen import Contacts
from symmb.run.integrate.step_ends import SwitchedProblem, hysteresis_of


def contacts_of(dae: DAE, impacts: Impacts, with_work: bool) -> Contacts:
    """The data of the contacts of a DAE, and of its joints that open and close."""
    joints, at = impacts.joints, dae.n_q + dae.n_v
    at_start = [ca.SX.sym("x", at + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t"), ca.SX.sym("span")]
    lists: dict[str, tuple[int, ...]] = {}
    if joints is not None:
        others = [(k, i) for k, own in enumerate(joints.others) for i in own]
        lists = {
            "opens": tuple(map(int, joints.opens)),
            "by_force": tuple(map(int, joints.by_force)),
            "slips": joints.let_slip,
            "holding_state": tuple(at + k for k in joints.holding),
            "flag_state": tuple(at + k for k in joints.flags),
            "other_owner": tuple(k for k, _ in others),
            "other_state": tuple(at + i for _, i in others),
            "first_row": tuple(own.start for own in joints.rows),
            "count_row": tuple(own.stop - own.start for own in joints.rows),
            "place_state": tuple(at + k for k in joints.place),
            "place_owner": joints.owners,
        }
    return Contacts(
        (*impacts.names, *(joints.names if joints else ())),
        tuple((dae.n_q + dae.n_v + impacts.closed).tolist()),
        dae.n_q,
        dae.n_v,
        with_work,
        float(dae.scales.length),
        float(dae.scales.energy),
        tuple(dae.displacement_scales.tolist()),
        lists,
        dae.n_r,
        common("start", at_start, _start(dae, impacts, *at_start)),
        _fault_texts(impacts),
    )


def _tolerances(dae: DAE, joints: JointEvents) -> tuple[float, ...]:
    """Values (m,) below which margins are rounding errors. Margins of forces are tested with one closed joint.

    With more closed joints, forces of redundant joints would be unlimited at states that violate constraints.
    """
    x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")

    def of(number: int) -> float:
        if joints.let_slip[number] == 2:
            # Ratio of slip to the rate of the motion. A larger slip is caused by an impulse. The slip of clutches that
            # stick is not exactly 0.
            return 1e-9 * dae.scales.rate
        closed = ca.SX(x)
        closed[[dae.n_q + dae.n_v + k for k in joints.flags if joints.by_force[number]]] = 0
        closed[dae.n_q + dae.n_v + joints.flags[number]] = 1
        margins, _ = joints.margins(*dae.arguments(closed, p, t))
        return hysteresis_of(dae, margins[number], x, p, t, ca.SX.sym("side"))[0]

    return tuple(of(k) for k in range(len(joints.names)))


def with_gaps(frozen: SwitchedProblem, dae: DAE, impacts: Impacts, work: bool) -> SwitchedProblem:
    """A problem with further switches: gaps of contacts, with the value 1 if closed, and then margins of joints.

    A margin is above 0 on its present side, and 1 if the event would change nothing. The new problem also projects
    states onto closed contacts. With `work`, it has an integral along the motion, to which impulses add their work.
    """
    problem, m, joints = frozen.problem, len(frozen.ends.hysteresis), impacts.joints
    x, p, t = problem.x, problem.p[: len(dae.p_names)], problem.t
    gap, rate, _ = impacts.gaps(*dae.arguments(x, p, t))
    is_closed = x[(dae.n_q + dae.n_v + impacts.closed).tolist()] > 0.5
    gap, rate = ca.if_else(is_closed, 1, gap), ca.if_else(is_closed, 0, rate)
    rounding = (0.0,) * len(impacts.names)
    if joints is not None:
        s, (margin, fall) = x[dae.n_q + dae.n_v :], joints.margins(*dae.arguments(x, p, t))
        side = 1 - 2 * (s[list(joints.holding)] > 0.5)
        closed = [ca.sum1(s[[k, *others]]) for k, others in zip(joints.flags, joints.others, strict=True)]
        # Only impulses let clutches slip. Margins of clutches are evaluated at the instants of these impulses.
        is_armed = ca.vertcat(
            *[
                0 if slips == 2 else c > 0.5 if opens else c < 0.5
                for c, opens, slips in zip(closed, joints.opens, joints.let_slip, strict=True)
            ]
        )
        known = ca.vertcat(gap, ca.if_else(is_armed, ca.if_else(ca.SX(list(joints.by_force)), 1, side * margin), 1))
        gap = ca.vertcat(gap, ca.if_else(is_armed, side * margin, 1))
        rate = ca.vertcat(rate, ca.if_else(is_armed, side * fall, 0))
        rounding = (*rounding, *_tolerances(dae, joints))
    else:
        known = gap
    n = gap.numel()
    projected = x if problem.projected is None else problem.projected
    parts = {"p": ca.vertcat(problem.p, ca.SX.sym("side", n)), "projected": _held(dae, impacts, projected, p, t)}
    parts["quad"] = problem.quad if problem.quad.numel() == work else ca.SX(1, 1)
    return SwitchedProblem(
        replace(problem, **parts),
        ca.densify(ca.vertcat(frozen.switches[:m], gap, frozen.switches[m:], rate)),
        replace(frozen.ends, hysteresis=(*frozen.ends.hysteresis, *rounding)),
        ca.densify(ca.vertcat(frozen.switches[:m], known)),
    )


def contact_functions(dae: DAE, impacts: Impacts, x: ca.SX, p: ca.SX, t: ca.SX) -> dict[str, ca.SX]:
    """Expressions for c/impacts.h at states x, which may end with the work: gaps, forces, impulses, held states."""
    n_x, p = dae.n_q + dae.n_v + dae.n_s, p[: len(dae.p_names)]
    at = dae.arguments(x[:n_x], p, t)
    functions = {name: getattr(impacts, name)(*at) for name in ("gaps", "forces", "impulses")}
    if impacts.joints is not None:
        functions |= {name: getattr(impacts.joints, name)(*at) for name in ("margins", "places", "jump")}
    parts = {
        name: ca.vertcat(*(ca.vec(ca.densify(e)) for e in (values if isinstance(values, tuple) else (values,))))
        for name, values in functions.items()
    }
    return parts | {"held": ca.vertcat(_held(dae, impacts, x[:n_x], p, t), x[n_x:])}


def _held(dae: DAE, impacts: Impacts, x: ca.SX, p: ca.SX, t: ca.SX) -> ca.SX:
    """The state x (n_x,), projected onto its closed contacts."""
    return ca.vertcat(*impacts.project(*dae.arguments(x, p, t)), x[dae.n_q + dae.n_v :])


def started(dae: DAE, impacts: Impacts, x: ca.SX, p: ca.SX, t0: float, span: float) -> ca.SX:
    """The state (n_x,) at the start of a run of length `span` [s]; nan if the run cannot start at the state x."""
    x, faults, _ = _start(dae, impacts, x, p, ca.SX(t0), ca.SX(span))
    return x + ca.if_else(ca.sum1(faults) > 0, math.nan, 0)


def _start(dae: DAE, impacts: Impacts, x: ca.SX, p: ca.SX, t: ca.SX, span: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The results of `Contacts.start`. Faults of joints that open or close come first, then faults of impacts, from the
    last impact to the first."""
    gap, rate, _ = impacts.gaps(*dae.arguments(x, p, t))
    way = ca.fabs(rate) * span + impacts.forces(*dae.arguments(x, p, t))[2] * span**2 / 2
    e = impacts.impulses(*dae.arguments(x, p, t))[3]
    # A smaller negative gap at the start counts as 0. The limit is relative to the size of the scene, or to the change
    # of the gap until the end by its speed and acceleration. The gap itself may be the only known length.
    rounding = ca.fmax(1e-9 * dae.scales.length, 1e-7 * way)
    faults = [ca.logic_not(gap >= -rounding), ca.logic_not(ca.logic_and(e >= 0, e <= 1))]
    last_first = list(range(gap.numel()))[::-1]
    faults, numbers = (ca.vertcat(*[values[last_first] for values in parts]) for parts in (faults, (gap, e)))
    if impacts.joints is not None:
        x, of_joints = _joints_started(dae, impacts.joints, x, p, t)
        faults, numbers = ca.vertcat(of_joints, faults), ca.vertcat(ca.SX.zeros(of_joints.numel()), numbers)
    return x, ca.densify(faults), ca.densify(numbers)


def _fault_texts(impacts: Impacts) -> tuple[tuple[str, str], ...]:
    """For each fault of `_start`, the texts before and after its number."""
    joints, names = impacts.joints, impacts.names[::-1]
    events = zip(joints.titles, joints.opens, strict=True) if joints else ()
    before, behind = RESTITUTION.split("{}")
    return (
        *(
            (
                f"{title}: its condition is already true at the start. The joint opens or closes only when the "
                "condition becomes true. Start where the condition is false, or "
                f"{'leave the joint out' if opens else 'leave the Latch out'}",
                "",
            )
            for title, opens in events
        ),
        *((f"Impact {name!r}: the gap is ", " at the start. Start with a gap of at least 0") for name in names),
        *((f"Impact {name!r}: {before}", behind) for name in names),
    )


def _joints_started(dae: DAE, joints: JointEvents, x: ca.SX, p: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The state, in which true conditions of joints are recorded, and faults of the joints.

    A true condition is a fault if it would open a closed joint, or close an open joint. Clutches without slip stick.
    """
    at, x, faults = dae.n_q + dae.n_v, ca.SX(x), []
    slip, rounding = joints.slips(*dae.arguments(x, p, t))
    for k, (sticks, side) in enumerate(joints.clutches):
        fresh, rest = ca.logic_and(x[at + sticks] == 0, x[at + side] == 0), ca.fabs(slip[k]) <= rounding[k]
        x[at + sticks] = ca.if_else(fresh, rest, x[at + sticks])
        x[at + side] = ca.if_else(fresh, ca.sign(slip[k]) * ca.logic_not(rest), x[at + side])
    margins, _ = joints.margins(*dae.arguments(x, p, t))
    of_clutches = {sticks for sticks, _ in joints.clutches}
    for k, (flag, tolerance) in enumerate(zip(joints.flags, _tolerances(dae, joints), strict=True)):
        holds = ca.SX(0) if flag in of_clutches else margins[k] < -tolerance
        closed = ca.sum1(x[[at + i for i in (flag, *joints.others[k])]]) > 0.5
        x[at + joints.holding[k]] = holds
        faults.append(ca.logic_and(holds, closed if joints.opens[k] else ca.logic_not(closed)))
    return x, ca.vertcat(*faults)
