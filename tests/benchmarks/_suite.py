"""Scenes and boxes on which estimated errors are judged, with references: some to tune on, others to report."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb
from models import (
    andrews,
    car_axis,
    cubic,
    double_pendulum,
    four_bar,
    heavy_top,
    rolling_disc,
    slider_crank,
    slider_crank_spatial,
    spherical_pendulum,
)
from symmb import DAESimulator
from symmb.bound.methods.method import Method
from symmb.bound.reductions import bounded


@dataclass(frozen=True)
class Case:
    """A scene with a box, how its reference is made, and whether estimates were tuned on it."""

    name: str
    make: Callable[[], mb.Scene]
    reference: tuple[Method, ...]
    tuned: bool


def chain(n: int, end: float) -> mb.Scene:
    """n rods released at 0.5 rad, with a length and a mass each, known to 5 %."""
    p = mb.Parameters(**{f"{name}{i}": 1 / n for i in range(n) for name in ("l", "m")})
    lengths, masses = ([getattr(p, f"{name}{i}") for i in range(n)] for name in ("l", "m"))
    rods = [
        mb.Body(f"rod{i}", m, m * length**2 / 12, mb.Planar())
        for i, (length, m) in enumerate(zip(lengths, masses, strict=True))
    ]
    ends = [mb.Ground().point(0, 0), *(rod.point(0, -length / 2) for rod, length in zip(rods, lengths, strict=True))]
    joints = [mb.Revolute(f"joint{i}", ends[i], rod.point(0, lengths[i] / 2)) for i, rod in enumerate(rods)]
    return mb.Scene(
        mb.System(*rods, *joints, mb.Gravity(0, -9.81), parameters=p),
        start={f"{rod.name}.theta": 0.5 for rod in rods},
        times=np.linspace(0.0, end, 51),
        outputs={f"{kind}{i}": getattr(rod, kind) for i, rod in enumerate(rods) for kind in ("theta", "omega")},
        box=mb.Box.around(p, 0.05),
        name=f"{n} rods, {2 * n} parameters, {end:g} s",
    )


def stop(names: tuple[str, ...]) -> mb.Scene:
    """A ball on a spring that hits a stiffer one: a kink in the force, reached at another time for each sample."""
    p = mb.Parameters(k=20.0, wall=400.0, gap=0.3)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    depth = ca.fmax(ball.x - p.gap, 0)
    force = mb.Force("springs", ball.point(0, 0), (-p.k * ball.x - p.wall * depth, 0))
    system = mb.System(ball, force, parameters=p)
    times, outputs = np.linspace(0.0, 4.0, 201), {"x": ball.x, "v": ball.vx}
    return mb.Scene(system, {"ball.x": -0.5}, times, outputs, box=mb.Box.around(p, 0.05, names=list(names)))


def duffing(end: float) -> mb.Scene:
    """A driven hardening spring, one parameter, many periods."""
    p = mb.Parameters(k=1.0)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    force = mb.Force("spring", ball.point(0, 0), (-ball.x - p.k * ball.x**3 + ca.cos(1.3 * mb.t) / 3, 0))
    system = mb.System(ball, force, parameters=p)
    times, outputs = np.linspace(0.0, end, 401), {"x": ball.x, "v": ball.vx}
    return mb.Scene(system, {"ball.x": 0.5}, times, outputs, box=mb.Box.around(p, 0.1))


def driven(end: float) -> mb.Scene:
    """A rod on a hinge that is driven up and down, damped, two parameters."""
    p = mb.Parameters(length=1.0, damping=0.1)
    rod = mb.Body("rod", 1.0, p.length**2 / 12, mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0.1 * ca.sin(3 * mb.t)), rod.point(0, p.length / 2))
    drag = mb.Torque("drag", rod, -p.damping * rod.omega)
    system = mb.System(rod, hinge, drag, mb.Gravity(0, -9.81), parameters=p)
    times, outputs = np.linspace(0.0, end, 401), {"theta": rod.theta, "omega": rod.omega}
    return mb.Scene(system, {"rod.theta": 1.2}, times, outputs, box=mb.Box.around(p, 0.05))


def elastic_pendulum() -> mb.Scene:
    """A particle on a spring that swings, three parameters."""
    p = mb.Parameters(k=40.0, rest=1.0, mass=1.0)
    ball = mb.Body("ball", p.mass, pose=mb.Particle())
    length = ca.sqrt(ball.x**2 + ball.y**2)
    pull = -p.k * (1 - p.rest / length)
    force = mb.Force("spring", ball.point(0, 0), (pull * ball.x, pull * ball.y))
    system = mb.System(ball, force, mb.Gravity(0, -9.81), parameters=p)
    times, outputs = np.linspace(0.0, 5.0, 251), {"x": ball.x, "y": ball.y, "vx": ball.vx, "vy": ball.vy}
    return mb.Scene(system, {"ball.x": 0.8, "ball.y": -1.0}, times, outputs, box=mb.Box.around(p, 0.05))


def rubbing() -> mb.Scene:
    """A ball on a spring that rubs on a moving belt, a steep friction law, two parameters."""
    p = mb.Parameters(k=10.0, friction=2.0)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    slip = ball.vx - 0.5
    force = mb.Force("belt", ball.point(0, 0), (-p.k * ball.x - p.friction * ca.tanh(50 * slip), 0))
    system = mb.System(ball, force, parameters=p)
    times, outputs = np.linspace(0.0, 6.0, 301), {"x": ball.x, "v": ball.vx}
    return mb.Scene(system, {"ball.x": 0.6}, times, outputs, box=mb.Box.around(p, 0.1))


def between_walls() -> mb.Scene:
    """A ball on a spring between two stiffer ones, four parameters."""
    p = mb.Parameters(k=10.0, left=0.25, right=0.3, wall=300.0)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    push = p.wall * (ca.fmax(-p.left - ball.x, 0) - ca.fmax(ball.x - p.right, 0))
    force = mb.Force("springs", ball.point(0, 0), (push - p.k * ball.x, 0))
    system = mb.System(ball, force, parameters=p)
    times, outputs = np.linspace(0.0, 1.5, 76), {"x": ball.x, "v": ball.vx}
    return mb.Scene(system, {"ball.x": 0.0, "ball.vx": 2.0}, times, outputs, box=mb.Box.around(p, 0.03))


def crane() -> mb.Scene:
    """A trolley on a spring with a load on a rod, five parameters."""
    p = mb.Parameters(trolley=5.0, load=2.0, length=1.5, k=60.0, drive=20.0)
    trolley = mb.Body("trolley", p.trolley, 1.0, mb.Planar())
    load = mb.Body("load", p.load, 0.01, mb.Planar())
    rail = mb.Prismatic("rail", mb.Ground().point(0, 0), trolley.point(0, 0), axis=(1, 0))
    rope = mb.Revolute("rope", trolley.point(0, 0), load.point(0, p.length))
    push = mb.Force("drive", trolley.point(0, 0), (p.drive * ca.sin(2 * mb.t) - p.k * trolley.x, 0))
    system = mb.System(trolley, load, rail, rope, push, mb.Gravity(0, -9.81), parameters=p)
    times, outputs = np.linspace(0.0, 4.0, 101), {"x": trolley.x, "theta": load.theta, "omega": load.omega}
    return mb.Scene(system, {"load.theta": 0.4}, times, outputs, box=mb.Box.around(p, 0.05))


def boxed(scene: mb.Scene, spread: float) -> mb.Scene:
    """The scene with the parameters of its box known to a share."""
    return scene.with_box(mb.Box.around(scene.system.parameters, spread, names=list(scene.box.names)))


def _tensor(order: int) -> tuple[Method, ...]:
    return tuple(mb.PolynomialChaos(order=k, range=mb.Exact(1e-5, 100_000)) for k in (order // 2, order))


def _scan(points: int) -> tuple[Method, ...]:
    return mb.Scanning((points + 1) // 2), mb.Scanning(points)


def _many(runs: int) -> tuple[Method, ...]:
    return mb.PolynomialChaos(tolerance=1e-9, budget=runs // 2), mb.PolynomialChaos(tolerance=1e-9, budget=runs)


CASES = (
    Case("pendulum 5 %", double_pendulum.scene, _tensor(32), True),
    Case("pendulum 20 %", lambda: boxed(double_pendulum.scene(), 0.2), _tensor(64), True),
    Case("slider-crank 2 %", slider_crank.scene, _tensor(32), True),
    Case("four-bar 1 %", four_bar.scene, _many(4000), True),
    Case("heavy top", heavy_top.scene, _tensor(32), True),
    Case("spherical pendulum 5 %", spherical_pendulum.scene, _tensor(32), True),
    Case("stop, 1 parameter", lambda: stop(("gap",)), _scan(4001), True),
    Case("stop, 2 parameters", lambda: stop(("gap", "k")), _scan(301), True),
    Case("stop, 3 parameters", lambda: stop(("gap", "k", "wall")), _scan(61), True),
    Case("Duffing, 60 s", lambda: duffing(60.0), _tensor(64), True),
    Case("Duffing, 15 s", lambda: duffing(15.0), _tensor(64), True),
    Case("3 rods, 1 s", lambda: chain(3, 1.0), _many(4000), True),
    Case("3 rods, 2 s", lambda: chain(3, 2.0), _many(4000), True),
    Case("2 rods, 2 s", lambda: chain(2, 2.0), _many(4000), True),
    Case("cubic", cubic.scene, _tensor(8), True),
    Case("Andrews", andrews.scene, _tensor(16), False),
    Case("car axis", car_axis.scene, _tensor(16), False),
    Case("rolling disc", rolling_disc.scene, _tensor(32), False),
    Case("slider-crank in space", slider_crank_spatial.scene, _tensor(16), False),
    Case("driven pendulum, 20 s", lambda: driven(20.0), _tensor(32), False),
    Case("elastic pendulum", elastic_pendulum, _tensor(16), False),
    Case("rubbing, 2 parameters", rubbing, _scan(301), False),
    Case("between walls", between_walls, _scan(21), False),
    Case("crane, 5 parameters", crane, _many(4000), False),
)


def simulator_of(case: Case) -> tuple[DAESimulator, mb.Box]:
    """The simulator of a case at a tight tolerance, and its box."""
    scene = case.make()
    return DAESimulator(scene, mb.DormandPrince(rtol=1e-10)), scene.box


def reference_of(case: Case, simulator: DAESimulator, box: mb.Box) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper bounds (n_t, n_y), and how far two resolutions differ."""
    coarse, fine = (bounded(method, simulator, box) for method in case.reference)
    change = np.maximum(np.abs(fine.lower - coarse.lower), np.abs(fine.upper - coarse.upper))
    return fine.lower, fine.upper, change
