"""Random drives with motors, clutches and brakes, against equations of motion by hand that SciPy integrates to events.

    python tests/benchmarks/drives.py [scenes of each kind] [seed] [kinds]

It prints the largest error of the outputs over the size of each, of the times of events, and of the energy over the
largest kinetic energy, and ends with status 1 above 1e-7.
"""

import itertools
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

TIMES = np.linspace(0.0, 2.0, 21)
Reference = tuple[np.ndarray, list[tuple[str, str, float]]]
"""Outputs (n_t, n_y), and events: names, what happens, times."""


@dataclass
class Pair:
    """A clutch from shaft a (-1: the ground) to shaft b, with its capacity over time and its ratio of sticking."""

    name: str
    a: int
    b: int
    capacity: Callable[[float], float]
    ratio: float

    def row(self, n: int) -> np.ndarray:
        """Slip as a row of the speeds (n,)."""
        row = np.zeros(n)
        row[self.b] = 1.0
        if self.a >= 0:
            row[self.a] -= 1.0
        return row


@dataclass
class Drive:
    """Shafts (n,) with inertia J(angles) and forces, states behind them, and clutches between them.

    The state is (angles (n,), speeds (n,), others). `forces(t, y)` are generalised forces (n,), `others(t, y)` rates of
    the other states. Laws of time jump at `breaks` only.
    """

    inertia: Callable[[np.ndarray], np.ndarray]
    forces: Callable[[float, np.ndarray], np.ndarray]
    pairs: Sequence[Pair]
    breaks: Sequence[float] = ()
    others: Callable[[float, np.ndarray], np.ndarray] = lambda t, y: np.empty(0)

    def solved(self, t: float, y: np.ndarray, modes: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (n,) and torques that clutches need to stick (k,), with modes: 0 sticks, 1 or -1 slips so."""
        M, f = self.inertia(y), self.forces(t, y)
        n = len(f)
        rows = np.array([pair.row(n) for pair in self.pairs]).reshape(-1, n)
        stuck = np.array(modes) == 0
        capacity = np.array([pair.capacity(t) for pair in self.pairs])
        f = f - rows.T @ (np.array(modes) * capacity)
        K = rows[stuck]
        m = len(K)
        both = np.linalg.solve(np.block([[M, K.T], [K, np.zeros((m, m))]]), np.concatenate([f, np.zeros(m)]))
        needed = np.zeros(len(rows))
        needed[stuck] = both[n:]
        return both[:n], needed

    def settled(self, t: float, y: np.ndarray, known: dict[int, int]) -> list[int]:
        """Modes at an instant, of which some are known: as many clutches stick as can."""
        n = self.inertia(y).shape[0]
        slips = np.array([pair.row(n) @ y[n : 2 * n] for pair in self.pairs])
        options = [
            (known[k],) if k in known else (int(np.sign(slip)),) if abs(slip) > 1e-9 else (0, 1, -1)
            for k, slip in enumerate(slips)
        ]
        for modes in sorted(itertools.product(*options), key=lambda modes: -modes.count(0)):
            a, needed = self.solved(t, y, modes)
            fits = True
            for k, (pair, mode) in enumerate(zip(self.pairs, modes, strict=True)):
                limit = pair.ratio * pair.capacity(t)
                fits &= abs(needed[k]) <= limit * (1 + 1e-12) if mode == 0 else True
                if mode and abs(slips[k]) <= 1e-9 and k not in known:
                    fits &= bool(mode * (pair.row(n) @ a) > 0)
            if fits:
                return list(modes)
        raise AssertionError("no modes")

    def run(self, y0: Sequence[float], out: Callable[[float, np.ndarray], Sequence[float]]) -> Reference:
        """Outputs at the times, and the events."""
        y, t, events, values = np.asarray(y0, float), 0.0, [], {}
        modes: list[int] | None = None
        for end in [*sorted(b for b in self.breaks if b < TIMES[-1]), TIMES[-1]]:
            at = partial(np.clip, a_min=t + 1e-13, a_max=end - 1e-13)
            # At a jump of a law, a clutch that slips goes on, and one that sticks may begin to slip.
            known = {} if modes is None else {k: mode for k, mode in enumerate(modes) if mode}
            before, modes = modes, self.settled(at(t), y, known)
            events += self._changes(before, modes, t)
            while t < end:
                y, t, passed = self._phase(t, end, y, modes, at, out, values)
                if passed is None:
                    break
                before, modes = list(modes), self.settled(at(t), y, self._known(at(t), y, modes, passed))
                events += self._changes(before, modes, t)
        return np.array([values[time] for time in TIMES]), events

    def _known(self, t: float, y: np.ndarray, modes: Sequence[int], k: int) -> dict[int, int]:
        """Modes that are known behind the event of clutch k, whose shafts get one speed if it has slipped."""
        n, pair, known = self.inertia(y).shape[0], self.pairs[k], {}
        if modes[k]:
            y[n + pair.b] = y[n + pair.a] if pair.a >= 0 else 0.0
        else:  # it breaks away
            known[k] = int(np.sign(self.solved(t, y, modes)[1][k]))
        slips = [abs(pair.row(n) @ y[n : 2 * n]) for pair in self.pairs]
        return known | {i: mode for i, mode in enumerate(modes) if mode and i != k and slips[i] > 1e-9}

    def _phase(self, t, end, y, modes, at, out, values):
        n = self.inertia(y).shape[0]

        def rates(time, y):
            return np.concatenate([y[n : 2 * n], self.solved(at(time), y, modes)[0], self.others(at(time), y)])

        def margin(k):
            pair, mode = self.pairs[k], modes[k]
            if mode:
                of = lambda time, y: mode * (pair.row(n) @ y[n : 2 * n])  # noqa: E731
            else:
                of = lambda time, y: (  # noqa: E731
                    pair.ratio * pair.capacity(at(time)) - abs(self.solved(at(time), y, modes)[1][k])
                )
            of.terminal, of.direction = True, -1
            return of

        margins = [margin(k) for k in range(len(self.pairs))]
        solution = solve_ivp(
            rates,
            (t, end),
            y,
            "DOP853",
            dense_output=True,
            events=margins or None,
            rtol=1e-12,
            atol=1e-13,
            max_step=0.02,
        )
        assert solution.success
        for time in TIMES[(TIMES >= t) & (TIMES <= solution.t[-1])]:
            values[time] = out(time, solution.sol(time))
        which = [k for k, found in enumerate(solution.t_events or []) if found.size]
        return solution.y[:, -1].copy(), float(solution.t[-1]), which[0] if which else None

    def _changes(self, before, after, t):
        """Events as symmb tells them. One that comes to 0 and goes on in the other direction closes and opens."""
        events = []
        for k, pair in enumerate(self.pairs):
            was, now = (0 if before is None else before[k]), after[k]
            if was and now and was != now:
                events += [(pair.name, "closes", t), (pair.name, "opens", t)]
            elif was and not now:
                events.append((pair.name, "closes", t))
            elif before is not None and not was and now:
                events.append((pair.name, "opens", t))
        return events


def law(random: np.random.Generator, size: float) -> tuple[Callable, ca.SX, list[float]]:
    """A law of time: a wave, a step or a ramp; as a function, as an expression, and where it jumps or bends."""
    a, b, w, phase, at = random.uniform([0.2, 0.3, 2, 0, 0.3], [1, 1, 6, 6, 1.7])
    kind, t = random.integers(3), mb.t
    if kind == 0:
        return lambda s: size * (a + b * np.sin(w * s + phase)), size * (a + b * ca.sin(w * t + phase)), []
    if kind == 1:
        return lambda s: size * (a if s < at else b - a), size * ca.if_else(t < at, a, b - a), [at]
    return lambda s: size * a * min(s / at, 1.0), size * a * ca.fmin(t / at, 1), [at]


def capacity(random: np.random.Generator, size: float) -> tuple[Callable, ca.SX, list[float]]:
    """A law of capacity that is not negative."""
    a, b, w, phase, at = random.uniform([0.2, 0.0, 2, 0, 0.3], [1, 1, 6, 6, 1.7])
    kind, t = random.integers(4), mb.t
    if kind == 0:
        return (
            lambda s: size * a * (1 + 0.9 * np.sin(w * s + phase)),
            size * a * (1 + 0.9 * ca.sin(w * t + phase)),
            [],
        )
    if kind == 1:
        return lambda s: size * (a if s < at else b), size * ca.if_else(t < at, a, b), [at]
    if kind == 2:
        return lambda s: size * a * min(s / at, 1.0), size * a * ca.fmin(t / at, 1), [at]
    return lambda s: size * a, ca.SX(size * a), []


def bearings(random: np.random.Generator, J: np.ndarray, space: bool):
    """The ground, shafts with inertias J (n,), their hinges and their axis, which is skew in space."""
    ground, axis = mb.Ground(), random.normal(size=3) if space else np.array([0, 0, 1])
    centre, z = (0, 0, 0)[: 2 + space], tuple(axis / np.linalg.norm(axis))
    kind = [((j, j, j), mb.Spatial()) if space else (j, mb.Planar()) for j in J]
    bodies = [mb.Body(f"shaft{k}", 1.0, *own) for k, own in enumerate(kind)]
    hinges = [mb.Revolute(f"hinge{k}", ground.point(*centre), b.point(*centre), axis=z) for k, b in enumerate(bodies)]
    return ground, bodies, hinges, z


def shafts(random: np.random.Generator, chain: Sequence[tuple[int, int]], n: int, space: bool = False):
    """n shafts on one axis under laws of time and viscous friction, with clutches between them."""
    J, c = random.uniform(0.3, 2, n), random.uniform(0, 0.4, n)
    loads = [law(random, random.choice([-1, 1]) * random.uniform(2, 8)) for _ in range(n)]
    holds = [capacity(random, random.uniform(2, 12)) for _ in chain]
    ratios = [random.choice([1.0, random.uniform(1, 1.5)]) for _ in chain]
    speeds = random.uniform(-4, 4, n) * random.integers(0, 2, n)
    ground, bodies, hinges, z = bearings(random, J, space)
    drives = [
        mb.Actuator(f"load{k}", hinge, load[1] - friction * hinge.angle_rate)
        for k, (hinge, load, friction) in enumerate(zip(hinges, loads, c, strict=True))
    ]
    clutches = [
        mb.Clutch(f"clutch{k}", ground if a < 0 else bodies[a], bodies[b], hold[1], ratio, axis=z)
        for k, ((a, b), hold, ratio) in enumerate(zip(chain, holds, ratios, strict=True))
    ]
    system = mb.System(*bodies, *hinges, *drives, *clutches)
    start = {f"hinge{k}.angle": 0.0 for k in range(n)} | {f"hinge{k}.angle_rate": w for k, w in enumerate(speeds)}
    outputs = {f"angle{k}": hinge.angle for k, hinge in enumerate(hinges)}
    outputs |= {f"speed{k}": hinge.angle_rate for k, hinge in enumerate(hinges)}
    drive = Drive(
        inertia=lambda y: np.diag(J),
        forces=lambda t, y: np.array([load[0](t) for load in loads]) - c * y[n : 2 * n],
        pairs=[
            Pair(clutch.name, a, b, hold[0], ratio)
            for clutch, (a, b), hold, ratio in zip(clutches, chain, holds, ratios, strict=True)
        ],
        breaks=sorted({at for *_, own in (*loads, *holds) for at in own}),
    )
    reference = drive.run([*np.zeros(n), *speeds], lambda t, y: y)
    return mb.Scene(system, start, TIMES, outputs), reference


def motor(random: np.random.Generator, braked: bool) -> tuple[mb.Scene, Reference]:
    """A motor that turns a wheel under a load, perhaps against a brake, by a law of time or a controller."""
    J, R, k, ratio, n, b, c = random.uniform([0.5, 0.5, 0.3, 0.8, 1, 0, 0], [2, 2, 1, 1.2, 4, 0.05, 0.3])
    L = random.choice([0.0, random.uniform(0.05, 0.5)])
    voltage, load = law(random, random.uniform(5, 20)), law(random, random.uniform(-3, 3))
    gain = random.choice([0.0, random.uniform(1, 5)])
    hold = capacity(random, random.uniform(5, 40))
    wheel, ground = mb.Body("wheel", 1.0, J), mb.Ground()
    shaft = mb.Revolute("shaft", ground.point(0, 0), wheel.point(0, 0))
    drive = mb.Motor("motor", shaft, voltage[1] - gain * shaft.angle, R, k, L, n, b, ratio * k)
    brake = [mb.Clutch("brake", ground, wheel, hold[1])] if braked else []
    loads = mb.Actuator("load", shaft, load[1] - c * shaft.angle_rate)
    outputs = {"angle": shaft.angle, "speed": shaft.angle_rate, "current": drive.current, "power": drive.power}
    scene = mb.Scene(mb.System(wheel, shaft, drive, loads, *brake), {"wheel.omega": 2.0}, TIMES, outputs)

    def left(t, y):  # voltage without what the rotation induces
        return voltage[0](t) - gain * y[0] - ratio * k * n * y[1]

    def current(t, y):
        return y[2] if L else left(t, y) / R

    def forces(t, y):
        return np.array([n * (k * current(t, y) - b * n * y[1]) + load[0](t) - c * y[1]])

    own = Drive(
        inertia=lambda y: np.array([[J]]),
        forces=forces,
        pairs=[Pair("brake", -1, 0, hold[0], 1.0)] if braked else [],
        breaks=sorted({at for *_, breaks in (voltage, load, hold) for at in breaks}),
        others=(lambda t, y: np.array([(left(t, y) - R * y[2]) / L])) if L else (lambda t, y: np.empty(0)),
    )

    def out(t, y):
        i = current(t, y)
        return [y[0], y[1], i, i * (voltage[0](t) - gain * y[0])]

    return scene, own.run([0.0, 2.0, *([0.0] if L else [])], out)


def press(random: np.random.Generator) -> tuple[mb.Scene, Reference]:
    """A flywheel that a clutch couples to a slider-crank, which a brake stops."""
    J, Jc, m, Jr, ram = random.uniform([2, 0.1, 0.5, 0.02, 1], [5, 0.3, 1, 0.1, 3])
    r, length = random.uniform([0.1, 0.4], [0.2, 0.6])
    speed, begin, drag, torque = random.uniform([8, 0.2, 1, 1], [15, 0.6, 20, 5])
    push, stopping = random.uniform(5, 40), random.uniform(1.0, 1.4)
    top, hold = random.uniform([10, 20], [40, 60])
    t, ground = mb.t, mb.Ground()
    wheel, crank = mb.Body("wheel", 1.0, J), mb.Body("crank", 1.0, Jc)
    rod, slide = mb.Body("rod", m, Jr), mb.Body("ram", ram, 1.0)
    joints = [
        mb.Revolute("bearing", ground.point(0, 0), wheel.point(0, 0)),
        mb.Revolute("main", ground.point(0, 0), crank.point(0, 0)),
        mb.Revolute("pin", crank.point(r, 0), rod.point(-length / 2, 0)),
        mb.Revolute("wrist", rod.point(length / 2, 0), slide.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), slide.point(0, 0), axis=(1, 0, 0)),
    ]
    clutch = mb.Clutch("clutch", wheel, crank, ca.if_else(t < stopping, top * ca.fmin(t / begin, 1), 0))
    brake = mb.Clutch("brake", ground, crank, ca.if_else(t < stopping, 0, hold))
    loads = mb.Torque("drive", wheel, torque), mb.Force("work", slide.point(0, 0), (-push - drag * slide.vx, 0))
    scene = mb.Scene(
        mb.System(wheel, crank, rod, slide, *joints, clutch, brake, *loads),
        {"wheel.omega": speed, "wheel.theta": 0.0, "crank.theta": 0.3, "crank.omega": 0.0},
        TIMES,
        {"wheel": wheel.theta, "crank": crank.theta, "wheel speed": wheel.omega, "crank speed": crank.omega},
        guess={"rod.theta": -0.1, "ram.x": length, "rod.x": length / 2},
    )

    def ways(a):
        """Derivatives with respect to the crank's angle: x and y of the rod's centre, the rod's angle, x of the ram."""
        sine = -r / length * np.sin(a)
        cosine = np.sqrt(1 - sine**2)
        turn = -r / length * np.cos(a) / cosine
        x = -r * np.sin(a) - length / 2 * sine * turn
        return x, r * np.cos(a) + length / 2 * cosine * turn, turn, -r * np.sin(a) - length * sine * turn

    def inertia(a):
        x, y, turn, way = ways(a)
        return Jc + m * (x**2 + y**2) + Jr * turn**2 + ram * way**2

    def forces(t, y):
        a, w = y[1], y[3]
        way, slope = ways(a)[3], inertia(a + 1e-30j).imag / 1e-30
        return np.array([torque, (-push - drag * way * w) * way - slope * w**2 / 2])

    own = Drive(
        inertia=lambda y: np.diag([J, inertia(y[1])]),
        forces=forces,
        pairs=[
            Pair("clutch", 0, 1, lambda t: top * min(t / begin, 1.0) if t < stopping else 0.0, 1.0),
            Pair("brake", -1, 1, lambda t: hold if t >= stopping else 0.0, 1.0),
        ],
        breaks=[begin, stopping],
    )
    return scene, own.run([0.0, 0.3, speed, 0.0], lambda t, y: y)


def pendulums(random: np.random.Generator, chain: Sequence[tuple[int, int]], n: int) -> tuple[mb.Scene, Reference]:
    """n pendulums on one axis with torsion springs, and clutches of constant capacity between them."""
    mass, J, arm, k = random.uniform([0.3, 0.05, 0.1, 0.5], [2, 0.5, 0.8, 20], (n, 4)).T
    k *= random.integers(0, 2, n)
    angles, speeds = random.uniform(-2, 2, n), random.uniform(-4, 4, n) * random.integers(0, 2, n)
    holds, ratios = random.uniform(0.2, 6, len(chain)), [1.0] * len(chain)
    if len(chain) == 1:  # several clutches that hold more than they slip with may have several motions
        ratios = random.choice([1.0, 1.2], 1)
    ground = mb.Ground()
    bodies = [mb.Body(f"bob{i}", mass[i], J[i], pose=mb.Planar()) for i in range(n)]
    hinges = [mb.Revolute(f"hinge{i}", ground.point(0, 0), b.point(-arm[i], 0)) for i, b in enumerate(bodies)]
    springs = [mb.TorsionSpring(f"spring{i}", ground, b, k[i]) for i, b in enumerate(bodies)]
    clutches = [
        mb.Clutch(f"clutch{i}", ground if a < 0 else bodies[a], bodies[b], holds[i], ratios[i])
        for i, (a, b) in enumerate(chain)
    ]
    system = mb.System(*bodies, *hinges, *springs, *clutches, mb.Gravity(0, -9.81))
    start = {f"hinge{i}.angle": a for i, a in enumerate(angles)} | {f"bob{i}.omega": w for i, w in enumerate(speeds)}
    outputs = {f"angle{i}": hinge.angle for i, hinge in enumerate(hinges)}
    outputs |= {f"speed{i}": hinge.angle_rate for i, hinge in enumerate(hinges)}
    drive = Drive(
        inertia=lambda y: np.diag(J + mass * arm**2),
        forces=lambda t, y: -k * y[:n] - 9.81 * mass * arm * np.cos(y[:n]),
        pairs=[
            Pair(clutch.name, a, b, lambda _, hold=hold: hold, ratio)
            for clutch, (a, b), hold, ratio in zip(clutches, chain, holds, ratios, strict=True)
        ],
    )
    return mb.Scene(system, start, TIMES, outputs), drive.run([*angles, *speeds], lambda t, y: y)


KINDS: dict[str, Callable[[np.random.Generator], tuple[mb.Scene, Reference]]] = {
    "motor": lambda random: motor(random, False),
    "motor with brake": lambda random: motor(random, True),
    "press": press,
    "brake": lambda random: shafts(random, [(-1, 0)], 1),
    "clutch": lambda random: shafts(random, [(0, 1)], 2),
    "clutch in space": lambda random: shafts(random, [(0, 1)], 2, space=True),
    "clutch and brake": lambda random: shafts(random, [(0, 1), (-1, 1)], 2),
    "clutches in a row": lambda random: shafts(random, [(0, 1), (1, 2)], 3),
    "pendulum with brake": lambda random: pendulums(random, [(-1, 0)], 1),
    "pendulums with clutch": lambda random: pendulums(random, [(0, 1)], 2),
    "pendulums with clutch and brake": lambda random: pendulums(random, [(0, 1), (-1, 1)], 2),
    "pendulums with brakes": lambda random: pendulums(random, [(-1, 0), (-1, 1)], 2),
}


def errors(kind: str, seed: int) -> tuple[float, float, float]:
    """Errors of outputs, of times of events, and of the energy of one random scene."""
    scene, (values, events) = KINDS[kind](np.random.default_rng(seed))
    run = mb.simulate(scene)
    of_values = np.abs(run.values - values).max(axis=0) / np.maximum(np.abs(values).max(axis=0), 1e-2)
    told = _in_order((event.name, event.what, event.time) for event in run.events)
    events = _in_order(events)
    assert [event[:2] for event in told] == [event[:2] for event in events], (kind, seed, told, events)
    of_times = [abs(own[2] - known[2]) for own, known in zip(told, events, strict=True)]
    return float(of_values.max()), max(of_times, default=0.0), float(np.nan_to_num(run.energy_drift))


def _in_order(events: Iterable[tuple[str, str, float]]) -> list[tuple[str, str, float]]:
    """Events behind the start in their order; those of one instant by their names. Those that cancel are left out."""
    kept: list[tuple[str, str, float]] = []
    for event in sorted((event for event in events if event[2] > 0), key=lambda event: (round(event[2], 9), event[0])):
        if kept and kept[-1][0] == event[0] and kept[-1][1] != event[1] and event[2] - kept[-1][2] < 1e-9:
            kept.pop()
        else:
            kept.append(event)
    return kept


def main() -> int:
    """Number of the kinds with errors above 1e-7."""
    count, seed = [int(a) for a in sys.argv[1:3]] + [30, 0][len(sys.argv) - 1 :]
    failed = 0
    for kind in sys.argv[3:] or KINDS:
        worst = np.zeros(3)
        for k in range(count):
            try:
                found = errors(kind, seed + k)
            except Exception as error:  # tell which seed it is
                print(f"{kind}, seed {seed + k}: {type(error).__name__} {str(error)[:900]}")
                found = (np.inf,) * 3
            if max(found) > 1e-7:
                print(f"{kind}, seed {seed + k}: {found}")
            worst = np.maximum(worst, found)
        failed += bool(worst.max() > 1e-7)
        print(f"{kind}: values {worst[0]:.1e}, times {worst[1]:.1e} s, energy {worst[2]:.1e}", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(bool(main()))
