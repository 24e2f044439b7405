"""A sample's run among others against the same run alone, for every shipped model with switches.

    python tests/benchmarks/lanes.py [SAMPLES [SEED [MODEL ...]]]

Samples of a block share their steps, so that a run depends on its neighbours within the tolerance. For each output this
prints the largest differences over its largest value: between two orders of the samples, and between a block and a
block of eight equal samples. It also prints how many differ by more than 1e-6, a hundred tolerances.
"""

import importlib
import sys
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import symmb as mb

MODELS = ("stick_slip", "half_car", "spin_up_beam", "bouncing_ball", "artillery")
FAR = 1e-6


def main(samples: int = 2000, seed: int = 1, *models: str) -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    for name in models or MODELS:
        scene = importlib.import_module(f"models.{name}").scene()
        simulator = mb.DAESimulator(scene)
        rng = np.random.default_rng(seed)
        P = np.tile(np.array(list(simulator.parameters.values()), dtype=float), (samples, 1))
        for k, parameter in enumerate(simulator.parameters):
            if parameter in scene.box.names:
                P[:, k] = rng.uniform(*scene.box.bounds[scene.box.names.index(parameter)], samples)
        order, alone = rng.permutation(samples), rng.choice(samples, max(1, samples // 8), replace=False)
        begin = time.perf_counter()
        Y = simulator.run(P).Y
        seconds = time.perf_counter() - begin
        other = np.empty_like(Y)
        other[order] = simulator.run(P[order]).Y
        single = simulator.run(np.repeat(P[alone], 8, axis=0)).Y[::8]
        size = np.abs(Y).max(axis=(0, 1))
        print(f"{name}: {samples} samples by {simulator.solver!r}, {seconds:.1f} s")
        for k, output in enumerate(simulator.outputs):
            moved = np.abs(Y[..., k] - other[..., k]).max(axis=1) / size[k]
            apart = np.abs(Y[alone, :, k] - single[..., k]).max(axis=1) / size[k]
            print(f"  {output:24} in another order {moved.max():.1e}, {(moved > FAR).sum()} far;", end=" ")
            print(f"alone {apart.max():.1e}, {(apart > FAR).sum()} far")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]), *sys.argv[3:])
