"""The state at which a scene is linearised."""

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._options import shown
from symmb._types import Array
from symmb._units import number_in
from symmb.equations.model import DAE, Scene
from symmb.run.events import kinks
from symmb.run.formulations import Formulation
from symmb.run.linear.linear_equations import LinearEquations
from symmb.run.simulation import DAESimulator, Trajectory, parameter_values, scene_of

_ON = 1e-9
"""Largest distance of a state from a switch, in sizes of the states, if the state is on the switch."""


@dataclass(frozen=True, eq=False)
class LinearizationPoint:
    """A state x (n_x,) of a formulation with parameters p (n_p,) at a time t [s]."""

    x: Array
    p: Array
    t: float


def point_of(
    subject: Scene | DAESimulator | Trajectory, time: float | str | None, parameters: Mapping[str, float] | None
) -> tuple[Scene, dict[str, float], float, Array | None]:
    """Scene, parameters, time [s], and state of the bodies (n_x,), which is None for the start of a scene."""
    if not isinstance(subject, Trajectory):
        subject = scene_of(subject)
        if time is not None:
            raise DeclarationError("linearize: a scene is linearised at its start. Pass time= with a run only.")
        values = parameter_values(subject, {} if parameters is None else parameters)
        return subject, values, float(subject.times[0]), None
    if subject.scene is None:
        raise DeclarationError(
            "linearize: the run was read from a file, and its equations are not known. Pass the scene: "
            "Trajectory.load(path, scene)."
        )
    if parameters is not None:
        raise DeclarationError("linearize: a run has its own parameters. Pass parameters= with a scene only.")
    own = float(subject.t[-1]) if time is None else number_in("linearize: time", "a time", time, "s")
    if not (subject.t == own).any():
        raise DeclarationError(
            f"linearize: time must be one of the run's {len(subject.t)} output times, "
            f"{subject.t[0]:g} to {subject.t[-1]:g} s, got {shown(time)}."
        )
    return subject.scene, subject.parameters, own, subject.x[int(np.argmax(subject.t == own))]


def started(scene: Scene, formulation: Formulation, p: Array, t: float, of_bodies: Array | None) -> LinearizationPoint:
    """The point at the start of a formulation, or at a state of the bodies."""
    if of_bodies is None:
        X, (fault,) = formulation.start.states(p[None])
        if fault:
            raise SimulationError(f"linearize: {scene.name} does not start: {fault}.")
        return LinearizationPoint(X[0], p, t)
    if formulation.bodies is None:
        return LinearizationPoint(of_bodies, p, t)
    joints, system = scene.system.joint_space().joints, scene.system
    states = [ca.vertcat(system.q, system.v, system.s), system.p]
    measured = ca.Function("measured", states, [ca.densify(ca.vertcat(*joints.of_joints))])
    return LinearizationPoint(measured(of_bodies, p).full().ravel(), p, t)


def require_smooth(formulation: Formulation, point: LinearizationPoint, equations: LinearEquations) -> None:
    """Raise a DeclarationError if the equations have no derivative at a point."""
    dae, x = formulation.dae, point.x
    blocks = equations.blocks(x[None], point.p[None], point.t)
    if not all(np.isfinite(block).all() for block in (blocks.A, blocks.B, blocks.rows)):
        raise DeclarationError(
            "linearize: a derivative of the equations is infinite or undefined at this state, such as the derivative "
            "of a square root or a norm at 0. Linearise at a state nearby."
        )
    if dae.sampling is not None:
        raise DeclarationError(
            "linearize: the scene has Sampled values, which change in steps. Write the controller as an expression "
            "without Sampled."
        )
    if dae.impacts is not None:
        at = (*np.split(x, [dae.n_q, dae.n_q + dae.n_v]), point.p, point.t)
        gaps = dae.impacts.gaps(*at)[0].full().ravel()
        touching = gaps <= _ON * dae.scales.length
        if touching.any():
            name = dae.impacts.names[int(touching.argmax())]
            raise DeclarationError(
                f"linearize: Impact {name!r} is closed at this state, and impacts have no derivative. Linearise at a "
                "state with open gaps."
            )
    switches = kinks(dae, np.array([point.t]))
    if switches is None:
        return
    f, states = switches.switches, ca.SX.sym("x", len(x))
    p, t = ca.SX.sym("p", len(point.p)), ca.SX.sym("t")
    slopes = ca.Function("slopes", [states, p, t], [ca.jacobian(f(states, p, t), states)])(x, point.p, point.t).full()
    sizes = np.maximum(np.abs(x), np.concatenate([dae.state_sizes]))
    values, slopes = f(x, point.p, point.t).full().ravel(), slopes * sizes
    steep = np.linalg.norm(slopes, axis=1)
    for k in np.flatnonzero((np.abs(values) <= _ON * steep) & (steep > 0)):
        # Distance from a switch, in sizes of the states, at which derivatives on both sides are compared.
        aside = 1e-7 * sizes * slopes[k] / steep[k]
        blocks = equations.blocks(np.stack([x - aside, x + aside]), np.stack([point.p] * 2), point.t)
        near, far = (np.abs(_jump(dae, point, share * aside)) for share in (0.5, 1.0))
        # The differences of forces at half the distance and at the whole distance have the ratio 1/2 for a continuous
        # force, and 1 for a jump. `noise` is the rounding of a difference.
        noise = 1e-12 * float((np.abs(blocks.A).max(axis=0) @ equations.sizes).max())
        jumps = bool((near > 0.9 * far + noise).any())
        # Largest relative difference of equal derivatives. A continuous derivative changes by about 1e-7.
        if jumps or np.abs(blocks.A[1] - blocks.A[0]).max() > 1e-4 * np.abs(blocks.A).max():
            how = "jump" if jumps else "have different slopes on both sides"
            raise DeclarationError(
                f"linearize: the state is on a switch of the equations ({', '.join(switches.names)}), and the forces "
                f"{how} there. Linearise at a state nearby."
            )


def _jump(dae: DAE, point: LinearizationPoint, aside: Array) -> Array:
    """Differences (n,) of accelerations and rates between the states x + aside and x - aside."""
    sides = []
    for x in (point.x - aside, point.x + aside):
        parts = np.split(x, [dae.n_q, dae.n_q + dae.n_v])[: 2 + bool(dae.n_s)]
        _, *rates = (rate.full().ravel() for rate in dae.rhs(*parts, point.p, point.t))
        sides.append(np.concatenate(rates))
    return sides[1] - sides[0]
