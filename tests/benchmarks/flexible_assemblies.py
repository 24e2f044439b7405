"""Flexible cantilevers against the elastica and against what free modes lack: flexible_assemblies.py FIRST LAST.

For seeds FIRST to LAST - 1 it draws a cantilever of random length, section, mesh, modes, support and load at its end.
It prints how many ends are right, how many are told to be wrong, how many are wrong in silence: by more than 3 % of the
length or 10 % of the deflection, and how many are doubted though right within 1 % of both.
"""

import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from flexible_scenes import elastica

import symmb as mb


def draw(seed: int) -> tuple[str, float, tuple[str, ...]]:
    """What was drawn, how far its end is off, 1 where it is wrong, and its doubts."""
    rng = np.random.default_rng(seed)
    length, n, load = rng.uniform(0.2, 3), int(rng.integers(2, 16)), 10 ** rng.uniform(-3, 1)
    section = mb.Section.circle(length * rng.uniform(0.001, 0.01)).without_shear()
    material = mb.Material(E=10 ** rng.uniform(9, 11.5), density=rng.uniform(1000, 8000), nu=0.3)
    EI = material.E * section.Iz
    mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (length, 0, 0)], section, material, elements=n))
    kind = str(rng.choice(["free modes", "free interfaces", "clamped modes", "clamped interface"]))
    if kind == "free modes":
        modes = mesh.modes(count=int(rng.integers(2, 2 * n)), planar=True)
    elif kind == "free interfaces":
        modes = mesh.modes(interfaces=[0, n], planar=True)
    elif kind == "clamped modes":
        modes = mesh.modes(clamped=0, count=int(rng.integers(1, 2 * n)), planar=True)
    else:
        modes = mesh.modes(clamped=0, interfaces=[n], planar=True, stiffening=bool(rng.random() < 0.5))
    ground, rod = mb.Ground(), mb.FlexibleBody("rod", modes, mb.Planar())
    tip = rod.point(length, 0)
    push = mb.Force("push", tip, (0, -load * EI / length**2))
    system = mb.System(rod, mb.Weld("clamp", ground.point(0, 0), rod.point(0, 0)), push)
    outputs = {"x": tip.x, "y": tip.y}
    run = mb.simulate(mb.Scene(system, times=[0.0, 1e-3], outputs=outputs, equilibrium=True))
    x, y = np.abs(elastica(load))
    down = abs(run["y"][0] / length + y)
    off = max(abs(run["x"][0] / length - x) / 0.03, down / 0.03, down / y / 0.1)
    return f"{kind}, {len(modes.stiffness)} modes, load {load:.2g}", float(off), run.doubts


def main(first: int, last: int) -> None:
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    for seed in range(first, last):
        try:
            what, off, doubts = draw(seed)
        except mb.SymmbError as error:
            counts["refused"] += 1
            print(f"seed {seed}: {type(error).__name__} {str(error)[:120]}", flush=True)
            continue
        right, wrong = off < 0.1, off > 1
        word = ("NEEDLESS DOUBT" if right else "told") if doubts else "WRONG IN SILENCE" if wrong else "right"
        counts[word] += 1
        if word.isupper():
            print(f"seed {seed}: {what}: {word}, off by {off:.3f}", flush=True)
    print(", ".join(f"{word} {n}" for word, n in counts.items()))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
