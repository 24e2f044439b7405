"""Runs on a graphics card. Two threads of a processor run the same sources in place of the card."""

import ctypes
import enum
import itertools
import pickle
import shutil
import subprocess
import sys
from importlib import import_module
from typing import Any

import casadi as ca
import machines
import numpy as np
import pytest
from faults import refused
from scipy.stats import uniform
from small_scenes import formulas, particle

import symmb as mb
from symmb.run.codegen import Card
from symmb.run.codegen.card import KERNELS, CardError, CudaCard, compiled
from symmb.run.formulations import CardEnsemble
from symmb.study.tolerances import of_outputs

CXX = shutil.which("g++") or shutil.which("clang++")
SAME = 1e-12
"""Largest difference from lanes, over the largest value of an output. Each lane runs the same sample."""
SHIM = """
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <thread>
#define __global__
struct Place { unsigned x; };
static thread_local Place blockIdx, threadIdx;
static Place blockDim, gridDim;
static inline void atomicAdd(unsigned long long *a, long b) { __atomic_fetch_add(a, b, __ATOMIC_RELAXED); }
"""
LAUNCH = """
template <typename... T> static void side_by_side(long groups, long threads, void (*kernel)(T...), T... arguments) {
  gridDim.x = groups, blockDim.x = threads;
  const auto work = [=](unsigned half) {
    for (blockIdx.x = half; blockIdx.x < gridDim.x; blockIdx.x += 2)
      for (threadIdx.x = 0; threadIdx.x < blockDim.x; ++threadIdx.x) kernel(arguments...);
  };
  std::thread other(work, 1);
  work(0);
  other.join();
}
#define LAUNCH(name, parameters, ...) \\
  extern "C" void launch_##name parameters { side_by_side(groups, threads, name, __VA_ARGS__); }
LAUNCH(run_samples, (long groups, long threads, Study *s), s)
LAUNCH(summarize, (long groups, long threads, const Study *s, long first, double *summaries), s, first, summaries)
LAUNCH(count_values, (long groups, long threads, const Study *s, long first, unsigned long long *counts,
       const double *ends, long output, long n), s, first, counts, ends, output, n)
"""


class Bytes:
    def __init__(self, size: int, content: np.ndarray | None) -> None:
        self.bytes = np.full(size, 255, dtype=np.uint8)  # NaN, so that reading before writing is noticed
        if content is not None:
            self.bytes[:] = np.frombuffer(np.ascontiguousarray(content).tobytes(), dtype=np.uint8)
        self.address = self.bytes.ctypes.data


class Processor(Card):
    """A processor in place of a card."""

    _count = itertools.count()  # a path whose library is open would give this library

    def __init__(self, folder, room: int = 10**9) -> None:
        self.folder, self.room, self.launches, self.sent = folder, room, 0, 0

    def kernels(self, source: str):
        if CXX is None:
            pytest.skip("needs a C++ compiler")
        path = self.folder / f"{next(self._count)}.so"
        flags = ["-O1", "-ffp-contract=off", "-std=c++17", "-shared", "-fPIC", "-pthread", "-w", "-x", "c++", "-"]
        text = f"{SHIM}{source}{LAUNCH}"
        subprocess.run([str(CXX), *flags, "-o", str(path)], input=text, text=True, check=True)
        library = ctypes.CDLL(str(path))
        return {name: getattr(library, f"launch_{name}") for name in KERNELS}

    def free(self) -> int:
        return self.room

    def memory(self, size: int, content: np.ndarray | None = None) -> Bytes:
        return Bytes(size, content)

    def read(self, memory: Any, to: np.ndarray) -> np.ndarray:
        self.sent = max(self.sent, to.nbytes)  # at once
        to.reshape(-1).view(np.uint8)[:] = memory.bytes[: to.nbytes]
        return to

    def launch(self, kernel, groups: int, threads: int, arguments: tuple[int, ...]) -> None:
        self.launches += 1
        kernel(*map(ctypes.c_long, (groups, threads, *arguments)))


MODELS = ("double_pendulum", "four_bar", "bouncing_ball", "half_car", "slider_crank_spatial")
OTHERS = (
    *("andrews", "bicycle", "car_axis", "chain", "double_wishbone", "excavator", "flexible_pendulum", "heavy_top"),
    *("laval_rotor", "n_four_bar", "rolling_disc", "six_axis_arm", "slider_crank", "slider_crank_flexible"),
    *("spherical_pendulum", "spin_up_beam", "stewart_platform", "stick_slip"),
)


