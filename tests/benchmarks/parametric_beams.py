"""Modes of beams with parameters against all finite elements in numbers: parametric_beams.py FIRST LAST.

For seeds FIRST to LAST - 1 it draws beams with moduli, densities and sizes of sections in a box, their supports and
modes. At 30 random points of the box it compares squared frequencies with those of modes computed there and of the
whole structure, by a dense solver, and the deflections under loads at interfaces with those of the whole structure.
Each line has the stated error and the errors found; it ends with OFF where one is larger than stated.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.linalg import eigh

import symmb as mb

sys.path.insert(0, str(Path(__file__).parents[1] / "structures"))
from structures import squares

POINTS = 30
_ROUNDING = 1e-6
"""Of stiffness matrices of slender beams across the axes of the mesh: the ratio of stretching to bending, in digits."""
NOMINAL = mb.Parameters(E=7e10, rho=2700.0, a=0.01, b=0.02)


def draw(rng: np.random.Generator) -> tuple[str, Callable[..., mb.FiniteElements], mb.Box, dict[str, object]]:
    """What was drawn, a function of E, rho, a, b and `at`, the box, and options of modes."""
    kind = str(rng.choice(["circle", "tube", "rectangle", "bar"]))
    points = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)] if rng.random() < 0.5 else rng.normal(size=(3, 3)) * [1, 1, 0]
    elements, mass = int(rng.integers(3, 7)), float(rng.choice([0.0, 0.5]))
    planar = bool(rng.random() < 0.5)
    spread = float(rng.choice([0.05, 0.3, 0.6]))
    names = [name for name in NOMINAL if rng.random() < 0.6] or ["E"]
    known = {"E": ["E"], "rho": ["rho"], "a": ["a"], "b": ["b"] if kind in ("rectangle", "tube") else []}
    names = [name for name in names if known[name]] or ["E"]

    def mesh(E: object, rho: object, a: object, b: object, at: object = None) -> mb.FiniteElements:
        section = {
            "circle": lambda: mb.Section.circle(a),
            "tube": lambda: mb.Section.circle(b, a),
            "rectangle": lambda: mb.Section.rectangle(b, a),
            "bar": lambda: mb.Section.rectangle(a, a / 2),
        }[kind]()
        material = mb.Material(E=E, nu=0.3, density=rho)
        beam = mb.Beam(points, section.without_shear(), material, elements=elements)
        some = mb.FiniteElements.beams(beam, at=at)
        return some.with_mass(len(some.positions) - 1, mass, 1e-3) if mass else some

    last = elements * (len(points) - 1)
    options = [
        {"clamped": 0, "count": int(rng.integers(2, 7))},
        {"count": int(rng.integers(2, 7))},
        {"interfaces": [0, last], "count": 6 + int(rng.integers(0, 3))},
        {"clamped": 0, "interfaces": [last]},
    ][int(rng.integers(4))]
    box = mb.Box.around(NOMINAL, spread if kind != "tube" else min(spread, 0.3), names)
    words = f"{kind} {'planar' if planar else 'spatial'} {options} ± {spread:.0%} of {', '.join(names)}"
    return words + (", mass" if mass else ""), mesh, box, {**options, "planar": planar}


def whole(mesh: mb.FiniteElements, planar: bool, clamped: bool) -> tuple[np.ndarray, np.ndarray]:
    """λ of all modes, and the compliance of the last node if the first one is clamped."""
    size = mesh.K.shape[0]
    free = [k for k in range(size) if (not planar or k % 6 in (0, 1, 5)) and not (clamped and k < 6)]
    K, M = (A.toarray()[np.ix_(free, free)] for A in (mesh.K, mesh.M))
    values = eigh(K, M, eigvals_only=True)
    if not clamped:
        return values[3 if planar else 6 :], np.zeros((0, 0))
    tip = [k for k, dof in enumerate(free) if dof >= size - 6]
    unit = np.eye(len(free))[:, tip]
    return values, unit.T @ np.linalg.solve(K, unit)


def errors(seed: int) -> tuple[str, float, list[float], int]:
    """What was drawn, the stated error, the largest errors found, and the number of modes."""
    words, mesh, box, options = draw(np.random.default_rng(seed))
    planar, clamped = bool(options["planar"]), "clamped" in options
    symbols = {name: getattr(NOMINAL, name) if name in box.names else NOMINAL[name] for name in NOMINAL}
    modes = mesh(**symbols, at=box).modes(**options)
    p = ca.vertcat(*(getattr(NOMINAL, name) for name in box.names))
    f, at = ca.Function("stiffness", [p], [modes.family.stiffness]), squares(modes, p, not clamped)
    tip = np.concatenate([modes.shapes[-1], modes.rotations[-1]])[[0, 1, 5] if planar else slice(None)]
    above, below, static = 0.0, 0.0, 0.0
    for x in box.from_unit(np.random.default_rng(seed + 1).uniform(-1, 1, (POINTS, len(box)))):
        numbers = mesh(**{**NOMINAL, **dict(zip(box.names, x.tolist(), strict=True))})
        found = at(x)
        wanted, (known, compliance) = numbers.modes(**options).stiffness, whole(numbers, planar, clamped)
        n = min(len(wanted), len(found))
        above = max(above, (found[:n] / wanted[:n] - 1).max())
        below = max(below, (1 - found[:n] / known[:n]).max())
        if clamped and "interfaces" in options:
            given = tip @ np.linalg.solve(f(x).full(), tip.T)
            size = np.sqrt(np.outer(np.diag(compliance), np.diag(compliance)))
            static = max(static, (np.abs(given - compliance) / size).max())
    return words, modes.error, [above, below, static], len(modes.stiffness)


def main(first: int, last: int) -> None:
    for seed in range(first, last):
        start = time.perf_counter()
        words, stated, found, n = errors(seed)
        off = max(found) > stated + _ROUNDING
        texts = ", ".join(
            f"{what} {error:.1e}" for what, error in zip(("above", "below", "static"), found, strict=True)
        )
        print(
            f"seed {seed}: {n} modes, stated {stated:.1e}, {texts}, {time.perf_counter() - start:.1f} s: {words}"
            + (" OFF" if off else ""),
            flush=True,
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
