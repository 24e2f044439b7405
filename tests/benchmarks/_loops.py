"""Random mechanisms with one closed loop or two, as scenes and in closed form, for `loop_proofs`.

In closed form all points are expressions of one coordinate phi, the angle of a crank, by intersections of circles and
lines. Its equation is Lagrange's, m(phi) phi'' + m'(phi) phi'^2 / 2 = Q, and forces in joints follow from Newton's and
Euler's laws of all bodies. Nothing of symmb is used for it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

FINE, LONGEST = 1e-13, 0.02
"""Relative tolerance and longest step [s] of the runs."""
G = 9.81

Point = tuple[Any, Any]


def circles(P: Point, Q: Point, a: Any, b: Any, side: float) -> Point:
    """The point at the distances a from P and b from Q, to the left of the way from P to Q where side = 1."""
    dx, dy = Q[0] - P[0], Q[1] - P[1]
    d2 = dx * dx + dy * dy
    along = 0.5 * (d2 + a * a - b * b) / d2
    across = side * ca.sqrt(a * a / d2 - along * along)
    return P[0] + along * dx - across * dy, P[1] + along * dy + across * dx


def beyond(P: Point, Q: Point, share: float, across: float = 0.0) -> Point:
    """The point at a share of the way from P to Q, and as far to its left."""
    dx, dy = Q[0] - P[0], Q[1] - P[1]
    return P[0] + share * dx - across * dy, P[1] + share * dy + across * dx


@dataclass
class Bar:
    """A body between two points, whose centre of mass is at a share of the way; or one at A that does not turn."""

    A: Point
    B: Point
    length: Any
    mass: Any
    inertia: Any
    share: float = 0.5
    slides: bool = False

    @property
    def pose(self) -> tuple[Any, Any, Any]:
        """Place of the centre of mass, and angle."""
        if self.slides:
            return *self.A, ca.SX(0)
        return *beyond(self.A, self.B, self.share), ca.atan2(self.B[1] - self.A[1], self.B[0] - self.A[0])

    def local(self, along: float, across: float = 0.0) -> tuple[Any, ...]:
        """A point in the axes of the body, by shares of the length."""
        return (0.0, 0.0) if self.slides else ((along - self.share) * self.length, across * self.length)


@dataclass
class Hinge:
    """What a joint transmits at a point to body b, and the opposite to body a; None is the ground."""

    a: str | None
    b: str
    at: Point
    on_a: tuple[float, ...] = (1.0,)  # places on the bodies, by shares of their lengths
    on_b: tuple[float, ...] = (0.0,)
    parts: str = "xy"  # forces along x and y, and a torque "t"


@dataclass
class Plan:
    """A planar mechanism: bodies, joints, and what pulls at it.

    Attributes
    ----------
    push : body, and the law of a torque on it, by the angle, the rate and the time
    spring : body, ground point, stiffness, damping and length of a spring at the middle of the body
    gear : the bodies that it couples and the ratio
    """

    bars: dict[str, Bar]
    hinges: dict[str, Hinge]
    push: tuple[str, Callable] | None = None
    spring: tuple[str, Point, Any, Any, Any] | None = None
    gear: tuple[str, str, float] | None = None


@dataclass
class Case:
    """A mechanism as a scene, and what is known of it in closed form.

    Attributes
    ----------
    runs : P (N, n_p) -> outputs (N, n_t, n_y), not a number where no solution is known
    ends : P (n_p,) -> time from which on there is no solution, or more than one; infinite where there always is one
    starts : whether it can be started with all parameters of the box
    """

    kind: str
    scene: mb.Scene
    runs: Callable[[np.ndarray], np.ndarray]
    ends: Callable[[np.ndarray], float] = field(default=lambda p: np.inf)
    starts: bool = True


class Coordinate:
    """The motion phi(t) of a coordinate, and of outputs, from expressions in SX symbols phi, v = phi', a = phi'', t, p.

    Parameters
    ----------
    reduced, force : mass of the coordinate, and its generalised force
    start : phi and v at the first time
    law : phi(t) of a mechanism that is driven
    """

    def __init__(self, at: SimpleNamespace, reduced: Any, force: Any, start: tuple[Any, Any], law: Any = None) -> None:
        half = 0.5 * ca.gradient(reduced, at.phi)
        self._law = None
        if law is not None:
            rate = ca.jacobian(law, at.t)
            self._law = ca.Function("law", [at.t, at.p], [law, rate, ca.jacobian(rate, at.t)])
        self.drive = reduced * at.a + half * at.v**2 - force
        self._f = ca.Function("f", [at.phi, at.v, at.t, at.p], [(force - half * at.v**2) / reduced])
        self._start = ca.Function("start", [at.p], [ca.SX(value) for value in start])

    def __call__(self, P: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Coordinate, rate and acceleration (3, N, n_t) at P (N, n_p); not a number from where a run fails."""
        if self._law is not None:
            return np.array(mapped(self._law, np.tile(times, len(P)), P.repeat(len(times), axis=0)))[..., 0].reshape(
                3, len(P), len(times))  # fmt: skip
        z = np.concatenate([value.ravel() for value in mapped(self._start, P)])

        def rates(t: float, z: np.ndarray) -> np.ndarray:
            phi, v = z.reshape(2, -1)
            return np.concatenate([v, mapped(self._f, phi, v, np.full(len(P), t), P)[0].ravel()])

        found = np.full((2 * len(P), len(times)), np.nan)
        run = solve_ivp(rates, (times[0], times[-1]), z, method="DOP853", rtol=FINE, atol=1e-15, t_eval=times,
                        max_step=LONGEST)  # fmt: skip
        if not run.success and len(P) > 1:
            return np.concatenate([self(part, times) for part in np.array_split(P, 2)], axis=1)
        found[:, : len(run.t)] = run.y
        phi, v = found.reshape(2, len(P), -1)
        at = phi.ravel(), v.ravel(), np.tile(times, len(P)), P.repeat(len(times), axis=0)
        return np.array([phi, v, mapped(self._f, *at)[0].reshape(phi.shape)])


