"""Both formulations of scenes against each other: accelerations, reactions and trajectories.

Scenes are those of models/ and of tests/problems.py, and random ones: trees, loops, redundant ones, flexible bodies,
drives, in plane and space, in units from 1e-6 to 1e6. At 20 states along a run in coordinates of joints, moved onto the
constraints, accelerations of the bodies follow from those of the joints, and multipliers from accelerations by least
squares where they are unique. Trajectories are compared while the errors that `check=True` estimates are below
`CERTAIN`.

    PYTHONPATH=.:tests python tests/benchmarks/formulations.py [number of random scenes] [seed] [first]
"""

import importlib
import pkgutil
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import casadi as ca
import numpy as np
import problems
from _random_scenes import draw

import models
import symmb as mb
from symmb.equations.model import DAE
from symmb.run.formulations.formulation import formulations
from tests.model.test_joint_space import random_state, tree

STATES, ALLOWED, TRAJECTORY, CERTAIN = 20, 1e-9, 1e-8, 1e-9
"""States of a scene, allowed differences of accelerations and reactions and of trajectories, and errors of runs up to
which these are compared, over their sizes."""
STARTS = {"laval_rotor": {"to_y.displacement_rate": 0.1}}
"""Starts of models that run without accelerations, so that these can be compared: a push makes a rotor whirl."""
NEWTON_STEPS = 3
"""From a run's state onto the constraints: errors of 1e-5 become rounding in two."""


@dataclass(frozen=True)
class Differences:
    """Largest differences over sizes, with the times of the trajectory that were certain; nan where there are none."""

    accelerations: float
    reactions: float
    trajectory: float
    certain: int

    @property
    def good(self) -> bool:
        return not (
            self.accelerations > ALLOWED or self.reactions > ALLOWED or self.trajectory > TRAJECTORY or not self.certain
        )


def main(number: int = 300, seed: int = 20261122, first: int = 0) -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    bad, alone, told = [], 0, 0
    for name, scene in chain([] if first else declared(), random(number, seed, first)):
        try:
            found = differences(scene)
        except (mb.DeclarationError, mb.AssemblyError, mb.SimulationError) as error:
            text = str(error).splitlines()[0][:150]
            alone, told = (alone + 1, told) if "are not possible" in text else (alone, told + 1)
            print(f"{name:44s} {text}", flush=True)
            continue
        bad += [] if found.good else [name]
        print(f"{name:44s} {found.accelerations:.1e} {found.reactions:.1e} {found.trajectory:.1e} {found.certain}"
              f"{'' if found.good else '  BAD'}", flush=True)  # fmt: skip
    print(f"{alone} without joints that carry bodies, {told} refused or broken down, {len(bad)} bad: {bad}")


def declared() -> Iterator[tuple[str, mb.Scene]]:
    for module in pkgutil.iter_modules(models.__path__):
        make = getattr(importlib.import_module(f"models.{module.name}"), "scene", None)
        if make is not None:
            scene = make()
            yield module.name, replace(scene, start={**scene.start, **STARTS.get(module.name, {})})
    for problem in problems.all_problems():
        yield problem.name, problem.make()


def random(number: int, seed: int, first: int) -> Iterator[tuple[str, mb.Scene]]:
    for k in range(first, first + number):
        rng = np.random.default_rng([seed, k])
        if k % 2:
            yield f"{k} tree", tree_scene(rng, k, planar=rng.random() < 0.5)
        else:
            m = draw(rng)
            times = np.linspace(0, m.span, STATES) * m.units.time
            yield f"{k} {m.kind}", mb.Scene(mb.System(*m.elements), m.start, times, guess=m.pose)


def tree_scene(rng: np.random.Generator, seed: int, planar: bool) -> mb.Scene:
    """A random tree of all kinds of joints, started from a random state of its joints."""
    system = tree(seed, planar)
    hinges = [e for e in system.elements if isinstance(e, mb.Revolute)]
    motors = [mb.Actuator(f"{e.name}_motor", e, -0.3 * e.angle_rate - 0.5 * ca.sin(e.angle)) for e in hinges]
    system = mb.System(*system.elements, *motors, parameters=system.parameters)
    joints = system.joint_space()
    q, v = random_state(rng, joints)
    of_bodies = ca.Function("of_bodies", [joints.q, joints.v, joints.s, joints.p], [*joints.joints.of_bodies[:2]])
    q, v = (part.full().ravel() for part in of_bodies(q, 0.3 * v, [], joints.parameters.nominal))
    names, start = system.collected, {}
    for body in system.bodies:
        if body.frame.v.numel() == 6:
            at = names.q_names.index(f"{body.name}.x")
            e = q[at + 3 : at + 7]
            start[f"{body.name}.rotation"] = mb.rotation(
                tuple(e[1:]), 2 * float(np.arctan2(np.linalg.norm(e[1:]), e[0]))
            )
    start |= {name: value for name, value in zip(names.q_names, q, strict=True) if not name[-2:-1] == "e"}
    start |= dict(zip(names.v_names, v, strict=True))
    return mb.Scene(system, start, np.linspace(0, 0.5, STATES))


