"""Runs a second on a graphics card beside one core of the same machine, and the difference of their bounds.

    pip install -e '.[cuda]' && python tests/benchmarks/cards.py [MODEL ...]

Each row has the time of the first study with the compiler [s], the runs a second of streamed extremes on the card and
on one core, and the largest difference of bounds of the same samples, over the width. A sample on the card has its own
steps, and samples on the core share theirs, so the difference is the error of the solver. `alone` is the difference
from samples of the core that run alone. The last rows are 1e8 runs of the double pendulum, and the free memory of the
card before and after them.

Without a card, `python tests/benchmarks/cards.py --compile [MODEL ...]` compiles the sources of all models for two
architectures, and prints the seconds and the size of each.
"""

import importlib
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from _timing import pin

sys.path.insert(0, str(Path(__file__).parents[2]))

import symmb as mb
from symmb.run.codegen import Card
from symmb.run.codegen.card import CudaCard, compiled

MODELS = (
    *("double_pendulum", "four_bar", "slider_crank", "stewart_platform", "half_car", "bouncing_ball", "stick_slip"),
    *("six_axis_arm", "andrews", "bicycle", "car_axis", "chain", "double_wishbone", "excavator", "flexible_pendulum"),
    *("heavy_top", "laval_rotor", "n_four_bar", "rolling_disc", "slider_crank_flexible", "slider_crank_spatial"),
    *("spherical_pendulum", "spin_up_beam"),
)
ON_CARD, ON_CORE, ALONE = 500_000, 4_000, 8
"""Numbers of runs on the card, on the core, and alone."""


class Compiler(Card):
    """A card that only compiles."""

    def __init__(self, architecture: str) -> None:
        self.architecture, self.size = architecture, 0

    def kernel(self, source: str) -> None:
        self.size = len(compiled(source, self.architecture))

    def _no_runs(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError

    free = memory = read = launch = _no_runs


def prepared(name: str) -> mb.DAESimulator:
    scene = importlib.import_module(f"models.{name}").scene()
    return mb.prepare(scene, None if name == "bouncing_ball" else mb.DormandPrince())


def samples(simulator: mb.DAESimulator, n: int) -> np.ndarray:
    P = np.tile(np.array([*simulator.parameters.values()], dtype=float), (n, 1))
    names = [*simulator.parameters]
    assert simulator.box is not None
    for name, bounds in zip(simulator.box.names, simulator.box.bounds, strict=True):
        P[:, names.index(name)] = np.random.default_rng(1).uniform(*bounds, n)
    return P


def timed(simulator: mb.DAESimulator, P: np.ndarray) -> tuple[float, np.ndarray]:
    begin = time.perf_counter()
    extremes = np.stack(simulator.run(P).extremes())
    return time.perf_counter() - begin, extremes


def row(name: str, card: CudaCard) -> str:
    core = prepared(name)
    begin = time.perf_counter()
    fast = core.on_card(card)
    P = samples(core, ON_CARD)
    _, own = timed(fast, P[:ON_CORE])
    first = time.perf_counter() - begin
    seconds, _ = timed(fast, P)
    core.threads = 1
    on_core, other = timed(core, P[:ON_CORE])
    width = np.ptp(other, axis=0).max(axis=0)
    alone = [np.abs(fast.run(p[None]).Y - core.run(p[None]).Y).max(axis=(0, 1)) for p in P[:ALONE]]
    far = (np.abs(own - other).max(axis=(0, 1)) / width).max(), (np.max(alone, axis=0) / width).max()
    return f"{name:22} {first:6.1f} {ON_CARD / seconds:12.4g} {ON_CORE / on_core:12.4g} {far[0]:10.1e} {far[1]:10.1e}"


def main(*models: str) -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    if models[:1] == ("--compile",):
        for name in models[1:] or MODELS:
            for architecture in ("sm_80", "sm_90"):
                card, core = Compiler(architecture), prepared(name)
                begin = time.perf_counter()
                core.on_card(card)
                print(f"{name:22} {architecture} {time.perf_counter() - begin:6.1f} s {card.size:9} bytes", flush=True)
        return
    pin()
    card = CudaCard()
    print(f"{'model':22} {'first':>6} {'card [1/s]':>12} {'core [1/s]':>12} {'shared':>10} {'alone':>10}")
    for name in models or MODELS:
        print(row(name, card), flush=True)
    simulator, before = prepared("double_pendulum").on_card(card), card.free()
    begin = time.perf_counter()
    mb.propagate(simulator, mb.MonteCarlo(100_000_000))
    print(f"1e8 runs: {time.perf_counter() - begin:.1f} s, {before / 1e9:.1f} and {card.free() / 1e9:.1f} GB free")


if __name__ == "__main__":
    main(*sys.argv[1:])
