"""Problems that try solvers hard, each with a solution known to many digits (tests/data tells where from)."""

import importlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from machines import ORIGIN, ball, bob, free_body

import symmb as mb
from symmb._types import Array

DATA = Path(__file__).parent / "data"


def read(name: str, case: str | None = None) -> dict:
    """What a file of tests/data holds, or what it holds of a case."""
    data = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    return data if case is None else data | data["cases"][case]


KNOWN = read("problems")


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene at some times, what its first outputs are there, and how many digits are known."""

    name: str
    make: Callable[[], mb.Scene]
    values: Array
    digits: float = 12.0

    def error(self, values: Array) -> float:
        """Largest error of outputs (n_t, n_y) over all times, relative where they are larger than 1."""
        found = values[:, : self.values.shape[1]]
        return float((np.abs(found - self.values) / np.maximum(1.0, np.abs(self.values).max(axis=0))).max())


def model(name: str, **variant: object) -> mb.Scene:
    return importlib.import_module(f"models.{name}").scene(**variant)


def andrews() -> Problem:
    known = read("andrews")
    angles = np.array(known["values"])[:, [known["names"].index(name) for name in ANDREWS]]
    return Problem("Andrews", lambda: _keeping(model("andrews").with_times(known["times"]), ANDREWS), angles)


ANDREWS = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")


def car_axis() -> Problem:
    known = read("car_axis")
    names = tuple(known["names"][:8])
    exact = np.array(known["values"])[:, :8]
    return Problem("car axis", lambda: _keeping(model("car_axis").with_times(known["times"]), names), exact)


def flexible_crank(semantics: str = "index_2") -> Problem:
    """The IVP test set's crank; outputs as shares of their largest values.

    index_2 keeps the published start's residual of 2e-10 in the positions; consistent has none.
    """
    known = read("slider_crank_flexible")
    of = known[semantics]
    values = np.array(of["values"])
    largest, first = np.abs(values).max(axis=0), values[0]

    def make() -> mb.Scene:
        start = {"amplitudes": tuple(first[2:]), "rates": tuple(of["rates"]), "offset": 0.45 + first[5] - first[1]}
        scene = model("slider_crank_flexible", published=True, **start)
        shares = {name: scene.outputs[name] / size for name, size in zip(known["names"], largest, strict=True)}
        return scene.with_times(known["times"]).with_outputs(shares)

    return Problem("flexible crank" + ("" if semantics == "index_2" else ", consistent"), make, values / largest, 11)


def pendulum(length: float = 1.0) -> tuple[mb.Body, mb.Revolute]:
    """A point mass on a rod without mass, whose angle is measured from the downward vertical."""
    weight = mb.Body("bob", 1.0, 0.0, mb.Planar())
    return weight, mb.Revolute("pivot", ORIGIN, weight.point(0, length))


def pendulum_179() -> Problem:
    known = KNOWN["pendulum_179"]

    def make() -> mb.Scene:
        weight, pivot = pendulum()
        system, outputs = mb.System(weight, pivot, mb.Gravity(0, -9.81)), {"phi": weight.theta, "rate": weight.omega}
        return mb.Scene(system, {"bob.theta": first[0]}, [0.0, known["time"]], outputs, name="pendulum")

    first = [np.deg2rad(179.0), 0.0]
    return Problem("pendulum, 179 degrees, 1000 periods", make, np.array([first, known["values"]]))


def pendulum_period_2(periods: int = 1000) -> Problem:
    """Cartesian coordinates of a bead at a fixed distance."""
    known = KNOWN["pendulum_period2"]
    times = np.array([*known["times"], *(2 * np.linspace(1, periods, 11)[1:].round())])
    make = lambda: bob(g=known["g"]).scene("x y vx vy", times, {"bob.x": 1.0, "bob.y": 0.0}, name="bead")  # noqa: E731
    values = np.array(known["values"])
    return Problem(f"bead, {periods} periods", make, np.vstack([values, np.tile(values[0], (10, 1))]))


def stiff_spring(k: float, kind: str) -> Problem:
    """A bead on a spring of length 1, at 1 rad from below, from where the spring does not swing or from its length."""
    known = KNOWN["stiff_spring"][f"{k:g} {kind}"]
    r, theta, r_dot, theta_dot = np.array(known["values"]).T
    sine, cosine = np.sin(theta), np.cos(theta)
    speed = (1 + r) * theta_dot
    values = [(1 + r) * sine, -(1 + r) * cosine, r_dot * sine + speed * cosine, -r_dot * cosine + speed * sine]

    def make() -> mb.Scene:
        bead = ball(lambda m: mb.Spring("spring", ORIGIN, m.at, k, 1.0))
        return bead.scene("x y vx vy", known["times"], {"ball.x": values[0][0], "ball.y": values[1][0]}, name="spring")

    digits = 12.0 if kind == "slow_manifold" else 9.0 - np.log10(k) / 6
    return Problem(f"spring, {k:g} N/m, {kind.replace('_', ' ')}", make, np.transpose(values), digits)


def slider_crank(kind: str) -> Problem:
    """With a coupler without mass; or of equal rods, with a slider without mass, through eleven singular positions."""
    known = KNOWN[kind]
    p, start = known["parameters"], known["start"]
    columns = [known["names"].index(name) for name in ("theta", "dtheta", "x_slider", "dx_slider")]

    def make() -> mb.Scene:
        lengths = {name: float(p[name]) for name in ("l1", "l2", "m1", "m2", "m3")}
        scene = model("slider_crank", **lengths, theta=start["theta"], omega=start["omega"]).with_times(known["times"])
        return _keeping(scene, ("theta", "theta_dot", "x_slider", "x_slider_dot"))

    return Problem(f"slider-crank, {kind.replace('_', ' ')}", make, np.array(known["values"])[:, columns])


def n_four_bar(n: int, until: int = 10) -> Problem:
    known = KNOWN["n_four_bar"]
    exact = np.array(known["values"][str(n)])[: until + 1]
    make = lambda: model("n_four_bar", N=n).with_times(known["times"][: until + 1])  # noqa: E731
    return Problem(f"{n} windows, {until} s", make, exact)


def fast_top() -> Problem:
    known = KNOWN["fast_top"]

    def make() -> mb.Scene:
        machine = free_body(inertia=known["inertia"])
        outputs = {name: machine.top.omega[i] for i, name in enumerate(("wx", "wy", "wz"))}
        outputs |= {f"e{i}": machine.system.q[3 + i] for i in range(4)}
        return machine.scene(outputs, known["times"], {"top.omega": tuple(known["omega"])}, name="top")

    return Problem("top at 1e4 rad/s", make, np.hstack([known["omega_body"], known["quaternion"]]))


def four_bar_in_space() -> Problem:
    """The planar four-bar of spatial bodies: twenty rows for eighteen velocities, three of them redundant."""
    known = KNOWN["four_bar"]
    p = known["parameters"]
    a, b, c, base = (float(p[name]) for name in ("crank", "coupler", "rocker", "ground"))

    def make() -> mb.Scene:
        theta = known["start"]["theta"]
        x, y = base - a * np.cos(theta), -a * np.sin(theta)
        distance = np.hypot(x, y)
        middle = np.arctan2(y, x) + np.arccos((b**2 + distance**2 - c**2) / (2 * b * distance))
        last = np.arctan2(b * np.sin(middle) - y, b * np.cos(middle) - x)
        angles = {"crank": theta, "coupler": middle, "rocker": last}
        bodies, ends, ground = [], [], mb.Ground()
        for name, size, m in zip(angles, (a, b, c), p["m"], strict=True):
            bodies.append(mb.Body(name, m, (1e-3 * m, m * size**2 / 12, m * size**2 / 12), mb.Spatial()))
            ends.append([bodies[-1].point(side * size / 2, 0, 0) for side in (-1, 1)])
        first, coupler, rocker = ends
        pairs = (ground.point(0, 0, 0), first[0]), (first[1], coupler[0]), (coupler[1], rocker[1])
        pairs = *pairs, (ground.point(base, 0, 0), rocker[0])
        joints = [mb.Revolute(name, *pair) for name, pair in zip("ABCD", pairs, strict=True)]
        system = mb.System(*bodies, *joints, mb.Gravity(0, -9.81, 0))
        guess = {f"{name}.rotation": mb.rotation(axis=(0, 0, 1), angle=angle) for name, angle in angles.items()}
        start = {"crank.rotation": guess.pop("crank.rotation"), "crank.omega": (0, 0, known["start"]["omega"])}
        C = coupler[1]
        outputs = {"Cx": C.x, "Cy": C.y, "vCx": C.vx, "vCy": C.vy}
        return mb.Scene(system, start, known["times"], outputs, guess=guess, name="four-bar in space")

    columns = [known["names"].index(name) for name in ("Cx", "Cy", "vCx", "vCy")]
    return Problem("four-bar in space", make, np.array(known["values"])[:, columns])


def windows_in_space(n: int = 2, until: float = 0.6) -> mb.Scene:
    """Windows of spatial bodies: for each window, three rows of its hinges are redundant."""
    ground = mb.Ground()
    cranks, couplers = (
        [mb.Body(f"{name}{i}", 1.0, inertia, mb.Spatial()) for i in range(count)]
        for name, count, inertia in (("crank", n + 1, (1 / 12, 1e-3, 1 / 12)), ("coupler", n, (1e-3, 1 / 12, 1 / 12)))
    )
    joints = [mb.Revolute(f"foot{i}", ground.point(i, 0, 0), c.point(0, -0.5, 0)) for i, c in enumerate(cranks)]
    for i, coupler in enumerate(couplers):
        joints.append(mb.Revolute(f"left{i}", cranks[i].point(0, 0.5, 0), coupler.point(-0.5, 0, 0)))
        joints.append(mb.Revolute(f"right{i}", cranks[i + 1].point(0, 0.5, 0), coupler.point(0.5, 0, 0)))
    B0 = cranks[0].point(0, 0.5, 0)
    system = mb.System(*cranks, *couplers, *joints, mb.Gravity(0, -9.81, 0))
    start = {"crank0.rotation": mb.rotation(axis=(0, 0, 1), angle=0.0), "crank0.omega": (0, 0, -1.0)}
    outputs = {"B0_x": B0.x, "B0_y": B0.y, "B0_x_dot": B0.vx, "B0_y_dot": B0.vy}
    guess = {f"coupler{i}.{x}": value for i in range(n) for x, value in (("x", i + 0.5), ("y", 1.0))}
    guess |= {f"crank{i}.{x}": value for i in range(n + 1) for x, value in (("x", float(i)), ("y", 0.5))}
    return mb.Scene(system, start, np.linspace(0, until, 7), outputs, guess=guess, name=f"{n} windows in space")


def all_problems() -> tuple[Problem, ...]:
    """From short to long."""
    springs = [stiff_spring(k, kind) for k in (1e2, 1e4, 1e6) for kind in ("slow_manifold", "natural_length")]
    cranks = slider_crank("massless_coupler"), slider_crank("dead_point")
    first = andrews(), car_axis(), flexible_crank(), flexible_crank("consistent"), *springs, fast_top()
    last = n_four_bar(2), n_four_bar(40, 20), pendulum_period_2(), pendulum_179()
    return *first, four_bar_in_space(), *cranks, *last


def _keeping(scene: mb.Scene, names: tuple[str, ...]) -> mb.Scene:
    return scene.with_outputs({name: scene.outputs[name] for name in names})