def differences(scene: mb.Scene) -> Differences:
    """Differences between the formulations of a scene, which runs in coordinates of joints."""
    system = scene.system
    times = np.linspace(scene.times[0], scene.times[-1], STATES)
    states = ca.vertcat(system.q, system.v)
    scene = replace(scene.with_times(times), coordinates="joint")
    scene = scene.with_outputs({f"x{i}": states[i] for i in range(states.numel())})
    rates = scene.with_outputs({f"a{i}": system.vdot[i] for i in range(system.v.numel())})
    bodies, joints, *_ = formulations(rates)
    solver = mb.EventDriven() if bodies.dae.impacts is not None else mb.CVODES(rtol=1e-12)
    run, other = (
        mb.simulate(replace(scene, coordinates=coordinates), solver, check=True) for coordinates in ("joint", "body")
    )
    trajectory, certain = compared(run, other)
    space = system.joint_space()
    x = ca.vertcat(system.q, system.v, system.s)
    of_joints = ca.Function("of_joints", [x, system.p], [ca.densify(ca.vertcat(*space.joints.of_joints))])
    p = bodies.dae.p_nominal
    a, free, reactions = [], [], []
    for x_b, t in zip(run.x, times, strict=True):
        x_b = consistent(bodies.dae, x_b, p, float(t))
        by_joints = joints.y(of_joints(x_b, p), p, t).full().ravel()
        by_bodies = bodies.y(x_b, p, t).full().ravel()
        a.append((by_joints, by_bodies))
        free.append(free_acceleration(bodies.dae, x_b, p, float(t)))
        reactions.append(difference_of_reactions(bodies.dae, x_b, p, float(t), by_joints))
    by_joints, by_bodies = np.array(a).transpose(1, 0, 2)
    return Differences(
        relative(by_joints, by_bodies, np.array(free)), float(np.nanmax([*reactions, -1.0])), trajectory, certain
    )


def consistent(dae: DAE, x: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
    """The state of the bodies (n_x,) moved least until all rows hold: errors of runs grow, and rows drift with them."""
    if dae.min_norm_correction is None or dae.Phi_dot is None:
        return x
    q, v, s = (ca.DM(part) for part in np.split(x, [dae.n_q, dae.n_q + dae.n_v]))
    rest = (*([s] if dae.n_s else []), p, t)
    for _ in range(NEWTON_STEPS):
        if dae.Phi is not None:
            r = ca.vertcat(dae.Phi(q, v, *rest), ca.DM.zeros(dae.n_r - dae.n_c))
            q = dae.retract(q, dae.min_norm_correction(q, v, *rest, -r))
        v = v + dae.min_norm_correction(q, v, *rest, -dae.Phi_dot(q, v, *rest))
    return ca.vertcat(q, v, s).full().ravel()


def compared(run: mb.Trajectory, other: mb.Trajectory) -> tuple[float, int]:
    """The largest difference of two runs over the sizes of their outputs, up to where their errors are certain."""
    size = np.maximum(np.abs(other.values).max(axis=0), 1e-3 * np.abs(other.values).max(initial=1e-300))
    assert run.error is not None and other.error is not None
    error = np.maximum(run.error, other.error) / size
    certain = int(np.argmax([*(error.max(axis=1) > CERTAIN), True]))
    return float((np.abs(run.values - other.values) / size)[:certain].max(initial=0.0)), certain


def difference_of_reactions(dae: DAE, x: np.ndarray, p: np.ndarray, t: float, a: np.ndarray) -> float:
    """Multipliers of the body equations against those that accelerations `a` need; nan where they are not unique."""
    if dae.G is None:
        return float("nan")
    at = [*np.split(x, [dae.n_q, dae.n_q + dae.n_v])[: 3 if dae.n_s else 2], p, t]
    G, M, Q = (f(*at).full() for f in (dae.G, dae.M, dae.Q))
    unit = G * dae.displacement_scales / dae.row_scales[: len(G), None]
    if np.linalg.svd(unit, compute_uv=False)[-1] < 1e-3:
        return float("nan")
    forces = (M @ a - Q.ravel()) * dae.displacement_scales
    needed = np.linalg.lstsq(unit.T, forces, rcond=None)[0]
    told = dae.forward(*at, dae.gamma(*at))[1].full().ravel() * dae.row_scales[: len(G)]
    return float(
        np.abs(needed + told).max() / max(np.abs(told).max(), np.abs(Q.ravel() * dae.displacement_scales).max())
    )


def free_acceleration(dae: DAE, x: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
    """Accelerations (n_v,) of the bodies without joints: what rows cancel leaves rounding of this size."""
    at = [*np.split(x, [dae.n_q, dae.n_q + dae.n_v])[: 3 if dae.n_s else 2], p, t]
    return np.linalg.lstsq(dae.M(*at).full(), dae.Q(*at).full().ravel(), rcond=None)[0]


def relative(a: np.ndarray, b: np.ndarray, free: np.ndarray) -> float:
    size = max(np.abs(b).max(initial=0.0), np.abs(free).max(initial=0.0), 1e-300)
    return float(np.abs(a - b).max(initial=0.0) / size)


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
