"""Random linkages that move though their joints have too many rows: Bennett's, Sarrus's, and parallelograms in space.

Hinges join bars in a ring. In each linkage all angles follow from one, in closed form, so that the reference is one
ordinary differential equation, of Lagrange; it knows nothing of symmb. Where bars turn freely, single rows of the last
hinge vanish in passing.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import symmb as mb

GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True, eq=False)
class Linkage:
    """A ring of bars and the ground, assembled, with the axes of the ground as those of the bars.

    Attributes
    ----------
    points, axes : (n, 3)        of the hinges, the first one between the ground and the first bar
    turns : theta -> (n - 1,)    angles of all hinges but the last one, if the first one is theta
    theta : float                angle of the first hinge at the start
    least : float                sine of theta at which a singular position is close, 0 if there is none
    m, J : (n - 1,)              masses and moments of inertia, about any axis, of the bars
    centres : (n - 1, 3)         of the masses of the bars
    """

    points: np.ndarray
    axes: np.ndarray
    turns: ca.Function
    theta: float
    least: float
    m: np.ndarray
    J: np.ndarray
    centres: np.ndarray

    def motion(self, span: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Times (n_t,) up to a span, or to where a singular position is close, and the outputs there to 1e-10."""
        theta = ca.SX.sym("theta")
        kinetic, potential = 0, 0
        turned = self.turns(theta) - self.turns(self.theta)
        bars, _ = chain(self.points, self.axes, turned, ca.jacobian(turned, theta), self.centres)
        for m, J, (_, omega, place) in zip(self.m, self.J, bars, strict=True):
            kinetic += m * ca.sumsqr(ca.jacobian(place, theta)) + J * ca.sumsqr(omega)
            potential -= m * ca.dot(ca.DM(GRAVITY), place)
        slopes = [ca.jacobian(kinetic, theta), ca.jacobian(potential, theta)]
        f = ca.Function("f", [theta], [kinetic, *slopes])
        places = ca.Function("places", [theta], [ca.vertcat(*(place for *_, place in bars))])

        def slope(_: float, x: np.ndarray) -> list[float]:
            inertia, change, force = (float(value) for value in f(x[0]))
            return [x[1], -(0.5 * change * x[1] ** 2 + force) / inertia]

        def nears(_: float, x: np.ndarray) -> float:
            return abs(np.sin(x[0])) - self.least if self.least else 1.0

        nears.terminal = True
        exact = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}
        run = solve_ivp(slope, (0, span), [self.theta, rate], events=nears, dense_output=True, **exact)
        times = np.linspace(0, run.t[-1], 16)
        return times, np.array([places(angle).full().ravel() for angle in run.sol(times)[0]])

    def scene(self, times: np.ndarray, rate: float = 0.0) -> mb.Scene:
        """The first hinge starts at a rate. Outputs are the coordinates of all centres."""
        ground = mb.Ground()
        inertias = zip(self.m, self.J, strict=True)
        bars = [mb.Body(f"bar{k}", m, (J, J, J), mb.Spatial()) for k, (m, J) in enumerate(inertias)]
        around = [ground, *bars, ground]
        origins = [np.zeros(3), *self.centres, np.zeros(3)]
        places = [[self.points[k] - r for r in origins[k : k + 2]] for k in range(len(self.points))]
        hinges = [
            mb.Revolute(f"hinge{k}", around[k].point(*a), around[k + 1].point(*b), axis=tuple(self.axes[k]))
            for k, (a, b) in enumerate(places)
        ]
        each = list(enumerate(zip(bars, self.centres, strict=True)))
        outputs = {f"{axis}{k}": getattr(bar, axis) for k, (bar, _) in each for axis in "xyz"}
        guess = {f"bar{k}.{axis}": r for k, (_, centre) in each for axis, r in zip("xyz", centre, strict=True)}
        start, system = {"hinge0.angle_rate": rate} if rate else {}, mb.System(*bars, *hinges, mb.Gravity(*GRAVITY))
        return mb.Scene(system, start, times, outputs, guess=guess, name="linkage")


def chain(points: np.ndarray, axes: np.ndarray, turns: ca.SX, rates: ca.SX, centres: np.ndarray) -> tuple[list, ca.SX]:
    """Rotation, angular velocity and centre of each bar of a chain that has turned at its hinges, and where it ends."""
    R, end, omega, bars = ca.SX.eye(3), ca.SX(ca.DM(points[0])), ca.SX.zeros(3), []
    for k, centre in enumerate(centres):
        axis, c, s = ca.DM(axes[k]), ca.cos(turns[k]), ca.sin(turns[k])
        omega = omega + R @ axis * rates[k]
        R = R @ (c * ca.SX.eye(3) + s * ca.skew(axis) + (1 - c) * (axis @ axis.T))
        bars.append((R, omega, end + R @ ca.DM(centre - points[k])))
        end = end + R @ ca.DM(points[k + 1] - points[k])
    return bars, end


def _linkage(random, points, axes, turns: ca.Function, theta: float, least: float = 0.0) -> Linkage:
    """A linkage of random masses, anywhere in space."""
    R = Rotation.from_quat(random.normal(size=4)).as_matrix()
    points, axes = points @ R.T, axes @ R.T
    bars = len(points) - 1
    middles = (points[1:] + points[:-1]) / 2
    size = np.abs(points).max()
    m, J = random.uniform(0.5, 2, bars), size**2 * random.uniform(0.05, 0.3, bars)
    centres = middles + size * random.uniform(-0.1, 0.1, middles.shape)
    return Linkage(points, axes, turns, theta, least, m, J, centres)


