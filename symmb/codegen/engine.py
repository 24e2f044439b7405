"""Ensembles in compiled lanes: steps for W samples side by side, blocks of them on threads."""

import ctypes
import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symmb._types import Array
from symmb.codegen import cache, tableau
from symmb.codegen.build import load
from symmb.codegen.c_source import c_source
from symmb.codegen.emit import Emitter
from symmb.codegen.graph import INPUT, Graph, graph_of
from symmb.codegen.threads import side_by_side

MOST_STEPS = 1_000_000
REASONS = (
    "the step became too short, or the state infinite or NaN",
    "an output is not finite",
    "Newton's method does not converge, however short the step",
    f"{MOST_STEPS} steps are not enough",
)
_LARGE = 5000
"""Values of a model whose compiler would take too long over sines and cosines in place."""
_SMALL = 32
"""States whose slopes fit into the cache nearest to the core."""


@dataclass(frozen=True)
class Tolerances:
    """Steps as long as their estimated errors allow, relative and absolute, and no longer than this [s], unless 0."""

    rtol: float
    atol: float
    longest: float = 0.0


@dataclass(frozen=True)
class FixedStep:
    """Equal steps no longer than this between output times [s]."""

    longest: float


class _Study(ctypes.Structure):
    """Study of c/block.h."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("x0", "p", "times")),
        ("n", ctypes.c_long),
        ("n_t", ctypes.c_long),
        ("rtol", ctypes.c_double),
        ("atol", ctypes.c_double),
        ("longest", ctypes.c_double),
        ("newton", ctypes.c_double),
        ("most_steps", ctypes.c_long),
        ("next_block", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("t_failed", "failure", "x_failed", "Y")),
        *((name, ctypes.c_long) for name in ("steps", "iterations", "most")),
    ]


@dataclass(frozen=True)
class FailedSamples:
    """Samples that failed: t_failed (N,) [s], nan where not, and of what (N,), an index of `REASONS`.

    The state where the last step of a failed sample began stands in the first columns of x_failed (N, ...).
    """

    t_failed: Array
    failure: NDArray[np.int8]
    x_failed: Array

    @property
    def reasons(self) -> list[str]:
        """Of what each sample failed, if it did."""
        return [REASONS[k] for k in self.failure]


@dataclass(frozen=True)
class Counts:
    """Of the last call: steps of all blocks, iterations of Newton's method, and the most in one step."""

    steps: int
    iterations: int
    most: int


@dataclass(frozen=True)
class Scheme:
    """What the engine has to know of a scheme whose steps are functions, see `scheme_function`.

    Attributes
    ----------
    n_w, n_z : int         numbers in the history and of unknowns
    order : int
    growth : float         how many times as long as the one before a step may be
    newton : float         largest change of unknowns, over their sizes, at which Newton's method ends
    """

    n_w: int
    n_z: int
    order: int
    growth: float
    newton: float


