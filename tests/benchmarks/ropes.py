"""Random ropes against integrations of own equations, by SciPy: the rope is straight where a wrap would be negative.

    PYTHONPATH=. python tests/benchmarks/ropes.py [--seed 0] [--count 300]

Idlers that retract, sprung tensioners, loads that swing away, tethers that wind on and leave, and pairs of pulleys on
equal and on opposite sides. Every run must agree to 1e-7 of the size of its scene, or have a doubt. Runs whose
reference changes by more than a tenth of that with its tolerance are not counted.
"""

import argparse
import warnings
from itertools import combinations, pairwise

import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

TIMES = np.linspace(0.0, 1.0, 21)
LOAD = ("x0", "y0", "vx0", "vy0")
NUMBERS = (*LOAD, "k", "c", "length", "mass", "support", "viscosity", "speed", "gravity", "r1", "r2", "s1", "s2")
"""Parameters of every scene: r are radii of pulleys, s the heights at which their centres begin."""
KINDS = {"retracts": "d", "tensioner": "s", "swings": "f", "winds": "f", "pair": "sf", "retracting pair": "ds"}
"""For each pulley how its centre moves: driven, on a spring, or fixed."""


def make_scene(kind):
    """The scene of a kind with its numbers as parameters. The rope goes from the ground over the pulleys to a load."""
    p = mb.Parameters(**dict.fromkeys(NUMBERS, 1.0))
    ground, load = mb.Ground(), mb.Body("load", p.mass, pose=mb.Particle())
    elements, way, outputs = [load, mb.Gravity(0, -p.gravity)], [ground.point(-1, 0)], {"x": load.x, "y": load.y}
    start = {f"load.{name[:-1]}": getattr(p, name) for name in LOAD}
    for i, motion in enumerate(KINDS[kind], 1):
        r, s = getattr(p, f"r{i}"), getattr(p, f"s{i}")
        if motion == "f":
            way.append((ground.point(i - 1, s), r))
            continue
        idler = mb.Body(f"idler{i}", 0.5, pose=mb.Particle())
        way.append((idler.point(0, 0), r))
        elements += [idler, mb.Motion(f"guide{i}", idler.x, i - 1)]
        if motion == "d":
            elements.append(mb.Motion(f"drive{i}", idler.y, s - p.speed * mb.t))
        else:
            force = p.support * (s - idler.y) - p.viscosity * idler.vy
            elements.append(mb.Force(f"spring{i}", idler.point(0, 0), (0, force)))
            start |= {f"idler{i}.y": s, f"idler{i}.vy": 0.0}
        outputs[f"y{i}"] = idler.y
    rope = mb.Rope("rope", [*way, load.point(0, 0)], p.k, p.length, p.c)
    return mb.Scene(mb.System(*elements, rope, parameters=p), start, TIMES, outputs=outputs)


def draw(kind, rng):
    """Numbers of a scene, and position and velocity of its load at the start."""
    side = rng.choice([-1.0, 1.0])  # below or above the pulleys
    r1, r2 = rng.uniform(0.03, 0.15, 2)
    n = dict(k=rng.uniform(300, 3000), c=rng.uniform(0, 8), length=0.0, mass=rng.uniform(0.5, 3))
    n |= dict(support=rng.uniform(30, 300), viscosity=rng.uniform(0, 2), speed=side * rng.uniform(-0.3, 0.6))
    n |= dict(gravity=rng.choice([0.0, 9.81]), s1=side * rng.uniform(0, 0.2), s2=side * rng.uniform(0, 0.2))
    n |= dict(r1=-side * r1, r2=-side * r2 * (rng.choice([-1, 1]) if "pair" in kind else 1))
    place, velocity = np.array([len(KINDS[kind]) + rng.uniform(0, 0.5), rng.uniform(-0.4, 0.4)]), rng.uniform(-2, 2, 2)
    if kind == "swings":
        velocity = np.array([rng.uniform(-1, 1), side * rng.uniform(2, 8)])
    if kind == "winds":
        n |= dict(gravity=0.0)
        place = np.array([rng.uniform(0.6, 1.2), rng.uniform(-0.2, 0.2)])
        velocity = np.array([rng.uniform(-1, 1), -side * rng.uniform(3, 8) * place[0]])
    return n, place, velocity


