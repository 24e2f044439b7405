"""Ensembles in compiled lanes: explicit steps for W samples side by side, blocks of them on threads."""

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.codegen.build import load
from symmb.codegen.emit import Emitter
from symmb.codegen.graph import graph_of
from symmb.schemes import dop853, runge_kutta

MOST_STEPS = 1_000_000
Weights = Mapping[int, float]


@dataclass(frozen=True)
class Tolerances:
    """Steps as long as their estimated errors allow, relative and absolute: the pair of Dormand and Prince."""

    rtol: float
    atol: float


@dataclass(frozen=True)
class FixedStep:
    """Equal steps no longer than this between output times [s]: the classical Runge-Kutta method."""

    longest: float


class _Study(ctypes.Structure):
    """Study of loop.h."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("x0", "p", "times")),
        ("n", ctypes.c_long),
        ("n_t", ctypes.c_long),
        ("rtol", ctypes.c_double),
        ("atol", ctypes.c_double),
        ("longest", ctypes.c_double),
        ("most_steps", ctypes.c_long),
        ("dealt", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("t_failed", "irregular", "Y")),
    ]


@dataclass(frozen=True)
class Losses:
    """Samples that failed: t_failed (N,) [s], nan where not, and whether it was an output that is not finite (N,)."""

    t_failed: Array
    irregular: Mask


class Engine:
    """An initial value problem compiled for many samples.

    Parameters
    ----------
    rates, outputs, projected : SX      x' (n_x,), what is wanted (n_y,), and x on the constraints or None
    x, p, t : SX symbols                state, parameters, time
    times : (n_t,) array                [s]
    control : Tolerances or FixedStep
    start : Newton's step of unknowns u, which stand in the first of x, and x (n_x,) at the start in terms of them;
        without it runs are given their starts
    """

    def __init__(
        self,
        x: ca.SX,
        p: ca.SX,
        t: ca.SX,
        rates: ca.SX,
        outputs: ca.SX,
        projected: ca.SX | None,
        times: Array,
        control: Tolerances | FixedStep,
        start: tuple[ca.SX, ca.SX] | None = None,
    ) -> None:
        f = model_function(x, p, t, rates, outputs, projected, start)
        self.starts = start is not None
        self.n_x, self.n_p, self.n_y = x.numel(), p.numel(), outputs.numel()
        self.times, self.control = times, control
        self._times = np.ascontiguousarray(times, dtype=float)
        self.source = _source(f, isinstance(control, FixedStep))
        self._open()

    def _open(self) -> None:
        self._library = load(self.source)
        self.width = ctypes.c_int.in_dll(self._library, "width").value

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k != "_library"}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._open()

    def values(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, Losses]:
        """Outputs of N samples, x0 (N, n_x), p (N, n_p); x0 is (N, 0) if the engine starts by itself.

        Returns
        -------
        (N, n_t, n_y) array        nan from the time on at which a sample stopped
        Losses
        """
        Y = np.full((len(p), len(self.times), self.n_y), np.nan)
        return Y, self._run(x0, p, Y, [None] * threads)

    def extremes(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, Array, Losses]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail, and those that did."""
        found = np.full((threads, 2, len(self.times), self.n_y), np.inf)
        found[:, 1] = -np.inf
        losses = self._run(x0, p, None, list(found))
        lower, upper = found[:, 0].min(axis=0), found[:, 1].max(axis=0)
        return lower + 0.0, upper + 0.0, losses  # -0 and 0 are equal: which is met first depends on the threads

    def _run(self, x0: Array, p: Array, Y: Array | None, found: list[Array | None]) -> Losses:
        """Blocks of W samples, fixed by sample index, dealt to threads; values go to Y, or each thread's extremes."""
        N = len(p)
        x0, p = np.ascontiguousarray(x0, dtype=float), np.ascontiguousarray(p, dtype=float)
        losses = Losses(np.full(N, np.nan), np.zeros(N, dtype=bool))
        control = self.control
        steps = (0.0, 0.0, control.longest) if isinstance(control, FixedStep) else (control.rtol, control.atol, 0.0)
        study = _Study(
            x0.ctypes.data,
            p.ctypes.data,
            self._times.ctypes.data,
            N,
            len(self._times),
            *steps,
            MOST_STEPS,
            0,
            losses.t_failed.ctypes.data,
            losses.irregular.ctypes.data,
            None if Y is None else Y.ctypes.data,
        )

        def work(part: Array | None) -> bool:
            lower, upper = (None, None) if part is None else (a.ctypes.data for a in part)
            return bool(self._library.work(ctypes.byref(study), ctypes.c_void_p(lower), ctypes.c_void_p(upper)))

        own, *others = found[: max(1, -(-N // self.width))]
        if others:
            with ThreadPoolExecutor(len(others)) as pool:
                running = [pool.submit(work, part) for part in others]
                enough = [work(own), *(run.result() for run in running)]
        else:
            enough = [work(own)]
        if not all(enough):
            raise MemoryError("not enough memory for the compiled engine")
        return losses


def model_function(
    x: ca.SX,
    p: ca.SX,
    t: ca.SX,
    rates: ca.SX,
    outputs: ca.SX,
    projected: ca.SX | None,
    start: tuple[ca.SX, ca.SX] | None = None,
) -> ca.Function:
    """(x, p, t) -> rates, outputs and, as far as given, project, newton and start."""
    parts = {"rates": rates, "outputs": outputs}
    if projected is not None:
        parts["project"] = projected
    if start is not None:
        parts["newton"], parts["start"] = start
    return ca.Function("f", [x, p, t], [ca.densify(e) for e in parts.values()], ["x", "p", "t"], list(parts))


def _source(f: ca.Function, fixed: bool) -> str:
    graph = graph_of(f)
    emitter = Emitter(graph)
    nodes = dict(zip(f.name_out(), graph.outputs, strict=True))
    for name, values in nodes.items():
        emitter.function(name, values)
    model, n_c = emitter.source()
    used = emitter.used(nodes["outputs"])
    sizes = {
        "N_X": f.numel_in(0),
        "N_P": f.numel_in(1),
        "N_C": n_c,
        "N_Y": len(nodes["outputs"]),
        "N_USED": len(used),
        "PROJECTED": int("project" in nodes),
        "STARTED": int("start" in nodes),
        "N_U": len(nodes.get("newton", ())),
        "STAGES": len(runge_kutta.A if fixed else dop853.A),
    }
    return "\n".join(
        [
            _header("lanes"),
            *(f"#define {name} {value}" for name, value in sizes.items()),
            f"static const int used[] = {{{', '.join(map(str, used or [0]))}}};",
            model,
            _header("study"),
            _classical() if fixed else _pair(),
            _header("fixed" if fixed else "pair"),
        ]
    )


def _header(name: str) -> str:
    return (Path(__file__).parent / f"{name}.h").read_text(encoding="utf-8")


def _classical() -> str:
    return "\n".join(_stages(range(1, len(runge_kutta.A)), runge_kutta.A, runge_kutta.C, runge_kutta.B))


def _pair() -> str:
    A, B, C, D, E = dop853.A, dop853.B, dop853.C, dop853.D, dop853.E
    return "\n".join(
        [
            *_stages(range(1, 12), A, C, B),
            "static void errors(const V *k, V *e5, V *e3) {",
            f"  for (int i = 0; i < N_X; ++i) {{ e3[i] = {_sum(E[0])}; e5[i] = {_sum(E[1])}; }}",
            "}",
            "static void interpolant(Block *b) {",
            "  V *k = b->k;",
            *(line for s in range(13, 16) for line in _stage(s, A, C)),
            "  for (int u = 0; u < N_USED; ++u) {",
            "    const int i = used[u];",
            "    V *f = b->F + 7 * u, d = b->x_new[i] - b->x[i];",
            "    f[0] = d;",
            "    f[1] = b->h * k[i] - d;",
            "    f[2] = 2 * d - b->h * (k[12 * N_X + i] + k[i]);",
            *(f"    f[{3 + j}] = b->h * ({_sum(row)});" for j, row in enumerate(D)),
            "  }",
            "}",
        ]
    )


def _stages(stages: Iterable[int], A: Sequence[Weights], C: Sequence[float], B: Weights) -> list[str]:
    return [
        "static void stages(Block *b) {",
        "  V *k = b->k;",
        *(line for s in stages for line in _stage(s, A, C)),
        f"  for (int i = 0; i < N_X; ++i) b->x_new[i] = b->x[i] + b->h * ({_sum(B)});",
        "}",
    ]


def _stage(s: int, A: Sequence[Weights], C: Sequence[float]) -> list[str]:
    return [
        f"  for (int i = 0; i < N_X; ++i) b->x_at[i] = b->x[i] + b->h * ({_sum(A[s])});",
        f"  rates(b->x_at, b->c, each(b->t + {C[s]!r} * b->h), k + {s} * N_X);",
    ]


def _sum(weights: Weights) -> str:
    return " + ".join(f"{value!r} * k[{j} * N_X + i]" for j, value in weights.items())