class Engine:
    """An initial value problem compiled for many samples.

    Parameters
    ----------
    f : ca.Function                     from `model_function` or `scheme_function`; with a start it starts by itself
    times : (n_t,) array                [s]
    control : Tolerances or FixedStep
    scheme : Scheme, optional           without one, steps are those of the pair of Dormand and Prince with tolerances,
                                        and of the classical Runge-Kutta method with a fixed step
    """

    def __init__(
        self, f: ca.Function, times: Array, control: Tolerances | FixedStep, scheme: Scheme | None = None
    ) -> None:
        self.starts = "start" in f.name_out()
        self.n_x, self.n_y = f.numel_in("x"), f.numel_out("outputs")
        self.times, self.control = times, control
        self.newton = scheme.newton if scheme else 0.0
        self.counts = Counts(0, 0, 0)
        self._times = np.ascontiguousarray(times, dtype=float)
        fixed = isinstance(control, FixedStep)
        self.source = _kept(f, (fixed, scheme), lambda: _scheme_source(f, scheme) if scheme else _source(f, fixed))
        self._open()

    def _open(self) -> None:
        self._library = load(self.source)
        self.width = ctypes.c_int.in_dll(self._library, "width").value

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k != "_library"}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._open()

    def values(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, FailedSamples]:
        """Outputs of N samples, x0 (N, n_x), p (N, n_p); x0 is (N, 0) if the engine starts by itself, and may be short.

        Returns
        -------
        (N, n_t, n_y) array        nan from the time on at which a sample stopped
        FailedSamples
        """
        Y = np.full((len(p), len(self.times), self.n_y), np.nan)
        return Y, self._run(x0, p, Y, [None] * threads)

    def extremes(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, Array, FailedSamples]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail, and those that did."""
        extremes = np.full((threads, 2, len(self.times), self.n_y), np.inf)
        extremes[:, 1] = -np.inf
        failed_samples = self._run(x0, p, None, list(extremes))
        lower, upper = extremes[:, 0].min(axis=0), extremes[:, 1].max(axis=0)
        return lower + 0.0, upper + 0.0, failed_samples  # -0 and 0 are equal: which is met first depends on the threads

    def _run(self, x0: Array, p: Array, Y: Array | None, extremes: list[Array | None]) -> FailedSamples:
        """Blocks of W samples, fixed by sample index, dealt to threads; values go to Y, or each thread's extremes."""
        N = len(p)
        if not self.starts and x0.shape[1] < self.n_x:  # a history, which follows from the state
            x0 = np.hstack([x0, np.zeros((N, self.n_x - x0.shape[1]))])
        x0, p = np.ascontiguousarray(x0, dtype=float), np.ascontiguousarray(p, dtype=float)
        failed_samples = FailedSamples(np.full(N, np.nan), np.zeros(N, dtype=np.int8), np.empty((N, self.n_x)))
        control = self.control
        tolerances = (0.0, 0.0) if isinstance(control, FixedStep) else (control.rtol, control.atol)
        study = _Study(
            x0.ctypes.data,
            p.ctypes.data,
            self._times.ctypes.data,
            N,
            len(self._times),
            *tolerances,
            control.longest,
            self.newton,
            MOST_STEPS,
            0,
            failed_samples.t_failed.ctypes.data,
            failed_samples.failure.ctypes.data,
            failed_samples.x_failed.ctypes.data,
            None if Y is None else Y.ctypes.data,
            0,
            0,
            0,
        )

        def work(part: Array | None) -> bool:
            lower, upper = (None, None) if part is None else (a.ctypes.data for a in part)
            return bool(self._library.work(ctypes.byref(study), ctypes.c_void_p(lower), ctypes.c_void_p(upper)))

        if not all(side_by_side(work, extremes[: max(1, -(-N // self.width))])):
            raise MemoryError("not enough memory for the compiled engine")
        self.counts = Counts(study.steps, study.iterations, study.most)
        return failed_samples


def model_function(
    x: ca.SX,
    p: ca.SX,
    t: ca.SX,
    rates: ca.SX,
    outputs: ca.SX,
    projected: ca.SX | None,
    start: tuple[ca.SX, ca.SX] | None = None,
) -> ca.Function:
    """(x, p, t) -> rates, outputs and, as far as given, project, newton and start.

    Parameters
    ----------
    x, p, t : SX symbols                state (n_x,), parameters (n_p,), time [s]
    rates, outputs, projected : SX      x' (n_x,), what is wanted (n_y,), and x on the constraints or None
    start : Newton's step of unknowns u, which stand in the first of x, and x (n_x,) at the start in terms of them;
        without it runs are given their starts
    """
    parts = {"rates": rates, "outputs": outputs}
    if projected is not None:
        parts["project"] = projected
    if start is not None:
        parts["newton"], parts["start"] = start
    return ca.Function("f", [x, p, t], [ca.densify(e) for e in parts.values()], ["x", "p", "t"], list(parts))


def scheme_function(
    w: ca.SX,
    z: ca.SX,
    p: ca.SX,
    t: ca.SX,
    h: ca.SX,
    *,
    history: ca.SX,
    guess: ca.SX,
    correct: ca.SX,
    follow: ca.SX,
    outputs: ca.SX,
    projected: ca.SX | None,
    start: tuple[ca.SX, ca.SX] | None = None,
) -> ca.Function:
    """((w, h, z), p, t) -> the functions of c/implicit_step.h.

    `projected`, if not None, and `start` are functions of the state, with which w begins.
    """
    x = ca.vertcat(w, h, z)

    def whole(state: ca.SX) -> ca.SX:
        return ca.vertcat(state, x[state.numel() :])

    parts = {"history": history, "guess": guess, "correct": correct, "follow": follow, "outputs": outputs}
    if projected is not None:
        parts["project"] = whole(projected)
    if start is not None:
        parts["newton"], parts["start"] = start[0], whole(start[1])
    return ca.Function("f", [x, p, t], [ca.densify(e) for e in parts.values()], ["x", "p", "t"], list(parts))


def _kept(f: ca.Function, options: object, write: Callable[[], str]) -> str:
    """The source of a model, from the cache if it is large and was written before, by this very generator."""
    if f.n_instructions() < _LARGE:
        return write()
    key = hashlib.sha256("\0".join([f.serialize(), repr(options), _generator()]).encode()).hexdigest()[:32]
    path = cache.find(key, ".c")
    if path is not None:
        return path.read_text(encoding="utf-8")
    source = write()
    cache.keep(key, source.encode(), ".c")
    return source


@functools.cache
def _generator() -> str:
    """A hash of every file of the package: a source is printed from many of them."""
    files = sorted(path for path in Path(__file__).parents[1].rglob("*") if path.suffix in (".py", ".h"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def _source(f: ca.Function, fixed: bool) -> str:
    graph = graph_of(f)
    nodes = dict(zip(f.name_out(), graph.outputs, strict=True))
    order, n_own = _order(graph, nodes["rates"])
    place = [order.index(i) for i in range(len(order))]
    nodes["rates"] = [nodes["rates"][i] for i in order[:n_own]]
    for name in nodes.keys() & {"project", "start"}:
        nodes[name] = [nodes[name][i] for i in order]
    stages = tableau.CLASSICAL_STAGES if fixed else tableau.PAIR_STAGES
    sizes = {"N_OWN": n_own, "N_K": stages * n_own}
    steps = [tableau.classical(), c_source("fixed_step")] if fixed else [tableau.pair(), c_source("embedded_pair")]
    return _study(graph, nodes, place, f.numel_in(1), sizes, steps)


def _scheme_source(f: ca.Function, scheme: Scheme) -> str:
    graph = graph_of(f)
    nodes = dict(zip(f.name_out(), graph.outputs, strict=True))
    n_w, n_z = scheme.n_w, scheme.n_z
    sizes = {
        "N_OWN": 0,
        "N_W": n_w,
        "N_Z": n_z,
        "N_TESTED": len(nodes["correct"]) - n_z,
        "N_E": len(nodes["follow"]) - n_w,
        "N_K": max(len(nodes["follow"]), len(nodes["correct"])),
        "ORDER": scheme.order,
        "GROWTH": scheme.growth,
    }
    return _study(graph, nodes, list(range(f.numel_in(0))), f.numel_in(1), sizes, [c_source("implicit_step")])


def _study(
    graph: Graph,
    nodes: Mapping[str, list[int]],
    place: list[int],
    n_p: int,
    sizes: Mapping[str, float],
    steps: Sequence[str],
) -> str:
    """The C of a study: a model, whose functions consist of nodes, and how it takes its steps."""
    emitter = Emitter(graph, place)
    for name, values in nodes.items():
        emitter.function(name, values)
    model, n_c = emitter.source()
    explicit = "rates" in nodes
    used = emitter.used(nodes["outputs"]) if explicit else []
    sizes = {
        "N_X": len(place),
        "N_P": n_p,
        "N_C": n_c,
        "N_CARRIED": emitter.n_carried,
        "N_Y": len(nodes["outputs"]),
        "N_USED": len(used),
        "PROJECTED": int("project" in nodes),
        "STARTED": int("start" in nodes),
        "N_U": len(nodes.get("newton", ())),
        "LARGE": int(len(graph.nodes) > _LARGE),
        **sizes,
    }
    lists = {"place": place, "used": used}
    return "\n".join(
        [
            *(f"#define {name} {value}" for name, value in sizes.items()),
            c_source("lanes"),
            *(f"PRIVATE const int {name}[] = {{{', '.join(map(str, v or [0]))}}};" for name, v in lists.items()),
            model,
            c_source("block", "projection"),
            *steps,
            c_source("ensemble"),
        ]
    )


def _order(graph: Graph, rates: list[int]) -> tuple[list[int], int]:
    """States in the order of `tableau`, and how many have slopes of their own: all of a small model.

    Where slopes fit into the cache nearest to the core, to load fewer of them does not pay for the longer sums.
    """
    if len(rates) <= _SMALL:
        return list(range(len(rates))), len(rates)
    integral: dict[int, int] = {}
    for i, k in enumerate(rates):
        node = graph.nodes[k]
        if node.operation == INPUT and node.source == 0 and node.index not in integral and i not in integral:
            integral[node.index] = i
    integral = {v: x for v, x in integral.items() if v not in integral.values()}
    own = [*integral, *(i for i in range(len(rates)) if i not in integral and i not in integral.values())]
    return [*own, *integral.values()], len(own)