class Reference:
    """Own equations: positions and velocities of the load and of the centres of pulleys, and a wrap for each pulley."""

    def __init__(self, kind, numbers):
        self.motions, self.n = KINDS[kind], numbers
        self.radii = np.array([0.0, *(numbers[f"r{i}"] for i in range(1, len(self.motions) + 1)), 0.0])

    def places(self, t, z):
        m, n = len(self.motions), self.n
        P, V = np.zeros((m + 2, 2)), np.zeros((m + 2, 2))
        P[0], P[-1], V[-1] = (-1, 0), z[:2], z[2:4]
        for i, motion in enumerate(self.motions, 1):
            s, at = n[f"s{i}"], 4 + 2 * (i - 1)
            y, vy = {"f": (s, 0), "d": (s - n["speed"] * t, -n["speed"]), "s": (z[at], z[at + 1])}[motion]
            P[i], V[i] = (i - 1, y), (0, vy)
        return P, V

    def tangent(self, P, V, i, j):
        """Length, angle and rate of the angle of the straight part that touches two circles."""
        d, w, across = P[j] - P[i], V[j] - V[i], self.radii[i] - self.radii[j]
        square = d @ d
        length = np.sqrt(square - across**2)
        turning = (d[0] * w[1] - d[1] * w[0]) / square
        return (
            length,
            np.arctan2(d[1], d[0]) + np.arcsin(across / np.sqrt(square)),
            turning - across * (d @ w) / square / length,
        )

    def taut(self, P, V, followed):
        """Length and points of the longest way whose wraps are not negative, and rates of wraps between neighbours."""
        m, best = len(P) - 2, (-1.0, None)
        for size in range(m + 1):
            for inner in combinations(range(1, m + 1), size):
                chain = (0, *inner, m + 1)
                parts = [self.tangent(P, V, i, j) for i, j in pairwise(chain)]
                wraps = [self.wrap(j, a[1], b[1], followed) for j, a, b in zip(inner, parts, parts[1:], strict=False)]
                length = sum(part[0] for part in parts) + sum(
                    abs(self.radii[j]) * w for j, w in zip(inner, wraps, strict=True)
                )
                if min(wraps, default=0) >= 0 and length > best[0]:
                    best = length, [(i, j, part[1]) for i, j, part in zip(chain, chain[1:], parts, strict=False)]
        parts = [self.tangent(P, V, i, i + 1) for i in range(m + 1)]
        rates = [np.sign(self.radii[i]) * (parts[i][2] - parts[i - 1][2]) for i in range(1, m + 1)]
        return *best, rates

    def wrap(self, j, before, behind, followed):
        turn = np.sign(self.radii[j]) * (behind - before)
        return turn + 2 * np.pi * np.round((followed[j - 1] - turn) / (2 * np.pi))

    def start(self, place, velocity):
        z = [*place, *velocity, *np.ravel([(self.n[f"s{i + 1}"], 0.0) for i in range(len(self.motions))])]
        P, V = self.places(0.0, z)
        parts = [self.tangent(P, V, i, i + 1)[1] for i in range(len(P) - 1)]
        turns = np.sign(self.radii[1:-1]) * np.diff(parts)
        return np.array([*z, *((turns + np.pi / 2) % (2 * np.pi) - np.pi / 2)])

    def __call__(self, t, z):
        n, m = self.n, len(self.motions)
        P, V = self.places(t, z)
        length, chain, rates = self.taut(P, V, z[-m:])
        u = np.zeros_like(P)  # sum of the directions in which the rope leaves each point
        for i, j, angle in chain:
            direction = np.array([np.cos(angle), np.sin(angle)])
            u[i] += direction
            u[j] -= direction
        stretch = length - n["length"]
        pull = max(n["k"] * stretch - n["c"] * np.sum(u * V), 0.0) if stretch > 0 else 0.0
        out = [*V[-1], *(pull * u[-1] / n["mass"] + [0, -n["gravity"]])]
        for i, motion in enumerate(self.motions, 1):
            force = n["support"] * (n[f"s{i}"] - P[i, 1]) - n["viscosity"] * V[i, 1] + pull * u[i, 1]
            out += [V[i, 1], force / 0.5 - n["gravity"]] if motion == "s" else [0.0, 0.0]
        return np.array([*out, *rates])

    def run(self, z0, rtol):
        return solve_ivp(
            self, TIMES[[0, -1]], z0, method="DOP853", rtol=rtol, atol=rtol * 1e-2, t_eval=TIMES, max_step=0.02
        ).y


def main(seed, count):
    rng, scenes, bad, worst, doubted, left_out = np.random.default_rng(seed), {}, [], 0.0, 0, 0
    left, wound = 0, 0
    for case in range(count):
        kind = [*KINDS][case % len(KINDS)]
        numbers, place, velocity = draw(kind, rng)
        own = Reference(kind, numbers)
        z0 = own.start(place, velocity)
        numbers["length"] = own.taut(*own.places(0.0, z0), z0[-len(own.motions) :])[0] * rng.uniform(0.97, 1.05)
        try:
            with np.errstate(invalid="raise"):
                right, coarse = own.run(z0, 1e-11), own.run(z0, 1e-9)
        except FloatingPointError:  # a load in its pulley
            left_out += 1
            continue
        size = np.abs(right[:4]).max()
        if right.shape != coarse.shape or np.abs(right - coarse)[:2].max() > 1e-8 * size:
            left_out += 1
            continue
        wraps = right[-len(own.motions) :]
        left, wound = left + bool((wraps < 0).any()), wound + bool((wraps > 1.5 * np.pi).any())
        scene = scenes.setdefault(kind, make_scene(kind))
        numbers |= dict(zip(LOAD, (*place, *velocity), strict=True))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.SymmbWarning)
            run = mb.simulate(scene, parameters=numbers)
        error = max(np.abs(run["x"] - right[0]).max(), np.abs(run["y"] - right[1]).max()) / size
        doubted += bool(run.doubts)
        worst = worst if run.doubts else max(worst, error)
        if error > 1e-7 and not run.doubts:
            bad.append((case, kind, error))
            print(case, kind, f"{error:.1e}", numbers, place, velocity)
    print(f"{count} ropes, {left} leave a pulley, {wound} wind past three quarters of a turn, {left_out} left out:")
    print(f"{len(bad)} wrong, {doubted} doubted, worst {worst:.1e}")
    return len(bad)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=300)
    arguments = parser.parse_args()
    raise SystemExit(main(arguments.seed, arguments.count) > 0)
