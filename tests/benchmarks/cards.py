"""Runs a second on a graphics card beside one core of the same machine, and how far their bounds differ.

    pip install -e '.[cuda]' && python tests/benchmarks/cards.py [MODEL ...]

This takes some minutes on an H200. At first, processes compile the sources of all models. Each row then has the time of
the first study on the card [s], the runs a second of streamed extremes on the card and on one core, the difference of
bounds of the same samples, and the difference of samples that run alone, both over the width. A sample on the card has
its own steps, and samples on the core share theirs, so the first difference is the error of the solver. `same` says
whether another study on the card, in small portions, has the same bits.

The next rows are of the double pendulum: parts of the time of a block of runs, a histogram of runs, and up to 1e8 runs,
as many as take a minute, with the free memory of the card before and after. If JAX and Diffrax are installed, the last
row has the runs a second of `vmap` of the equations by hand, with the same method, tolerances and outputs.

Without a card, `python tests/benchmarks/cards.py --compile [MODEL ...]` compiles the sources of all models for two
architectures, and prints the seconds and the size of each. `--jax` only makes the row of JAX.
"""

import importlib
import importlib.util
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
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
FIRST, MOST, ON_CORE, ALONE, SECONDS = 2**16, 2**20, 512, 8, 3.0
"""Numbers of runs on the card at first and at most, on the core, and alone, and time on the card of each model."""