def prepared(name: str) -> mb.DAESimulator:
    """A shipped scene in lanes, with explicit steps."""
    scene = import_module(f"models.{name}").scene()
    return mb.prepare(scene, None if name == "bouncing_ball" else mb.DormandPrince())


def samples_of(simulator: mb.DAESimulator, n: int) -> np.ndarray:
    nominal = np.array([*simulator.parameters.values()])
    return nominal * (1 + 0.01 * np.random.default_rng(5).uniform(-1, 1, (n, len(nominal))))


def differs(own: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Largest difference of each output, over its largest value."""
    return np.abs(own - other).max(axis=(0, 1)) / np.maximum(np.abs(own).max(axis=(0, 1)), np.finfo(float).tiny)


@pytest.mark.parametrize("name", [*MODELS, *(pytest.param(name, marks=pytest.mark.long) for name in OTHERS)])
def test_samples_are_those_of_lanes(tmp_path, name):
    lanes = prepared(name)
    card = lanes.on_card(Processor(tmp_path))
    for p in samples_of(lanes, 2):
        own, other, rounded = (each.run(p[None] * by) for each, by in ((lanes, 1), (card, 1), (lanes, 1 + 2**-52)))
        assert own.ok.all() and other.ok.all()
        # Rounding of the last bit changes steps at switches, and by that the runs of stick_slip.
        assert (differs(own.Y, other.Y) <= np.maximum(SAME, 3 * differs(own.Y, rounded.Y))).all()


def card_runs(card: mb.DAESimulator, P: np.ndarray) -> CardEnsemble:
    runs = card.run(P)
    assert isinstance(runs, CardEnsemble)
    return runs


def assert_reduced(runs: CardEnsemble, Y: np.ndarray) -> None:
    """Reductions of runs are those of the outputs Y (N, n_t, n_y) of the same runs that did not fail, by NumPy."""
    ends, (mean, sigma), numbers = np.stack(runs.extremes()), runs.moments(), np.flatnonzero(runs.ok)
    values, size = Y[numbers], np.abs(Y[numbers]).max(initial=0.0)
    assert np.array_equal(ends, [values.min(axis=0, initial=np.inf), values.max(axis=0, initial=-np.inf)])
    if len(values):
        places = np.stack([values.argmin(axis=0), values.argmax(axis=0)])
        assert runs.attaining is not None and np.array_equal(runs.attaining, numbers[places])
        assert np.allclose(mean, values.mean(axis=0), rtol=0, atol=1e-14 * size)
        assert np.allclose(sigma, values.std(axis=0), rtol=1e-12, atol=1e-14 * size)
    edges = np.sort(np.random.default_rng(1).uniform(-size, size, (2, values.shape[1])), axis=0)
    for k in range(values.shape[2]):
        counts = runs.histogram(k, edges, 7)
        for i in range(0, len(counts), 50):
            (low, high), own = edges[:, i], counts[i]
            assert np.array_equal(own, np.histogram(np.clip(values[:, i, k], low, high), 7, (low, high))[0])


@pytest.mark.parametrize("n", [0, 1, 31, 33])
def test_reductions_are_those_of_all_outputs(tmp_path, n):
    scene = falling()
    card = mb.prepare(scene, mb.DormandPrince()).on_card(Processor(tmp_path))
    P = np.linspace(1.0, 9.0, 33)[:n, None]
    assert_reduced(card_runs(card, P), card.run(P).Y)


@pytest.mark.parametrize("name", ["double_pendulum", "bouncing_ball"])
def test_portions_do_not_change_results(tmp_path, name):
    lanes, P = prepared(name), samples_of(prepared(name), 150)
    once, often = Processor(tmp_path), Processor(tmp_path, room=10**6)
    whole, parts = lanes.on_card(once).run(P), lanes.on_card(often).run(P)
    assert np.array_equal(whole.Y, parts.Y) and once.launches == 1 < often.launches
    for each in (once, often):
        assert_reduced(card_runs(lanes.on_card(each), P), whole.Y)
    first, second = (card_runs(lanes.on_card(each), P).moments() for each in (once, often))
    assert np.array_equal(first, second)
    if whole.events is not None and parts.events is not None:
        assert np.array_equal(whole.events, parts.events) and whole.events[:, -1].min() > 0


def falling() -> mb.Scene:
    """A particle in a force that is not defined below a height, which depends on the parameter."""
    times, outputs = np.linspace(0, 1, 11), ("x", "y")
    return particle(lambda p, mass: ((mass.y + p.depth) ** 0.5, -9.81, 0), times, {}, outputs, depth=(1.0, 9.0))


def test_failed_samples_have_times_and_reasons_and_no_extremes(tmp_path):
    lanes = mb.prepare(falling(), mb.DormandPrince())
    P = np.linspace(1.0, 9.0, 33)[:, None]
    for room in (10**9, 4000):
        card = lanes.on_card(Processor(tmp_path, room))
        other = card.run(P)
        own = [lanes.run(p[None]) for p in P]
        failed = np.array([not run.ok[0] for run in own])
        assert 0 < failed.sum() < 33 and np.array_equal(~other.ok, failed)
        assert np.allclose(other.t_failed, [run.t_failed[0] for run in own], rtol=1e-6, equal_nan=True)
        assert list(other.messages) == [text for run in own for text in run.messages]
        assert_reduced(card_runs(card, P), other.Y)


@pytest.mark.parametrize("method", [mb.PolynomialChaos(order=3), mb.Scanning(5), mb.MonteCarlo(40)])
def test_studies_have_the_bounds_of_lanes(tmp_path, method):
    scene = import_module("models.double_pendulum").scene()
    solver = mb.DormandPrince()
    own = mb.propagate(scene, method, solver=solver)
    other = mb.propagate(scene, method, solver=solver, device=Processor(tmp_path))
    width = (own.upper - own.lower).max(axis=0)
    # Lanes share their steps, so that their errors differ from those of single samples.
    assert (np.abs(own.lower - other.lower).max(axis=0) <= 1e-6 * width).all()
    assert (np.abs(own.upper - other.upper).max(axis=0) <= 1e-6 * width).all()


def test_reasons_name_the_contacts_of_failed_samples(tmp_path):
    """A drive reaches a stop that cannot rebound at the time `at`, for some samples before the end."""
    p, ball = mb.Parameters(at=1.0), mb.Body("ball", 1.0, pose=mb.Particle())
    stops = mb.Impact("stop", ball.x, 0.5), mb.Impact("floor", ball.y + 0.1, 0.5)
    system = mb.System(ball, mb.Motion("drive", ball.x, 1 - mb.t / p.at), *stops, mb.Gravity(0, -9.81), parameters=p)
    scene = mb.Scene(system, {"ball.y": 0.0}, np.linspace(0, 1, 5), {"y": ball.y})
    card = mb.prepare(scene).on_card(Processor(tmp_path))
    P = np.array([3.0, 0.5, 2.5, 0.7, 0.6, 4.0])[:, None]
    runs = card.run(P)
    _ = runs.extremes()
    assert runs.ok.tolist() == [True, False, True, False, False, True]
    assert [("Impact 'stop' cannot rebound" in text) for text in runs.messages] == [True] * 3
    assert np.allclose(runs.t_failed[[1, 3, 4]], P[[1, 3, 4], 0], rtol=1e-9)
    assert_reduced(card_runs(card, P), card.run(P).Y)


def spring(output: str) -> mb.Scene:
    """A mass that meets a stiffer spring, with few output times."""
    law = lambda p, mass: ca.if_else(mass.x < 0, -9 * p.k, -p.k) * mass.x  # noqa: E731
    scene = particle(law, np.array([0.0, 2.0]), {"mass.x": 1.0}, k=(25.0, 35.0))
    return scene if output == "x" else scene.with_outputs({"top": mb.maximum(scene.system.bodies[0].vx)})


@pytest.mark.parametrize("output", ["x", "top"])
def test_blocks_of_values_take_little_memory(tmp_path, monkeypatch, output):
    """Passes of switches take more than values, and scalar outputs need values at many times."""
    monkeypatch.setattr("symmb.run.formulations.ensembles.NUMBERS_ON_CARD", most := 2**17)
    card = Processor(tmp_path)
    found = mb.sweep(spring(output), {"k": np.linspace(25, 35, 600)}, solver=mb.DormandPrince(), device=card)
    assert found.ok.all() and card.sent <= 8 * most


def test_studies_of_prepared_scenes_with_scalar_outputs_run_on_the_card(tmp_path):
    card = Processor(tmp_path)
    prepared = mb.prepare(spring("top"), mb.DormandPrince(), device=card)
    before = card.launches
    found = mb.sweep(prepared, {"k": [25.0, 35.0]})
    assert card.launches > before
    assert np.ravel(found["top"]) == pytest.approx([5.0, 35**0.5], rel=1e-7)


def test_simulators_of_some_outputs_run_on_the_card(tmp_path):
    card = Processor(tmp_path)
    own = of_outputs(mb.prepare(falling(), mb.DormandPrince(), device=card), ["y"])
    assert tuple(own.outputs) == ("y",) and isinstance(own, mb.DAESimulator) and own.program.card is card


def test_worst_cases_repeat_no_block(tmp_path):
    scene, card = import_module("models.double_pendulum").scene(), Processor(tmp_path)
    bounds = mb.propagate(scene, mb.MonteCarlo(400), solver=mb.DormandPrince(), device=card)
    case = bounds.worst("x2").upper
    assert card.sent < 400 * bounds.lower.nbytes / 2
    found = mb.simulate(scene.with_nominal(case.parameters), mb.DormandPrince())
    i = int(np.abs(bounds.t - case.time).argmin())
    assert found["x2"][i] == pytest.approx(bounds["x2"][1][i], abs=1e-8)


def test_quantiles_and_moments_of_many_runs(tmp_path, monkeypatch):
    machine, times = machines.ball(a=0.5), np.linspace(0.0, 1.0, 5)
    a = machine.p.a
    outputs = {"y": ca.if_else(a < 0.4, 0.0, 1.0) + machine.ball.x}  # polynomials do not follow the step
    scene = machine.scene(outputs, times, {"ball.vx": a / 4}, box=mb.Box(a=(0.0, 1.0)))
    for module in ("law_samples", "statistical"):
        monkeypatch.setattr(f"symmb.bound.answers.{module}.SAMPLES_ON_CARD", 2**10)
    bounds = mb.propagate(scene, mb.Vertex(), solver=mb.DormandPrince(), device=Processor(tmp_path))
    q, laws = np.array([0.03, 0.3, 0.5, 0.77]), {"a": uniform(0, 1)}
    found = bounds.quantiles("y", q, laws)
    exact = (q[:, None] >= 0.4) + q[:, None] * times / 4
    assert found.runs >= found.samples == 2**13 and found.estimate.max() < 5e-3
    assert (np.abs(found.lower - exact) <= found.estimate).all() and np.array_equal(found.lower, found.upper)
    figures = bounds.statistical({"y": (None, 3.0)}, laws)
    a = (np.arange(10**5) + 0.5) / 10**5
    values = (a >= 0.4) + a * figures.time[0] / 4
    assert figures.mean[0] == pytest.approx(values.mean(), abs=1e-3)
    assert figures.sigma[0] == pytest.approx(values.std(), abs=1e-3)


def test_refusals(tmp_path):
    scene = import_module("models.double_pendulum").scene()
    for device in ("gpu", 0, True, Processor, np.array([1, 2])):
        refused("expected 'cuda' or None, got ", mb.prepare, scene, device=device)
    for solver in (mb.CVODES(), mb.BDFI3()):
        refused("Graphics cards run explicit solvers", mb.prepare, scene, solver, device=Processor(tmp_path))
    black_box = mb.FunctionSimulator(lambda a: [[a]], {"a": 1.0}, np.zeros(1), ["y"])
    box, own = mb.Box(a=(0.0, 1.0)), "its own solver, times, outputs and device"
    for simulator in (mb.prepare(scene), black_box):
        refused(own, mb.propagate, simulator, mb.Vertex(), box, device="cuda")
    still = formulas(lambda p: {"y": p.a * mb.t}, (0.0, 1.0), a=(0.0, 2.0))
    refused(r"has no states.*Leave out device", mb.prepare, still, device=Processor(tmp_path))
    refused("graphics card", mb.propagate, scene, mb.Vertex(), device="cuda", error=(ImportError, CardError))


class Driver:
    """Functions of the driver of NVIDIA that the card calls. A processor runs the kernels."""

    codes = "CUDA_SUCCESS CUDA_ERROR_OUT_OF_MEMORY CUDA_ERROR_NO_DEVICE CUDA_ERROR_INVALID_IMAGE CUDA_ERROR_UNKNOWN"
    CUresult = enum.Enum("CUresult", codes)
    loads = "CUDA_SUCCESS"
    names = ("CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR", "CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR")
    CUdevice_attribute = enum.Enum("CUdevice_attribute", names)

    def __init__(self, folder, devices: int, room: int) -> None:
        self.processor, self.devices, self.room, self.used = Processor(folder, room), devices, room, {}

    def _result(self, value: object = None, code: str = "CUDA_SUCCESS") -> tuple:
        return self.CUresult[code], *(() if value is None else (value,))

    def cuInit(self, flags):
        return self._result(code="CUDA_SUCCESS" if self.devices else "CUDA_ERROR_NO_DEVICE")

    def cuDeviceGet(self, number):
        return self._result(number)

    cuDevicePrimaryCtxRetain = cuDeviceGet  # a context has the number of its device

    def cuCtxSetCurrent(self, *context):
        return self._result()

    cuCtxSynchronize = cuCtxSetCurrent

    def cuDeviceGetAttribute(self, attribute, device):
        return self._result(9 if attribute.name.endswith("MAJOR") else 0)

    def cuModuleLoadData(self, image):
        is_loaded = self.loads == "CUDA_SUCCESS"
        return self._result(self.processor.kernels(image.decode()) if is_loaded else None, self.loads)

    def cuModuleGetFunction(self, module, name):
        return self._result(module[name.decode()])

    def cuMemGetInfo(self):
        return *self._result(self._free()), 2 * self.room

    def _free(self) -> int:
        return self.room - sum(memory.bytes.nbytes for memory in self.used.values())

    def cuMemAlloc(self, size):
        if size > self._free():
            return self._result(code="CUDA_ERROR_OUT_OF_MEMORY")
        memory = Bytes(size, None)
        self.used[memory.address] = memory
        return self._result(memory.address)

    def cuMemFree(self, address):
        del self.used[address]

    def cuMemcpyHtoD(self, to, of, size):
        ctypes.memmove(to, of, size)
        return self._result()

    cuMemcpyDtoH = cuMemcpyHtoD

    def cuLaunchKernel(self, kernel, *arguments):
        groups, _, _, threads, *_, (values, _), _ = arguments
        self.processor.launch(kernel, groups, threads, values)
        return self._result()


def test_the_driver_makes_the_runs(tmp_path, monkeypatch):
    lanes = prepared("double_pendulum")
    P = samples_of(lanes, 3)
    monkeypatch.setattr("symmb.run.codegen.card.compiled", lambda source, architecture: source.encode())
    driver = Driver(tmp_path, devices=1, room=10**8)
    monkeypatch.setitem(sys.modules, "cuda.bindings.driver", driver)
    assert CudaCard().architecture == "sm_90"
    card = mb.prepare(lanes.scene, mb.DormandPrince(), device="cuda")
    assert mb.prepare(lanes.scene, mb.DormandPrince(), device="cuda") is card
    runs = card.run(P)
    assert np.array_equal(runs.Y, lanes.on_card(Processor(tmp_path)).run(P).Y) and not driver.used
    assert np.array_equal(pickle.loads(pickle.dumps(card)).run(P).Y, runs.Y)
    driver.room, before = 15 * 10**6, driver.processor.launches  # 12 MB are the states of the reduction
    _ = card.run(np.resize(P, (64, P.shape[1]))).extremes()
    assert driver.processor.launches > before + 4
    driver.room = 1000
    refused("too little free memory", lambda: card.run(P).Y, error=CardError)
    told = {"INVALID_IMAGE": "driver of the graphics card is older", "UNKNOWN": "CUDA_ERROR_UNKNOWN in cuModuleLoad"}
    for code, text in told.items():
        driver.loads = f"CUDA_ERROR_{code}"
        refused(text, lanes.on_card, CudaCard(), error=CardError)
    monkeypatch.setitem(sys.modules, "cuda.bindings.driver", Driver(tmp_path, devices=0, room=0))
    refused(r"no graphics card of NVIDIA with a working driver.*CUDA_ERROR_NO_DEVICE", CudaCard, error=CardError)
    monkeypatch.setitem(sys.modules, "cuda.bindings.driver", None)
    refused(r"pip install 'symmb\[cuda\]'", CudaCard, error=ImportError)


@pytest.mark.parametrize("architecture", ["sm_80", "sm_90"])
@pytest.mark.parametrize("name", ["double_pendulum", "bouncing_ball"])
def test_the_compiler_of_cards_accepts_the_source(tmp_path, name, architecture):
    pytest.importorskip("cuda.bindings.nvrtc")

    class Compiler(Processor):
        def kernels(self, source: str) -> int:
            return len(compiled(source, architecture))

    assert vars(prepared(name).program.on_card(Compiler(tmp_path)).engine())["_kernels"] > 10_000
