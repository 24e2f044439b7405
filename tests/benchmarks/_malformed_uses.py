"""What malformed calls return is put to use: a fault that hides in a value shows when the value is used."""

import re
from typing import Any

import casadi as ca
import numpy as np

import symmb as mb
from symmb.bound.methods.method import Method
from symmb.declare.mechanics import AbstractBody, Element, Point
from symmb.run.integrate import Solver

T = np.linspace(0.0, 0.2, 5)
DECAY = mb.FunctionSimulator(lambda **p: np.exp(-p["l"] * T), {"l": 1.0}, T, ["x"])
BOX = mb.Box(l=(0.95, 1.05))
LONG = 10_000
"""Runs or steps from which on a use may take longer than the time for a call, as the user asked for."""


def swing() -> mb.Scene:
    """A pendulum with one parameter."""
    p = mb.Parameters(l=1.0)
    bob = mb.Body("bob", 1.0, pose=mb.Particle())
    rod = mb.Distance("rod", mb.Ground().point(0, 0), bob.point(0, 0), p.l)
    system = mb.System(bob, rod, mb.Gravity(0, -9.81), parameters=p)
    return mb.Scene(system, {"bob.x": p.l, "bob.vz": 0.0, "bob.z": 0.0}, T, {"y": bob.y}, BOX)


SCENE = swing()
BALL, ORIGIN, STEEL = (
    mb.Body("ball", 1.0, pose=mb.Particle()),
    mb.Ground().point(0, 0),
    mb.Material(2e11, 7800.0, nu=0.3),
)
LAWS = (
    (
        mb.HuntCrossley | mb.KelvinVoigt | mb.Flores | mb.LankaraniNikravesh | mb.Tabulated,
        lambda law: mb.Contact("contact", BALL.point(0, 0), ORIGIN, (0, 1, 0), law),
    ),
    (mb.Coulomb | mb.Bristle, lambda law: mb.Friction("friction", ORIGIN, BALL.point(0, 0), (1, 0, 0), 10.0, law)),
    (mb.GasSpring | mb.Orifice, lambda law: mb.NonlinearSpring("gas", ORIGIN, BALL.point(0, 0), law)),
)
"""Laws, and elements that act by them."""
AROUND: list[Any] = []
PARAMETERS: list[mb.Parameters] = []
"""What the elements of the calls act on, and the parameters there: `malformed.py` lists its own."""


def use(result: Any) -> str:
    """Use a result; what is wrong with it, empty if nothing."""
    steps = getattr(result, "steps", 1)  # of a swarm or a solver
    if isinstance(result, Method) and not _is_long(result.planned_runs(1)) and not _is_long(steps):
        result = mb.propagate(DECAY, result, BOX)
    if isinstance(result, Solver) and not _is_long(steps) and not _is_short(result):
        result = mb.simulate(SCENE, result)
    equations(result)
    if isinstance(result, mb.Scene) and not _is_long(len(result.times)) and result.times[-1] - result.times[0] < LONG:
        result = mb.simulate(result)
    if isinstance(result, mb.Section | mb.Material):
        both = (result, STEEL) if isinstance(result, mb.Section) else (mb.Section.circle(0.02), result)
        result = mb.Beam([(0, 0, 0), (1, 0, 0)], *both, elements=2)
    if isinstance(result, mb.Beam) and result.elements < LONG:
        result = mb.FiniteElements.beams(result)
    if (
        isinstance(result, mb.FiniteElements)
        and isinstance(result.positions, np.ndarray)
        and len(result.positions) < 100
    ):
        result = result.modes(count=2, clamped=0)
    if isinstance(result, mb.Modes):
        return "" if np.isfinite(result.frequencies).all() else "frequencies that are not finite"
    if isinstance(result, mb.Table):
        places = np.asarray(result.x, dtype=float)
        between = np.concatenate([places, places[:-1] + 0.5 * (places[1:] - places[:-1])])[:1000]
        values = np.array([float(result(float(x))) for x in between])
        return "" if np.isfinite(values).all() else "a value of the table is not finite"
    if isinstance(result, mb.Bounds):
        whole = bool(np.all(result.lower <= result.upper))
        return "" if whole or result.failed or result.doubts else "bounds without numbers, and without a doubt"
    if isinstance(result, mb.Trajectory):
        return "" if np.isfinite(result.values).all() or result.doubts else "a run that is not finite"
    return ""


def _is_long(number: Any) -> bool:
    return number is not None and number > LONG


def _is_short(solver: Solver) -> bool:
    """Whether fixed steps of a solver are so short that there are many."""
    step = getattr(solver, "step", None)
    return not solver.controls_step and step is not None and T[-1] / step > LONG


def equations(result: Any) -> str:
    """The equations of a system with an element, a law, a stabilization or a body, as a text; empty for others."""
    for kinds, element in LAWS:
        if isinstance(result, kinds):
            result = element(result)
    if isinstance(result, Point):
        result = mb.Force("push", result, (1.0, 0.0, 0.0))
    if isinstance(result, mb.Baumgarte | mb.AugmentedLagrangian | mb.Projection):
        return str(mb.simulate(SCENE, mb.RungeKutta(20, stabilization=result)).values.tolist())
    if isinstance(result, AbstractBody) and not isinstance(result, mb.Ground):
        system = mb.System(result, mb.Gravity(0, -9.81))
    elif isinstance(result, Element):
        system = mb.System(BALL, *AROUND, result, parameters=PARAMETERS[0] if PARAMETERS else None)
    else:
        return ""
    mb.compile_dae(system)
    return str([system.M, system.Phi, system.Psi, system.Q, system.potential_energy])


def digest(result: Any) -> str:
    """The numbers of a result as a text, without addresses and times."""
    if isinstance(result, Method | Solver):
        use(result)
    if text := equations(result):
        return text
    if isinstance(result, mb.Bounds):
        return f"{result.method} {result.lower.tolist()} {result.upper.tolist()}"
    if isinstance(result, mb.Trajectory):
        return f"{result.values.tolist()}"
    if isinstance(result, np.ndarray | float | int):
        return f"{np.asarray(result).tolist()}"
    if isinstance(result, mb.Comparison | mb.Table | mb.Scene | mb.System | mb.DAESimulator | mb.RootLocus):
        return type(result).__name__
    return re.sub(r"0x[0-9a-f]+", "", repr(result) if not isinstance(result, ca.SX) else str(result))[:300]
