"""Largest tolerances where some runs have no value: half spaces and corners of the box in which runs fail.

    PYTHONPATH=. python tests/benchmarks/failing_tolerances.py [seed] [number]

Each row shows the factor at which runs begin to fail, the factor at which the limit is reached, and the factor that
`mb.tolerances` finds, over the smaller of both. The reason that ends the search must be the right one.
"""

import itertools
import sys
import warnings

import numpy as np

import symmb as mb

STEPS = np.linspace(0.0, 1.5, 3001)


def problem(rng: np.random.Generator):
    """A simulator, a box, a limit, and the factors at which runs fail and at which the limit is reached."""
    d = int(rng.integers(1, 5))
    slope, bend = rng.uniform(0.3, 1.0, d) * rng.choice([-1, 1], d), rng.uniform(-0.06, 0.06, (d, d))
    limit, in_corner = rng.uniform(0.05, 3.0), bool(rng.integers(2))
    normal = rng.uniform(0.3, 1.0, d) * rng.choice([-1, 1], d)
    share = rng.uniform(0.1, 0.9)

    def fails(x):
        if in_corner:  # all parameters are beyond a part of their tolerance
            return (x * np.sign(normal)).min(axis=-1) > share
        return x @ normal > share * np.abs(normal).sum()

    def f(**p):
        x = np.array([*p.values()])
        if fails(x):
            raise ValueError("does not assemble")
        return [[x @ slope + x @ bend @ x]]

    grid = np.array(list(itertools.product(np.linspace(-1.0, 1.0, 9), repeat=d)))
    linear, square = grid @ slope, np.einsum("ni,ij,nj->n", grid, bend, grid)
    reached = next((s for s in STEPS if (s * linear + s**2 * square).max() > limit), 1.5)
    names = [f"x{i}" for i in range(d)]
    simulator = mb.FunctionSimulator(f, dict.fromkeys(names, 0.0), [0.0], ["y"])
    return simulator, mb.Box(**dict.fromkeys(names, (-1.0, 1.0))), limit, share, reached


def main(seed: int, number: int) -> None:
    """Print the table."""
    rng, ratios, wrong = np.random.default_rng(seed), [], 0
    warnings.simplefilter("ignore", mb.SymmbWarning)
    for k in range(number):
        simulator, box, limit, failed, reached = problem(rng)
        found = mb.tolerances(simulator, {"y": (None, limit)}, box=box)
        told = any("fail" in remark for remark in found.remarks)
        ratios.append(found.factor / min(failed, reached))
        is_right = told == (failed < reached) or abs(failed / reached - 1) < 0.02
        wrong += not is_right
        row = f"{k:3d} d={len(box)} fails at {failed:.3f}, limit at {reached:.3f}: {ratios[-1]:.3f}"
        print(f"{row}, {found.evaluations} runs{'' if is_right else ', wrong reason'}", flush=True)
    print(f"least {min(ratios):.3f}, largest {max(ratios):.3f}, wrong reasons {wrong}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:] or (0,)), *([40] if len(sys.argv) < 3 else []))
