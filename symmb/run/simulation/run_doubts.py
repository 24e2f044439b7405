"""Warnings about one run: missed switches and impacts, small states, and elements outside their range of validity."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._types import Array, Expr
from symmb.declare.mechanics import (
    AbstractBody,
    AxisJoint,
    Constraint,
    Element,
    Gear,
    Ground,
    OwnState,
    Point,
    VelocityConstraint,
)
from symmb.declare.symbolic import batch, has_kinks
from symmb.run.codegen import MOST_PASSES
from symmb.run.events import Kinks
from symmb.run.formulations import output_function
from symmb.run.integrate import Solver, SwitchPasses, follow_doubts, some_states, stiffness
from symmb.run.simulation.pilots import PilotRuns
from symmb.run.simulation.trajectory import Trajectory

SMOOTH = "replace the force by a smooth one, for example sign(v) by tanh(v / 1e-3)"


Hinge = tuple[Point, ca.SX, AbstractBody]
"""A point on an axis, the direction of the axis in world coordinates (3,), and the body that holds the axis."""


def run_doubts(runs: PilotRuns, solver: Solver, trajectory: Trajectory, switches: Kinks | None) -> tuple[str, ...]:
    """All warnings about a run by a solver. `switches` are the kinks and jumps of the equations."""
    return (
        *_switch_doubts(runs, solver),
        *_gap_doubts(runs, solver),
        *_element_doubts(runs, trajectory),
        *_carrier_doubts(runs.scene.system.elements, lambda e: np.asarray(trajectory(e))[:1]),
        *(_pass_doubts(runs, solver, switches) if switches else ()),
        *_small_state_doubts(runs, solver, trajectory),
    )


def _switch_doubts(runs: PilotRuns, solver: Solver) -> tuple[str, ...]:
    """Warnings about fixed steps. They may pass over contacts, force pulses, or switches to which the motion sticks."""
    program = runs.program
    step = solver.step_taken(program.times)
    if doubts := follow_doubts(program.bodies.dae):
        return doubts
    if not step or program.bodies.dae.impacts is not None or not has_kinks(program.bodies.dae.rhs):
        return ()
    stops = SwitchPasses(program.bodies.dae, program.times).stops(runs.x0, runs.p[None]).of(0)
    if np.isfinite(stops.sticks):
        return (
            f"The motion sticks to a switch of a force at t = {stops.sticks:.6g} s. Fixed steps pass this switch again "
            f"and again: {SMOOTH}.",
        )
    times, span = stops.times[np.isfinite(stops.times)], np.ptp(program.times)
    # Errors are visible if more than this fraction of the fixed steps contains a switch. A motor with pulsed voltage
    # reaches about a tenth of this value.
    if (share := len(times) * step / span) > 0.1:
        return (
            f"The equations switch {len(times)} times, but steps of {step:.1g} s do not end at switches: a force "
            f"jumps or has a kink in {min(share, 1):.0%} of the steps. Use shorter steps, or DormandPrince(), whose "
            "steps end at switches.",
        )
    distances = np.diff(times)
    # Times of switches are equal if their difference, divided by the horizon, is below this value.
    distances[distances < 1e-12 * span] = np.inf
    if not (distances <= step).any():
        return ()
    return (
        f"Two switches of the equations are {distances.min():.1g} s apart at t = {times[distances.argmin()]:.6g} s, "
        f"but steps are {step:.1g} s long. The run may miss contacts or pulses. Use shorter steps.",
    )


def _gap_doubts(runs: PilotRuns, solver: Solver) -> tuple[str, ...]:
    """A warning if bodies overlap at a gap, because the run has missed an impact."""
    dae, states = runs.program.bodies.dae, runs.done[solver][1].examination
    if dae.impacts is None or not dae.impacts.names:
        return ()
    x, p, t = ca.SX.sym("x", states.x.shape[1]), ca.SX.sym("p", len(runs.p)), ca.SX.sym("t")
    gaps = ca.Function("gaps", [x, p, t], dae.impacts.gaps.call([*dae.arguments(x, p, t)])[:1])
    (values,) = batch(gaps, states.x, runs.p, states.t[:, None])
    k, i = np.unravel_index(int(values.argmin()), values.shape)
    # An overlap up to this fraction of the size of the scene is rounding of a closed contact.
    if values[k, i] >= -1e-6 * dae.scales.length:
        return ()
    name = dae.impacts.names[i]
    return (
        f"The gap of Impact {name!r} is {values[k, i]:.3g} m at t = {states.t[k]:.6g} s: the run missed an impact.",
    )


def _element_doubts(runs: PilotRuns, trajectory: Trajectory) -> Iterator[str]:
    """Warnings about elements outside their range of validity, at output times of the run and between them."""
    scene, dae, states = runs.scene, runs.program.bodies.dae, trajectory.examination
    elements, bind, lam = scene.system.elements, scene.system.bind, scene.system.lam
    known = scene.remembered(_element_doubts, lambda: [
        *((e.title, *doubt) for e in elements if isinstance(e, Element) for doubt in e.doubtful(bind)),
        *((e.title, e.pressure(lam(e.name)), _LETS_GO) for e in elements if isinstance(e, Constraint) and e.unilateral),
    ])  # fmt: skip
    if not known:
        return
    every = ca.vertcat(*(ca.vec(margins) for _, margins, _ in known))
    f = scene.remembered((_element_doubts, "values"), lambda: output_function(dae, scene, scene.expression(every)))
    t, first = np.unique(np.append(states.t, trajectory.t), return_index=True)
    values = batch(f, np.vstack([states.x, trajectory.x])[first], runs.p, t[:, None])[0].reshape(len(t), -1)
    # A violation up to this fraction of the largest margin may be caused by rounding and errors of the run.
    below = values < -1e-9 * np.abs(values).max(axis=0)
    ends = np.cumsum([margins.numel() for _, margins, _ in known])
    for (title, _, what), own in zip(known, np.split(below, ends[:-1], axis=1), strict=True):
        if own.any():
            yield f"{title}: " + what.format(f" at t = {t[own.any(axis=1).argmax()]:.6g} s")


_LETS_GO = (
    "its force changes sign{}: a real contact would open, and a real rope would go slack. Use a contact or a Rope to "
    "follow the motion after this time."
)


def _pass_doubts(runs: PilotRuns, solver: Solver, switches: Kinks) -> tuple[str, ...]:
    """A warning if the states before and after a step are on different sides of a switch that the run has missed."""
    (run, trajectory), dae = runs.done[solver], runs.program.bodies.dae
    states = trajectory.examination
    if run.stops is None or dae.sampling is not None:  # sampled laws store their own side of each switch
        return ()
    stops, later = run.stops, states.t >= run.stops.until
    is_full = len(stops.passes) >= MOST_PASSES and not solver.meets_switches
    if is_full and switches.met(states.switch_values[later]):
        return (
            f"The motion passes more than {MOST_PASSES} {switches}. From t = {stops.until:.6g} s on, steps of "
            f"{solver!r} do not end at switches, and may miss some. Use DormandPrince().",
        )
    ends = np.append(stops.passes, [event.time for event in trajectory.events])  # an event may pass a switch as well
    missed = switches.passed_over(states.switch_values[~later], states.t[~later], ends)
    if np.isnan(missed):
        return ()
    return (
        f"The equations have {switches}. The motion passes a switch after t = {missed:.6g} s, but no step of the run "
        "ended at this switch. The run may have missed other switches as well.",
    )


def _small_state_doubts(runs: PilotRuns, solver: Solver, run: Trajectory) -> Iterator[str]:
    """A warning if outputs change with the absolute tolerances.

    Only first-order states, and velocities that constraints determine, are examined. In other states, such small
    values are rounding errors.
    """
    dae, states, elements, p = runs.program.bodies.judged, run.examination, runs.scene.system.elements, runs.p
    if not solver.controls_step or not any(isinstance(e, OwnState | VelocityConstraint) for e in elements):
        return
    tolerances = solver.tolerances(dae)
    absolute, names = tolerances.absolute(states.x.shape[1]), [e.name for e in elements if isinstance(e, OwnState)]
    own = dae.n_q + dae.n_v + np.array([k for k, name in enumerate(dae.s_names) if name in names], dtype=np.intp)
    sizes = np.abs(states.x[:, own]).max(axis=0, initial=0.0)
    # Size of a first-order state, divided by its absolute tolerance. Smaller states have only a few correct digits.
    is_small = ((sizes > 0) & (sizes < 1e3 * absolute[own])).any()
    if not is_small:
        some = some_states(len(states.t))
        X, shortest = runs.program.shortest_equations(states.x[some], p)
        # The horizon divided by the shortest time constant. Above this ratio, slow reactions may depend on
        # concentrations that are smaller than the tolerances. Hydraulics and contacts reach 1e6.
        # tests/simulation/test_small_states.py
        if stiffness(shortest, X, p, states.t[some]).decay * np.ptp(run.t) < 1e8:
            return
    # The absolute tolerance of a second run is 1e-6 times the smallest one of the run, but at least 1e-28.
    atol = max(1e-6 * float(absolute.min()), 1e-28)
    if atol >= absolute.min() or runs.run(other := replace(solver, atol=atol)).message:  # pyright: ignore
        return
    finer = runs.done[other][1]
    change, size = np.abs(run.values - finer.values), np.abs(finer.values)
    most = size.max(axis=0)  # values below the finer tolerances are errors
    # A change is suspicious if it is above a hundredth of the value, and above 1e3 times the relative tolerance.
    wrong = (change > 1e-2 * size) & (change > 1e3 * tolerances.rtol * most) & (most > atol)
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        yield (
            f"Output {run.names[i]!r} depends on states that are smaller than their absolute tolerances: at t = "
            f"{run.t[k]:.6g} s it is {run.values[k, i]:.3g}, but {finer.values[k, i]:.3g} at smaller tolerances. Use "
            f"{type(solver).__name__}(atol=...) with a value far below these states."
        )


def _carrier_doubts(elements: Sequence[object], value: Callable[[Expr], Array]) -> Iterator[str]:
    """Warnings about gears without a carrier. `value` evaluates expressions at the start.

    The axis of a wheel may move if all its hinges are on bodies that may turn about other axes. With a ratio of 1, a
    carrier has no effect.
    """
    joints = [e for e in elements if isinstance(e, AxisJoint) and not isinstance(e, Gear)]
    ground = _fixed_to(Ground(), joints)
    for gear in elements:
        if not isinstance(gear, Gear) or gear.carrier is not None or float(np.ravel(value(gear.ratio))[0]) == 1:
            continue
        for wheel in gear.bodies():
            names = _fixed_to(wheel, joints)
            hinges = [] if names & ground else _hinges(names, joints)
            if not hinges or any(_name(holder) in ground for *_, holder in hinges):
                continue
            point, axis, holder = hinges[0]
            pivots = _hinges(_fixed_to(holder, joints), joints)
            if not any(_name(other) in ground and _is_same(point, axis, p, u, value) for p, u, other in pivots):
                yield (
                    f"{gear.title}: Body {holder.name!r} holds the axis of {wheel.name!r} and may turn, but the gear "
                    f"measures angles against the ground. Pass carrier={holder.name}, or carrier=Ground() if "
                    "angles should be measured against the ground."
                )


def _name(body: AbstractBody) -> str | None:
    return None if isinstance(body.owner, Ground) else body.owner.name


def _fixed_to(body: AbstractBody, joints: Sequence[AxisJoint]) -> set[str | None]:
    """Names of the bodies that do not turn relative to a body. The name of the ground is None."""
    names, before = {_name(body)}, 0
    while len(names) > before:
        before = len(names)
        for joint in joints:
            pair = {_name(b) for b in joint.bodies()}
            if joint.aligns and not joint.turns and pair & names:
                names |= pair
    return names


def _hinges(names: set[str | None], joints: Sequence[AxisJoint]) -> list[Hinge]:
    """The hinges between bodies with these names and all other bodies."""
    found = []
    for joint in (j for j in joints if j.turns):
        a, b = joint.point_a, joint.point_b
        if (_name(a.body) in names) != (_name(b.body) in names):
            found.append((a, joint.frames[0][:, 2], (b if _name(a.body) in names else a).body))
    return found


def _is_same(p: Point, u: ca.SX, r: Point, w: ca.SX, value: Callable[[Expr], Array]) -> bool:
    """Whether the axes through points p and r with directions u and w are the same line."""
    size = 1 + ca.norm_1(p.r) + ca.norm_1(r.r)
    beside = ca.vertcat(ca.cross(u, w), ca.cross(p.r - r.r, u) / size)
    # Axes are equal if two numbers are below this value: the sine of their angle, and their distance, divided by the
    # distance of their points from the origin.
    return bool(np.abs(value(beside)).max() < 1e-6)
