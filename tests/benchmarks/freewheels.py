"""Random freewheels, claws and stick-slip by a Weld that opens by its reaction, against own solutions event by event.

    PYTHONPATH=. python tests/benchmarks/freewheels.py [--seed 0] [--count 300]

Two discs are welded while one drives the other. Between events the equations are linear, so that the exponential of a
matrix is their solution, and events are roots of it. All outputs and all times of events must agree to 1e-9. Runs whose
own events are closer together than 1e-6 s are not counted: they depend on more digits.
"""

import argparse
import warnings

import casadi as ca
import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

import symmb as mb

TIMES = np.linspace(0.0, 2.0, 41)
KINDS = ("driven freewheel", "freewheel", "stick-slip", "claws", "driven claws")
NUMBERS = ("Ja", "Jb", "drag_a", "drag", "load", "k", "mean", "swing", "w", "limit", "claw", "phase")
"""Parameters of every scene: what drives disc a is mean + swing cos(w t), a torque, or its speed where it is driven."""


def make_scene(kind):
    """The scene of a kind with its numbers as parameters."""
    p = mb.Parameters(**dict.fromkeys(NUMBERS, 1.0))
    ground = mb.Ground()
    a, b = mb.Body("a", 1.0, p.Ja, mb.Planar()), mb.Body("b", 1.0, p.Jb, mb.Planar())
    shafts = [mb.Revolute(f"shaft_{disc.name}", ground.point(0, 0), disc.point(0, 0)) for disc in (a, b)]
    lock = mb.Weld("lock", a.point(0, 0), b.point(0, 0))
    drive = p.mean + p.swing * ca.cos(p.w * mb.t) - p.drag_a * a.omega
    if is_driven(kind):
        drive = mb.Motion("drive", shafts[0].angle, p.mean * mb.t + p.swing / p.w * ca.sin(p.w * mb.t))
        start = {}
    else:
        drive, start = mb.Torque("drive", a, drive), {"a.omega": 0.5}
    closes = ca.sin(p.claw * mb.t + p.phase) > 0.3 if "claws" in kind else a.omega - b.omega > 0
    events = [mb.Latch(lock, closes), mb.Release(lock, lambda on_b: on_b.tz < -p.limit)]
    load = mb.Torque("load", b, p.load - p.drag * b.omega - p.k * b.theta)
    system = mb.System(a, b, *shafts, lock, drive, load, *events, parameters=p)
    return mb.Scene(system, start | {"b.theta": 0.0}, TIMES, {"wa": a.omega, "wb": b.omega, "b": b.theta})


def is_driven(kind):
    return "driven" in kind or kind == "stick-slip"


def draw(kind, rng):
    n = dict(Ja=rng.uniform(0.02, 0.5), Jb=rng.uniform(0.02, 0.5), drag_a=rng.uniform(0, 0.1), drag=rng.uniform(0, 0.3))
    n |= dict(
        load=rng.uniform(-0.3, 0.1), k=0.0, mean=rng.uniform(0, 1), swing=rng.uniform(0.5, 3), w=rng.uniform(2, 9)
    )
    n |= dict(limit=rng.choice([0.0, rng.uniform(0, 0.3)]), claw=rng.uniform(2, 8), phase=rng.uniform(0, 0.2))
    if kind == "stick-slip":  # a disc that a spring holds back: it opens where friction can do no more
        n |= dict(k=rng.uniform(0.5, 5), swing=0.0, load=-rng.uniform(0.5, 2), mean=-rng.uniform(0.2, 1))
        n |= dict(load=-n["load"], mean=-n["mean"])
    return n