class Compiler(Card):
    """A card that only compiles."""

    def __init__(self, architecture: str) -> None:
        self.architecture, self.size = architecture, 0

    def kernels(self, source: str) -> Any:
        self.size = len(compiled(source, self.architecture))

    def _no_runs(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError

    free = memory = read = launch = _no_runs


class SmallCard(CudaCard):
    """A card with little free memory, so that samples run in portions."""

    def free(self) -> int:
        return 2 * 10**8


def prepared(name: str) -> mb.DAESimulator:
    scene = importlib.import_module(f"models.{name}").scene()
    return mb.prepare(scene, None if name == "bouncing_ball" else mb.DormandPrince())


def precompiled(name: str, architecture: str) -> tuple[str, str, float, int]:
    """The name, the architecture, the time of the compiler [s], and the size of the result [bytes]."""
    warnings.simplefilter("ignore", mb.SymmbWarning)
    card, core = Compiler(architecture), prepared(name)
    begin = time.perf_counter()
    core.on_card(card)
    return name, architecture, time.perf_counter() - begin, card.size


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
    P = samples(core, MOST)
    _, own = timed(fast, P[:ON_CORE])
    first = time.perf_counter() - begin
    trial, whole = timed(fast, P[:FIRST])
    n = min(MOST, max(FIRST, int(FIRST * SECONDS / trial)))
    seconds, _ = timed(fast, P[:n])
    same = np.array_equal(whole, timed(core.on_card(SmallCard()), P[:FIRST])[1])
    core.threads = 1
    on_core, other = timed(core, P[:ON_CORE])
    width = np.ptp(other, axis=0).max(axis=0)
    alone = np.stack([core.run(p[None]).Y[0] for p in P[:ALONE]]) - fast.run(P[:ALONE]).Y
    far = (np.abs(own - other).max(axis=(0, 1)) / width).max(), (np.abs(alone).max(axis=(0, 1)) / width).max()
    rates = f"{n / seconds:12.4g} {ON_CORE / on_core:12.4g}"
    return f"{name:22} {first:6.1f} {rates} {far[0]:10.1e} {far[1]:10.1e} {'yes' if same else 'NO'}"


def parts(card: CudaCard) -> None:
    """Print the seconds of the parts of a block, of quantiles by runs, and of up to 1e8 runs."""
    core = prepared("double_pendulum")
    fast = core.on_card(card)
    engine, box = fast.program.engine(), core.box
    assert box is not None
    begin = time.perf_counter()
    unit = mb.Random().points(MOST, len(box), 0)
    P = np.tile(np.array([*core.parameters.values()]), (MOST, 1))
    P[:, [[*core.parameters].index(name) for name in box.names]] = box.from_unit(unit)
    samples_made, launch, times = time.perf_counter() - begin, type(card).launch, list[tuple[int, float]]()

    def watched(self: CudaCard, kernel: Any, groups: int, threads: int, arguments: tuple[int, ...]) -> None:
        begin = time.perf_counter()
        launch(self, kernel, groups, threads, arguments)
        times.append((len(arguments), time.perf_counter() - begin))

    CudaCard.launch = watched
    total, _ = timed(fast, P)
    CudaCard.launch = launch
    run, reduce = (sum(seconds for n, seconds in times if (n == 1) == runs) for runs in (True, False))
    rest = total - run - reduce
    print(f"{MOST} runs: samples {samples_made:.3f} s, runs {run:.3f} s, reduction {reduce:.3f} s, rest {rest:.3f} s")
    ends = np.stack(fast.run(P[:FIRST]).extremes())[:, :, 0]
    begin = time.perf_counter()
    counts, _ = engine.histogram(np.empty((MOST, 0)), P, 0, ends, 2048)  # pyright: ignore[reportAttributeAccessIssue]
    print(f"{counts[0].sum()} runs with a histogram of one output: {time.perf_counter() - begin:.3f} s")
    n, before = int(min(10**8, 60 * MOST / (total + samples_made))), card.free()
    begin = time.perf_counter()
    mb.propagate(fast, mb.MonteCarlo(n))
    print(f"{n:.3g} runs: {time.perf_counter() - begin:.1f} s, {before / 1e9:.1f} and {card.free() / 1e9:.1f} GB free")


def by_jax(batch: int = 2**14) -> str:
    """The runs a second of the double pendulum by JAX and Diffrax, and how far their extremes are from symmb's."""
    import diffrax  # pyright: ignore[reportMissingImports]
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    core = prepared("double_pendulum")
    tolerances = {"rtol": 1e-8, "atol": 1e-10}  # those of DormandPrince() in this scene

    def rates(t: Any, state: Any, lengths: Any) -> Any:
        (a, b, u, v), (l1, l2) = state, lengths
        c, s, g = jnp.cos(a - b), jnp.sin(a - b), 9.81
        m11, m12, m22 = l1**3 / 3 + l2 * l1**2, l2 * l1 * l2 * c / 2, l2**3 / 3
        f1 = -l1 * l2**2 * v**2 * s / 2 - (l1 / 2 + l2) * g * l1 * jnp.sin(a)
        f2 = l1 * l2**2 * u**2 * s / 2 - l2**2 * g * jnp.sin(b) / 2
        determinant = m11 * m22 - m12**2
        return jnp.array([u, v, (m22 * f1 - m12 * f2) / determinant, (m11 * f2 - m12 * f1) / determinant])

    def outputs(t: Any, state: Any, lengths: Any) -> Any:
        (a, b, u, v), (l1, l2) = state, lengths
        x, y, dx, dy = l1 * jnp.sin(a), l1 * jnp.cos(a), l1 * jnp.cos(a) * u, -l1 * jnp.sin(a) * u
        own = l2 * jnp.sin(b) / 2, l2 * jnp.cos(b) / 2, l2 * jnp.cos(b) * v / 2, -l2 * jnp.sin(b) * v / 2
        second = x + own[0], y + own[1], b, dx / 2, dy / 2, u, dx + own[2], dy + own[3], v
        return jnp.array([x / 2, y / 2, a, *second])

    def run(lengths: Any) -> Any:
        save = diffrax.SaveAt(ts=jnp.asarray(core.times), fn=outputs)
        control = diffrax.PIDController(**tolerances)
        start, term = jnp.array([np.pi / 4, np.pi / 3, 0.0, 0.0]), diffrax.ODETerm(rates)
        return diffrax.diffeqsolve(
            term, diffrax.Dopri8(), 0.0, 10.0, None, start, lengths, saveat=save, stepsize_controller=control
        ).ys

    @jax.jit
    def extremes(P: Any) -> Any:
        Y = jax.vmap(run)(P)
        return jnp.stack([Y.min(axis=0), Y.max(axis=0)])

    P = samples(core, batch)
    begin = time.perf_counter()
    own = np.array(extremes(P))
    first, n, begin = time.perf_counter() - begin, 0, time.perf_counter()
    while time.perf_counter() < begin + SECONDS:
        extremes(P).block_until_ready()
        n += batch
    rate, other = n / (time.perf_counter() - begin), timed(core, P)[1]
    far = (np.abs(own - other).max(axis=(0, 1)) / np.ptp(other, axis=0).max(axis=0)).max()
    return f"JAX and Diffrax on {jax.devices()[0]}: first {first:.1f} s, {rate:.4g} runs/s, difference {far:.1e}"


def main(*models: str) -> None:
    warnings.simplefilter("ignore", mb.SymmbWarning)
    if models[:1] == ("--jax",):
        print(by_jax(int(models[1]) if models[1:] else 2**14))
        return
    only, names = models[:1] == ("--compile",), models[1:] if models[:1] == ("--compile",) else models
    names, card = names or MODELS, None if only else CudaCard()
    architectures = ("sm_80", "sm_90") if card is None else (card.architecture,)
    tasks = [(name, architecture) for name in names for architecture in architectures]
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for name, architecture, seconds, size in pool.map(precompiled, *zip(*tasks, strict=True)):
            if card is None:
                print(f"{name:22} {architecture} {seconds:6.1f} s {size:9} bytes", flush=True)
    if card is None:
        return
    pin()
    print(f"{'model':22} {'first':>6} {'card [1/s]':>12} {'core [1/s]':>12} {'shared':>10} {'alone':>10} same")
    for name in names:
        print(row(name, card), flush=True)
    parts(card)
    if importlib.util.find_spec("jax") and importlib.util.find_spec("diffrax"):
        print(by_jax())


if __name__ == "__main__":
    main(*sys.argv[1:])