def mapped(f: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    """A Function at N points, all arguments (N,) or (N, n): values (N, size), or (N, rows, columns) of matrices."""
    N = len(arguments[-1])
    values = f.map(N)(*(np.atleast_2d(a) if a.ndim == 1 else a.T for a in arguments))
    found = []
    for i, value in enumerate(values if isinstance(values, tuple) else (values,)):
        rows, columns = f.size_out(i)
        found.append(value.full().reshape(rows, N, columns).swapaxes(0, 1))
    return [value[..., 0] if value.shape[2] == 1 else value for value in found]


def symbols(names: list[str]) -> SimpleNamespace:
    """The coordinate, its rates, the time and parameters of a mechanism in closed form."""
    phi, v, a, t = (ca.SX.sym(name) for name in ("phi", "v", "a", "t"))
    p = ca.SX.sym("p", len(names))
    named = SimpleNamespace(**dict(zip(names, ca.vertsplit(p), strict=True))) if names else SimpleNamespace()
    return SimpleNamespace(phi=phi, v=v, a=a, t=t, p=p, named=named)


def planar_case(
    kind: str,
    values: dict[str, float],
    plan: Callable[[Any, Any], Plan],
    start: Callable[[Any], tuple[Any, Any]],
    times: np.ndarray,
    box: dict[str, tuple[float, float]],
    watched: tuple[str, str],
    law: Callable[[Any, Any], Any] | None = None,
    spatial: bool = False,
    gravity: float = G,
    start_of: dict[str, str] | None = None,
    **others: Any,
) -> Case:
    """A case from its plan, which is a function of parameters and of the angle of the body "crank".

    Parameters
    ----------
    watched : the body and the joint that outputs tell of
    start_of : the start of the scene by names of parameters, where it is not that of the crank
    """
    at = symbols(list(values))
    own, body, joint = plan(at.named, at.phi), *watched
    coordinate, outputs = _closed_form(at, own, body, joint, start(at.named), law, gravity)
    nominal = np.array(list(values.values()))
    p0 = float(start(SimpleNamespace(**values))[0])
    poses = ca.Function("poses", [at.phi, at.p], [ca.vertcat(*(ca.vertcat(*bar.pose) for bar in own.bars.values()))])
    guess = poses(p0, nominal).full().reshape(-1, 3)
    guess[list(own.bars).index("crank"), 2] = p0  # a guess that is a turn off leads to another assembly
    p = mb.Parameters(**values)
    scene = _scene(kind, values, plan, start(p), p, times, box, watched, law, spatial, gravity, start_of, guess)
    first = guess[list(own.bars).index(body), 2]

    def runs(P: np.ndarray) -> np.ndarray:
        at = [value.ravel() for value in coordinate(P, times)]
        found = outputs(*at, np.tile(times, len(P)), P.repeat(len(times), axis=0)).reshape(len(P), len(times), -1)
        found[..., 0] = first + np.arctan2(np.sin(found[..., 0] - first), np.cos(found[..., 0] - first))
        return found[..., 2:] if spatial else found

    return Case(kind, scene, runs, **others)


def _closed_form(
    at: SimpleNamespace, plan: Plan, body: str, joint: str, start: tuple[Any, Any], law: Any, gravity: float
) -> tuple[Coordinate, Callable[..., np.ndarray]]:
    names, bars = list(plan.bars), list(plan.bars.values())
    y = ca.vertcat(*(ca.vertcat(*bar.pose) for bar in bars))
    M = ca.vertcat(*(ca.vertcat(bar.mass, bar.mass, bar.inertia) for bar in bars))
    along = ca.jacobian(y, at.phi)
    curved = ca.jacobian(along, at.phi)
    F = ca.vertcat(*(ca.vertcat(0, -gravity * bar.mass, 0) for bar in bars))
    if plan.push:
        name, torque = plan.push
        k = 3 * names.index(name) + 2
        F[k] += torque(y[k], along[k] * at.v, at.t)
    if plan.spring:
        name, (xg, yg), stiffness, damping, length = plan.spring
        k = 3 * names.index(name)
        dx, dy = y[k] - xg, y[k + 1] - yg
        now = ca.sqrt(dx * dx + dy * dy)
        rate = ca.gradient(now, at.phi) * at.v
        pull = stiffness * (now - length) + damping * rate
        F[k] -= pull * dx / now
        F[k + 1] -= pull * dy / now
    reduced, force = ca.dot(along, M * along), ca.dot(along, F)
    coordinate = Coordinate(at, reduced, force, start, None if law is None else law(at.named, at.t))
    inertia = M * (along * at.a + curved * at.v**2) - F
    columns, ours = [], {}
    for name, hinge in plan.hinges.items():
        for part in hinge.parts:
            ours[name, part] = len(columns)
            columns.append(_column(names, y, hinge, part))
    if law is not None:
        columns.append(_unit(len(names), {3 * names.index("crank") + 2: 1}))
    if plan.gear:  # torques that do no work together
        a, b, ratio = plan.gear
        columns.append(_unit(len(names), {3 * names.index(a) + 2: -ratio, 3 * names.index(b) + 2: 1}))
    k = 3 * names.index(body)
    shown = ca.vertcat(y[k + 2], along[k + 2] * at.v, y[k], y[k + 1], along[k] * at.v)
    f = ca.Function("shown", [at.phi, at.v, at.a, at.t, at.p],
                    [shown, ca.densify(ca.horzcat(*columns)), ca.densify(inertia)])  # fmt: skip
    force_at = [ours[joint, part] for part in "xy"]

    def outputs(*arguments: np.ndarray) -> np.ndarray:
        values, A, b = mapped(f, *arguments)
        known = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(b).all(axis=1)
        found = np.full((len(b), values.shape[1] + 2 + (law is not None)), np.nan)
        forces = (np.linalg.pinv(A[known], rcond=1e-12) @ b[known, :, None])[..., 0]
        more = [forces[:, [len(columns) - 1 - bool(plan.gear)]]] if law is not None else []
        found[known] = np.hstack([values[known], forces[:, force_at], *more])
        return found

    return coordinate, outputs


def _unit(n: int, entries: dict[int, Any]) -> Any:
    column = ca.SX(3 * n, 1)
    for k, value in entries.items():
        column[k] = value
    return column


def _column(names: list[str], y: Any, hinge: Hinge, part: str) -> Any:
    """What a unit of a force along x or y, or of a torque, does to the rows of all bodies."""
    entries: dict[int, Any] = {}
    for name, sign in ((hinge.b, 1.0), (hinge.a, -1.0)):
        if name is None:
            continue
        k = 3 * names.index(name)
        rx, ry = hinge.at[0] - y[k], hinge.at[1] - y[k + 1]
        if part == "t":
            entries[k + 2] = sign
        else:
            entries[k + (part == "y")] = sign
            entries[k + 2] = sign * (-ry if part == "x" else rx)
    return _unit(len(names), entries)


def _scene(
    kind: str,
    values: dict[str, float],
    plan: Callable[[Any, Any], Plan],
    start: tuple[Any, Any],
    p: Any,
    times: np.ndarray,
    box: dict[str, tuple[float, float]],
    watched: tuple[str, str],
    law: Callable[[Any, Any], Any] | None,
    spatial: bool,
    gravity: float,
    start_of: dict[str, str] | None,
    guess: np.ndarray,
) -> mb.Scene:
    """The same mechanism in symmb."""
    own, ground, none = plan(p, start[0]), mb.Ground(), (0,) * spatial
    bodies = {}
    for name, bar in own.bars.items():
        inertia = (0.5 * bar.inertia, bar.inertia, bar.inertia) if spatial else bar.inertia
        bodies[name] = mb.Body(name, bar.mass, inertia, mb.Spatial() if spatial else mb.Planar())

    def place(of: str | None, xy: tuple[Any, ...]) -> Any:
        return (ground if of is None else bodies[of]).point(*xy, *none)

    joints: dict[str, Any] = {}
    for name, hinge in own.hinges.items():
        on = hinge.at if hinge.a is None else own.bars[hinge.a].local(*hinge.on_a)
        if "t" in hinge.parts:
            joints[name] = mb.Prismatic(name, place(hinge.a, (0, hinge.at[1])), place(hinge.b, (0, 0)), axis=(1, 0, 0))
        else:
            ends = place(hinge.a, on), place(hinge.b, own.bars[hinge.b].local(*hinge.on_b))
            joints[name] = mb.Revolute(name, *ends, axis=(0, 0, 1))
    crank, hinge = bodies["crank"], joints["O"]
    angle = hinge.angle if spatial else crank.theta
    elements: list[Any] = [*bodies.values(), *joints.values()]
    if law is not None:
        elements.append(mb.Motion("motor", angle, law(p, mb.t)))
    if own.push:
        name, torque = own.push
        about_z = torque(*((angle, hinge.angle_rate) if spatial else (bodies[name].theta, bodies[name].omega)), mb.t)
        elements.append(mb.Torque("push", bodies[name], (0, 0, about_z) if spatial else about_z))
    if own.spring:
        name, xy, stiffness, damping, length = own.spring
        ends = place(None, xy), place(name, (0, 0))
        elements.append(mb.SpringDamper("spring", *ends, stiffness, damping, length))
    if own.gear:
        a, b, ratio = own.gear
        elements.append(mb.Gear("gear", place(a, (0, 0)), place(b, (0, 0)), ratio=ratio))
    if gravity:
        elements.append(mb.Gravity(0, -gravity, 0) if spatial else mb.Gravity(0, -gravity))
    system, shown = mb.System(*elements, parameters=p), bodies[watched[0]]
    force = system.reaction(watched[1])
    outputs = {} if spatial else {"theta": shown.theta, "omega": shown.omega}
    outputs |= {"x": shown.x, "y": shown.y, "vx": shown.vx, "fx": force.fx, "fy": force.fy}
    if law is not None:
        outputs["drive"] = -system.lam("motor")[0]
    begin: dict[str, Any] | None = None if start_of is None else {name: getattr(p, of) for name, of in start_of.items()}
    if begin is None and law is None:
        names = ("O.angle", "O.angle_rate") if spatial else ("crank.theta", "crank.omega")
        begin = dict(zip(names, start, strict=True))
    begin, where = begin or {}, {}
    for name, (x, y, theta) in zip(own.bars, guess.tolist(), strict=True):
        where |= {f"{name}.x": x, f"{name}.y": y}
        where |= {f"{name}.rotation": mb.rotation((0, 0, 1), theta)} if spatial else {f"{name}.theta": theta}
    where = {name: value for name, value in where.items() if name not in begin}
    return mb.Scene(system, begin, times, outputs, guess=where, box=mb.Box(**box), name=kind)


# Kinds


def _bars(P: Any, **ends: tuple[Point, Point, Any]) -> dict[str, Bar]:
    """Slender bars of the density of the parameters, by their ends and lengths."""
    return {name: Bar(A, B, L, P.rho * L, P.rho * L**3 / 12) for name, (A, B, L) in ends.items()}


def _four_bar(P: Any, phi: Any, side: float = 1.0) -> Plan:
    base, D = (0.0, 0.0), (P.d, 0.1)
    A = (P.a * ca.cos(phi), P.a * ca.sin(phi))
    C = circles(A, D, P.b, P.c, side)
    bars = _bars(P, crank=(base, A, P.a), coupler=(A, C, P.b), rocker=(D, C, P.c))
    hinges = {"O": Hinge(None, "crank", base), "A": Hinge("crank", "coupler", A),
              "C": Hinge("coupler", "rocker", C, on_b=(1.0,)), "D": Hinge(None, "rocker", D)}  # fmt: skip
    return Plan(bars, hinges)


def _six_bar(P: Any, phi: Any, lengths: tuple[float, float] | None, on: str, across: float) -> Plan:
    """A four-bar with a second pair of bars from a point of its coupler or its rocker to the ground.

    Where their lengths are None, they suit a position.
    """
    plan = _four_bar(P, phi)
    bar, along = plan.bars[on], 0.5
    E, H = beyond(bar.A, bar.B, along, across), (P.d + 0.7, 0.3)
    first, second = lengths or reach_of(E, H)
    K = circles(E, H, first, second, 1.0)
    plan.bars |= _bars(P, link=(E, K, first), output=(H, K, second))
    plan.hinges |= {"E": Hinge(on, "link", E, on_a=(along, across)),
                    "K": Hinge("link", "output", K, on_b=(1.0,)), "H": Hinge(None, "output", H)}  # fmt: skip
    return plan


def reach_of(E: Point, H: Point) -> tuple[float, float]:
    """Lengths of two bars that join two points at about a right angle."""
    r = float(np.hypot(float(E[0]) - float(H[0]), float(E[1]) - float(H[1])))
    return 0.75 * r, 0.7 * r


def _slider_crank(P: Any, phi: Any, side: float = 1.0) -> Plan:
    base, A = (0.0, 0.0), (P.a * ca.cos(phi), P.a * ca.sin(phi))
    C = (A[0] + side * ca.sqrt(P.b**2 - (P.e - A[1]) ** 2), P.e)
    bars = _bars(P, crank=(base, A, P.a), coupler=(A, C, P.b)) | {
        "slider": Bar(C, C, 0.0, 0.5 * P.rho, 0.1, slides=True)
    }
    hinges = {"O": Hinge(None, "crank", base), "A": Hinge("crank", "coupler", A), "C": Hinge("coupler", "slider", C),
              "rail": Hinge(None, "slider", (0.0, P.e), parts="yt")}  # fmt: skip
    return Plan(bars, hinges)


def _five_bar(P: Any, phi: Any, ratio: float = -1.0) -> Plan:
    """Two cranks that are coupled by a gear, and two bars between their tips."""
    base, D, other = (0.0, 0.0), (P.d, 0.0), ratio * phi
    A, B = (P.a * ca.cos(phi), P.a * ca.sin(phi)), (P.d + P.c * ca.cos(other), P.c * ca.sin(other))
    C = circles(A, B, P.b, 0.9, 1.0)
    bars = _bars(P, crank=(base, A, P.a), second=(D, B, P.c), coupler=(A, C, P.b), rocker=(B, C, 0.9))
    hinges = {"O": Hinge(None, "crank", base), "D": Hinge(None, "second", D), "A": Hinge("crank", "coupler", A),
              "B": Hinge("second", "rocker", B), "C": Hinge("coupler", "rocker", C, on_b=(1.0,))}  # fmt: skip
    return Plan(bars, hinges, gear=("crank", "second", ratio))


def _parallelogram(P: Any, phi: Any) -> Plan:
    base, D, A = (0.0, 0.0), (P.b, 0.0), (P.a * ca.cos(phi), P.a * ca.sin(phi))
    C = (A[0] + P.b, A[1])
    bars = _bars(P, crank=(base, A, P.a), coupler=(A, C, P.b), rocker=(D, C, P.a))
    return Plan(bars, {"O": Hinge(None, "crank", base), "A": Hinge("crank", "coupler", A),
                       "C": Hinge("coupler", "rocker", C, on_b=(1.0,)), "D": Hinge(None, "rocker", D)})  # fmt: skip


def _rssr(values: dict[str, float], gamma: float, times: np.ndarray, box: dict[str, tuple[float, float]], massive: bool,
          law: Callable[[Any, Any], Any] | None = None) -> Case:  # fmt: skip
    """A crank about z and a rocker about an axis that is turned by gamma about x, with a slender coupler between balls.

    The coupler does not spin about itself: its joints have no torque. Without a mass it is a distance.
    """
    at = symbols(list(values))
    P, phi = at.named, at.phi
    s, c = float(np.sin(gamma)), float(np.cos(gamma))
    e1, e2 = ca.vertcat(1, 0, 0), ca.vertcat(0, c, s)
    D = (0.9, 0.3, 0.2)
    A = P.a * ca.vertcat(ca.cos(phi), ca.sin(phi), 0)
    w = A - ca.vertcat(*D)
    w1, w2 = ca.dot(w, e1), ca.dot(w, e2)
    reach = (ca.dot(w, w) + P.c**2 - P.b**2) / (2 * P.c)
    psi = ca.atan2(w2, w1) + ca.acos(reach / ca.sqrt(w1**2 + w2**2))
    B = ca.vertcat(*D) + P.c * (ca.cos(psi) * e1 + ca.sin(psi) * e2)
    dA, dB, turn = (ca.jacobian(z, phi) for z in (A, B, psi))
    m = P.rho * P.b if massive else ca.SX(0)
    reduced = P.rho * P.a**3 / 3 + P.rho * P.c**3 / 3 * turn**2
    reduced += m / 3 * (ca.dot(dA, dA) + ca.dot(dA, dB) + ca.dot(dB, dB))
    weight = P.rho * P.a * 0.5 * A[2] + m * 0.5 * (A[2] + B[2]) + P.rho * P.c * 0.5 * (B[2] + D[2])
    coordinate = Coordinate(at, reduced, -G * ca.gradient(weight, phi), (P.tilt, P.spin),
                            None if law is None else law(P, at.t))  # fmt: skip
    values_of = ca.vertcat(psi, turn * at.v, B, dB[0] * at.v, *([] if law is None else [coordinate.drive]))
    shown = ca.Function("shown", [phi, at.v, at.a, at.t, at.p], [values_of])

    p, ground, nominal = mb.Parameters(**values), mb.Ground(), np.array(list(values.values()))
    first = ca.Function("first", [phi, at.p], [psi, A, B])
    psi0, A0, B0 = (part.full().ravel() for part in first(values["tilt"], nominal))

    def rod(name: str, length: Any) -> mb.Body:
        mass = p.rho * length
        return mb.Body(name, mass, (1e-3 * mass, mass * length**2 / 12, mass * length**2 / 12), mb.Spatial())

    crank, rocker, coupler = rod("crank", p.a), rod("rocker", p.c), rod("coupler", p.b)
    drive = mb.Revolute("O", ground.point(0, 0, 0), crank.point(-p.a / 2, 0, 0), axis=(0, 0, 1))
    pivot = mb.Revolute("D", ground.point(*D), rocker.point(-p.c / 2, 0, 0), axis=(0, -s, c))
    tip, end = crank.point(p.a / 2, 0, 0), rocker.point(p.c / 2, 0, 0)
    elements: list[Any] = [crank, rocker, drive, pivot, mb.Gravity(0, 0, -G)]
    guess: dict[str, Any] = {"rocker.rotation": mb.rotation((0, -s, c), float(psi0[0]))}
    guess |= dict(zip(("rocker.x", "rocker.y", "rocker.z"), (0.5 * (B0 + D)).tolist(), strict=True))
    if massive:
        elements += [coupler, mb.Spherical("A", tip, coupler.point(-p.b / 2, 0, 0)),
                     mb.Spherical("B", coupler.point(p.b / 2, 0, 0), end)]  # fmt: skip
        along = (B0 - A0) / np.linalg.norm(B0 - A0)
        axis = np.cross([1, 0, 0], along)
        angle = float(np.arctan2(np.linalg.norm(axis), along[0]))
        guess["coupler.rotation"] = mb.rotation(tuple((axis / np.linalg.norm(axis)).tolist()), angle)
        guess |= dict(zip(("coupler.x", "coupler.y", "coupler.z"), (0.5 * (A0 + B0)).tolist(), strict=True))
    else:
        elements.append(mb.Distance("A", tip, end, p.b))
    start: dict[str, Any] = {"O.angle": p.tilt, "O.angle_rate": p.spin}
    if law is not None:
        elements.append(mb.Motion("motor", drive.angle, law(p, mb.t)))
        start = {}
    system = mb.System(*elements, parameters=p)
    outputs = {"psi": pivot.angle, "rate": pivot.angle_rate, "x": end.x, "y": end.y, "z": end.z, "vx": end.vx}
    if law is not None:
        outputs["drive"] = -system.lam("motor")[0]
    scene = mb.Scene(system, start, times, outputs, guess=guess, box=mb.Box(**box), name="RSSR")

    def runs(P: np.ndarray) -> np.ndarray:
        at = [value.ravel() for value in coordinate(P, times)]
        (found,) = mapped(shown, *at, np.tile(times, len(P)), P.repeat(len(times), axis=0))
        return found.reshape(len(P), len(times), -1)

    return Case("RSSR" if massive else "RSSR of a distance", scene, runs)