def bennett(seed: int) -> Linkage:
    """Four bars whose opposite ones are alike: lengths a, b and twists alpha, beta with a sin beta = b sin alpha."""
    random = np.random.default_rng([seed, 0])
    a, alpha, beta = random.uniform(0.3, 2), *random.uniform(0.3, 1.4, 2)
    b = a * np.sin(beta) / np.sin(alpha)
    theta, symbol = random.uniform(0.5, 2.5), ca.SX.sym("theta")
    ratio = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    other = 2 * ca.atan2(ratio * ca.cos(symbol / 2), ca.sin(symbol / 2))  # tan(theta / 2) tan(other / 2) = ratio
    turns = ca.Function("turns", [symbol], [ca.vertcat(symbol, other, -symbol)])
    angles = turns(theta).full().ravel()
    frame, points, axes = np.eye(4), [], []
    for angle, (length, twist) in zip([*angles, -angles[1]], [(a, alpha), (b, beta)] * 2, strict=True):
        turn, along = np.eye(4), np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec([0, 0, angle]).as_matrix()
        along[:3, :3], along[0, 3] = Rotation.from_rotvec([twist, 0, 0]).as_matrix(), length
        points.append(frame[:3, 3])
        axes.append(frame[:3, 2])
        frame = frame @ turn @ along
    return _linkage(random, np.array(points), np.array(axes), turns, theta)


def sarrus(seed: int) -> Linkage:
    """Two pairs of bars with parallel hinges in two directions, between which a plate moves along a straight line."""
    random = np.random.default_rng([seed, 1])
    lengths, height = np.sort(random.uniform(0.4, 1.5, 2)), random.uniform(0.2, 0.7)
    apart, reach = random.uniform(0.4, 2.7), random.uniform(0.1, 1.0, 2)
    theta, symbol = np.arcsin(height), ca.SX.sym("theta")
    lean = ca.asin(lengths[0] / lengths[1] * ca.sin(symbol))  # that of the longer pair
    turns = ca.Function("turns", [symbol], [ca.vertcat(symbol, -2 * symbol, symbol, -lean, 2 * lean)])
    points, axes = [], []
    leans = theta, np.arcsin(lengths[0] / lengths[1] * np.sin(theta))
    for length, distance, angle, place in zip(lengths, reach, leans, (0.0, apart), strict=True):
        out, up = np.array([np.cos(place), np.sin(place), 0]), np.array([0.0, 0, 1])
        rise, run = length * np.sin(angle), length * np.cos(angle)
        own = [distance * out, (distance + run) * out + rise * up, distance * out + 2 * rise * up]
        points += own if not place else own[::-1]
        axes += [np.cross(out, up)] * 3
    return _linkage(random, np.array(points), np.array(axes), turns, theta, 0.15)


def parallelogram(seed: int) -> Linkage:
    """Four bars in a plane whose opposite ones are as long, and which pass each other in depth."""
    random = np.random.default_rng([seed, 2])
    crank, coupler = random.uniform(0.3, 1.5, 2)
    theta, symbol = random.uniform(0.6, 2.5), ca.SX.sym("theta")
    turns = ca.Function("turns", [symbol], [ca.vertcat(symbol, -symbol, symbol)])
    end, depths = crank * np.array([np.cos(theta), np.sin(theta), 0]), random.uniform(-0.3, 0.3, 4)
    points = np.array([np.zeros(3), end, end + [coupler, 0, 0], [coupler, 0, 0]])
    points[:, 2] = depths
    return _linkage(random, points, np.tile([0.0, 0, 1], (4, 1)), turns, theta, 0.15)


def planar(seed: int) -> Linkage:
    """Four bars in a plane of any lengths of which the crank turns round (Grashof)."""
    random = np.random.default_rng([seed, 3])
    crank, base = random.uniform(0.2, 0.5), random.uniform(1.0, 1.5)
    coupler, rocker = random.uniform(1.0, 1.5, 2)
    theta, symbol = random.uniform(0.6, 5.5), ca.SX.sym("theta")
    x, y = crank * ca.cos(symbol) - base, crank * ca.sin(symbol)  # from the foot of the rocker to the crank's end
    distance = ca.sqrt(x**2 + y**2)
    bend = ca.acos((distance**2 + coupler**2 - rocker**2) / (2 * distance * coupler))
    along = ca.atan2(-y, -x) + bend
    ends = crank * ca.vertcat(ca.cos(symbol), ca.sin(symbol)) + coupler * ca.vertcat(ca.cos(along), ca.sin(along))
    lean = ca.atan2(ends[1], ends[0] - base)
    turns = ca.Function("turns", [symbol], [ca.vertcat(symbol, along - symbol, lean - along)])
    last = np.append(ca.Function("end", [symbol], [ends])(theta).full().ravel(), 0.0)
    points = np.array([np.zeros(3), crank * np.array([np.cos(theta), np.sin(theta), 0]), last, [base, 0, 0]])
    points[:, 2] = random.uniform(-0.3, 0.3, 4)
    return _linkage(random, points, np.tile([0.0, 0, 1], (4, 1)), turns, theta)


LINKAGES = (bennett, sarrus, parallelogram, planar)