class Reference:
    """Own solution, with the states angle of b, speeds of a and b, cos, sin and 1."""

    def __init__(self, kind, n):
        self.kind, self.n, w = kind, n, n["w"]
        driven = is_driven(kind)
        clock = [[0, 0, 0, 0, -w, 0], [0, 0, 0, w, 0, 0], [0] * 6]
        own_b = np.array([-n["k"], 0, -n["drag"], 0, 0, n["load"]])
        own_a = np.array([0, -n["drag_a"], 0, n["swing"], 0, n["mean"]])
        turn = np.array([0, 0, 1.0, 0, 0, 0])
        driving = np.array([0, 0, 0, 0, -n["swing"] * w, 0])
        together = driving if driven else (own_a + own_b) / (n["Ja"] + n["Jb"])
        self.A = {
            True: np.vstack([turn, together, together, *clock]),
            False: np.vstack([turn, driving if driven else own_a / n["Ja"], own_b / n["Jb"], *clock]),
        }
        self.torque = n["Jb"] * together - own_b  # of the lock on b
        self.start = np.array([0, n["mean"] + n["swing"] if driven else 0.5, 0, 1, 0, 1])
        self.start[2] = self.start[1]

    def condition(self, locked, t, z):
        """What rises above 0 where the lock opens or closes."""
        if locked:
            return -self.torque @ z - self.n["limit"]
        return np.sin(self.n["claw"] * t + self.n["phase"]) - 0.3 if "claws" in self.kind else z[1] - z[2]

    def run(self):
        """Outputs (n_t, 3) and times of events."""
        bounced = False  # its condition holds still, and must first cease to
        t, z, locked, whens, out = 0.0, self.start, True, [], np.empty((len(TIMES), 3))
        grid = np.linspace(TIMES[0], TIMES[-1], 4001)
        while True:
            A = self.A[locked]
            at = lambda time: expm(A * (time - t)) @ z  # noqa: B023, E731
            f = lambda time: self.condition(locked, time, at(time))  # noqa: B023, E731
            ahead = [t, *grid[grid > t + 1e-12]]
            step, z_grid, when = expm(A * (grid[1] - grid[0])), None, None
            below, previous = f(t) <= 1e-13 and not bounced, t
            for k, time in enumerate(ahead[1:]):
                z_grid = at(time) if k == 0 else step @ z_grid
                above = self.condition(locked, time, z_grid) > 0
                if above and below:
                    start = previous if previous > t else t + 1e-9
                    when = brentq(f, start, time, xtol=1e-15) if f(start) < 0 < f(time) else start
                    break
                below, previous = not above, time
            own = (TIMES >= t) & (TIMES < (np.inf if when is None else when))
            for i in np.flatnonzero(own):
                out[i] = at(TIMES[i])[[1, 2, 0]]
            if when is None:
                return out, np.array(whens)
            t, z, locked, bounced = when, at(when), not locked, False
            whens.append(t)
            if locked:
                Ja, Jb = self.n["Ja"], self.n["Jb"]
                z[2] = z[1] = z[1] if is_driven(self.kind) else (Ja * z[1] + Jb * z[2]) / (Ja + Jb)
                if self.condition(True, t, z) > 0:  # it cannot hold
                    locked, bounced = False, True
                    whens.append(t)


def main(seed, count):
    rng, scenes, wrong, worst, doubted, left_out, case, events = np.random.default_rng(seed), {}, 0, 0.0, 0, 0, 0, 0
    while case < count:
        kind = KINDS[case % len(KINDS)]
        n = draw(kind, rng)
        own = Reference(kind, n)
        if own.condition(True, 0.0, own.start) > -1e-3:
            continue
        right, whens = own.run()
        case += 1
        gaps = np.diff(whens)
        if ((gaps > 0) & (gaps < 1e-6)).any():
            left_out += 1
            continue
        if kind not in scenes:
            scenes[kind] = mb.prepare(make_scene(kind))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.SymmbWarning)
            try:
                run = mb.simulate(scenes[kind], parameters=n)
            except mb.SimulationError as error:
                print(case, kind, error)
                wrong += 1
                continue
        found = np.array([event.time for event in run.events])
        size = np.abs(right).max()
        error = max(np.abs(run[name] - right[:, i]).max() for i, name in enumerate(("wa", "wb", "b"))) / size
        if found.shape == whens.shape and len(whens):
            error = max(error, np.abs(found - whens).max())
        doubted, events = doubted + bool(run.doubts), events + len(whens)
        if (found.shape != whens.shape or error > 1e-9) and not run.doubts:
            wrong += 1
            print(case, kind, f"{error:.1e}", found, whens, n)
        elif not run.doubts:
            worst = max(worst, error)
    print(f"{count} locks, {events} events: {wrong} wrong, {doubted} doubted, {left_out} left out, worst {worst:.1e}")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=300)
    arguments = parser.parse_args()
    raise SystemExit(main(arguments.seed, arguments.count) > 0)
