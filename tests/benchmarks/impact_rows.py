"""Rows of bodies in contact that are struck: against sums of impacts, one after another, by NumPy.

    PYTHONPATH=. python tests/benchmarks/impact_rows.py [--seed 0] [--number 200]

Two to twelve bodies on a line without forces, between walls in some, with equal or random masses, gaps that are 0 or
not, and restitutions of 0, 1 or between; and stacks that fall on a floor and come to rest. A row is wrong if a velocity
is off by TOLERANCE and nothing is doubted, if an instant has more than MOST_AT_ONCE events, or if it takes SECONDS.
"""

import argparse
import time
import warnings
from collections import Counter

import numpy as np

import symmb as mb

TOLERANCE, MOST_AT_ONCE, SECONDS = 1e-7, 100, 10.0
REST = 1e-13
"""Rate over the first speed below which bodies stay together."""


def velocities(x, v, m, e, walls, end, order):
    """Velocities at a time: impacts in sweeps over the contacts, in one order or the other."""
    x, v, t = x.copy(), v.copy(), 0.0
    n, size = len(x), np.abs(v).max()

    def rates():
        return np.concatenate([np.diff(v), [v[0], -v[-1]] if walls else []])

    def gaps():
        return np.concatenate([np.diff(x) - 1.0, [x[0] - 0.5, walls - 0.5 - x[-1]] if walls else []])

    for _ in range(200_000):
        g, r = gaps(), rates()
        closing = r < -REST * size
        wait = np.where(closing, np.maximum(g, 0.0) / np.where(closing, -r, 1.0), np.inf)
        if t + wait.min() >= end:
            return v
        x, t = x + v * wait.min(), t + wait.min()
        touching = gaps() < 1e-13 * n
        for _ in range(100_000):
            hits = np.flatnonzero(touching & (rates() < -REST * size))
            if not len(hits):
                break
            for k in hits[::order]:
                rate = rates()[k]
                if rate < 0 and k < n - 1:
                    impulse = -(1 + e[k]) * rate / (1 / m[k] + 1 / m[k + 1])
                    v[k] -= impulse / m[k]
                    v[k + 1] += impulse / m[k + 1]
                elif rate < 0:
                    v[0 if k == n - 1 else -1] *= -e[k]
    return None


def row(rng):
    """A scene, and its velocities at the end by both orders; None where the sums do not end."""
    n, walls = int(rng.integers(2, 13)), 0.0
    gaps = np.where(rng.random(n) < 0.7, 0.0, rng.uniform(0.1, 1.0, n))
    gaps[1] = rng.uniform(0.2, 1.0)
    x = 0.5 + np.cumsum(gaps + 1) - 1
    m = np.ones(n) if rng.random() < 0.5 else rng.uniform(0.5, 2.0, n)
    v = np.zeros(n)
    v[0] = 1.0
    if rng.random() < 0.3:
        walls = x[-1] + 0.5 + (0.0 if rng.random() < 0.5 else rng.uniform(0.1, 1.0))
    e = np.full(n + 1, rng.choice([0.0, 1.0, rng.uniform(0.05, 0.95)]))
    end = float(gaps[1] + rng.uniform(0.5, 6.0))
    b = [mb.Body(f"b{i}", m[i], pose=mb.Particle()) for i in range(n)]
    contacts = [mb.Impact(f"c{i}", b[i + 1].x - b[i].x - 1.0, e[i]) for i in range(n - 1)]
    if walls:
        contacts += [mb.Impact("left", b[0].x - 0.5, e[-2]), mb.Impact("right", walls - 0.5 - b[-1].x, e[-1])]
    start = {f"b{i}.x": x[i] for i in range(n)} | {f"b{i}.vx": v[i] for i in range(n)}
    scene = mb.Scene(mb.System(*b, *contacts), start, np.linspace(0, end, 3), {f"v{i}": b[i].vx for i in range(n)})
    right = [velocities(x, v, m, e, walls, end, order) for order in (1, -1)]
    return scene, right, f"row of {n}, restitution {e[0]:.2f}{', walls' if walls else ''}"


def stack(rng):
    """Bodies above each other that fall from a low height: all come to rest."""
    n, e = int(rng.integers(2, 9)), rng.choice([0.0, rng.uniform(0.05, 0.5)])
    b = [mb.Body(f"b{i}", rng.uniform(0.5, 2.0), pose=mb.Particle()) for i in range(n)]
    below = [0.0, *(each.y for each in b)]
    contacts = [mb.Impact(f"c{i}", b[i].y - below[i] - 1.0, e) for i in range(n)]
    start = {f"b{i}.y": 1.0 + i + (0.05 if rng.random() < 0.5 else 0.0) + 0.05 * i for i in range(n)}
    system = mb.System(*b, *contacts, mb.Gravity(0, -9.81))
    scene = mb.Scene(system, start, np.linspace(0, 4, 3), {f"v{i}": b[i].vy for i in range(n)})
    return scene, [np.zeros(n)] * 2, f"stack of {n}, restitution {e:.2f}"


def outcome(rng):
    build = stack if rng.random() < 0.25 else row
    scene, right, text = build(rng)
    begin = time.process_time()
    try:
        run = mb.simulate(scene)
    except mb.SymmbError as error:
        return "REFUSED", f"{text}: {error}"
    seconds = time.process_time() - begin
    most = max(Counter(event.time for event in run.events).values(), default=0)
    if any(one is None for one in right):
        return "no sum", text
    end = np.array([run[name][-1] for name in run.names])
    off, apart = min(abs(end - one).max() for one in right), abs(right[0] - right[1]).max()
    line = f"{text}: off by {off:.1e}, {len(run.events)} events, {most} at once, {seconds:.1f} s {run.doubts}"
    if most > MOST_AT_ONCE or seconds > SECONDS:
        return "SLOW", line
    if off > TOLERANCE:
        return ("doubted" if run.doubts else "WRONG"), line
    return ("right and doubted" if run.doubts and apart < TOLERANCE and build is row else "right"), line


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--number", type=int, default=200)
    asked = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    kinds = Counter()
    for k in range(asked.number):
        kind, line = outcome(np.random.default_rng([asked.seed, k]))
        kinds[kind] += 1
        if kind != "right":
            print(f"{kind}: {k} {line}", flush=True)
    print(dict(kinds))
