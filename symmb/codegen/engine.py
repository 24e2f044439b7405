"""Ensembles in compiled lanes: an embedded explicit pair runs W samples side by side, blocks of them on threads."""

import ctypes
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from symmb._types import Array, Indices, Mask
from symmb.codegen.build import load
from symmb.codegen.emit import Emitter
from symmb.codegen.graph import graph_of
from symmb.schemes import dop853

_HEADERS = Path(__file__).parent
MOST_STEPS = 1_000_000


class _Options(ctypes.Structure):
    _fields_ = [("rtol", ctypes.c_double), ("atol", ctypes.c_double), ("most_steps", ctypes.c_long)]


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
    rtol, atol : float                  of each step
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
        rtol: float,
        atol: float,
    ) -> None:
        f = model_function(x, p, t, rates, outputs, projected)
        self.n_x, self.n_p, self.n_y = x.numel(), p.numel(), outputs.numel()
        self.times, self.rtol, self.atol = times, rtol, atol
        self.source = _source(f, self.n_x, self.n_p, self.n_y, projected is not None)
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
        """Outputs of N samples, x0 (N, n_x), p (N, n_p).

        Returns
        -------
        (N, n_t, n_y) array        nan where a sample stopped
        Losses
        """
        Y = np.full((len(x0), len(self.times), self.n_y), np.nan)

        def keep(buffer: _Buffer, samples: Indices, lanes: int) -> None:
            Y[samples] = buffer.Y.reshape(len(self.times), self.n_y, -1).transpose(2, 0, 1)[:lanes]

        _, losses = self._run(x0, p, threads, keep)
        return Y, losses

    def extremes(self, x0: Array, p: Array, threads: int = 1) -> tuple[Array, Array, Losses]:
        """Smallest and largest outputs (n_t, n_y) of the samples that did not fail, and those that did."""
        buffers, losses = self._run(x0, p, threads, None)
        shape = len(self.times), self.n_y
        lower = np.min([b.lower for b in buffers], axis=0).reshape(shape)
        upper = np.max([b.upper for b in buffers], axis=0).reshape(shape)
        return lower, upper, losses

    def _run(
        self, x0: Array, p: Array, threads: int, keep: Callable[["_Buffer", Indices, int], None] | None
    ) -> tuple[list["_Buffer"], Losses]:
        """Blocks of W samples, fixed by sample index, dealt to threads; `keep` takes each, else extremes are kept."""
        N, W = len(x0), self.width
        losses = Losses(np.full(N, np.nan), np.zeros(N, dtype=bool))
        losses.t_failed[~np.isfinite(x0).all(axis=1)] = self.times[0]
        blocks = [np.arange(start, min(start + W, N)) for start in range(0, N, W)]
        buffers = [_Buffer(self, keep is None) for _ in range(min(threads, max(len(blocks), 1)))]

        def work(k: int) -> None:
            for samples in blocks[k :: len(buffers)]:
                self._block(buffers[k], x0, p, samples, losses, keep)

        if len(buffers) == 1:
            work(0)
        else:
            with ThreadPoolExecutor(len(buffers)) as pool:
                list(pool.map(work, range(len(buffers))))
        return buffers, losses

    def _block(
        self,
        buffer: "_Buffer",
        x0: Array,
        p: Array,
        samples: Indices,
        losses: Losses,
        keep: Callable[["_Buffer", Indices, int], None] | None,
    ) -> None:
        """One block; a sample that is lost is taken out, and the others run as if it had not been there."""
        while True:
            live = samples[np.isnan(losses.t_failed[samples])]
            if not live.size:
                return
            # Lanes without a sample repeat one that has: they do not change the common step.
            lanes = np.resize(live, self.width)
            buffer.x0[...], buffer.p[...] = x0[lanes].T, p[lanes].T
            code = self._library.run_block(*buffer.arguments)
            if code == 0:
                break
            losses.t_failed[lanes[buffer.lost.astype(bool)] if code == 1 else live] = buffer.at.value
        if keep is not None:
            keep(buffer, live, live.size)
        self._library.irregular(*buffer.marks)
        if buffer.lost.any():
            self._leave_out(buffer, lanes, losses)
        if keep is None and not buffer.lost.all():
            self._library.extend(*buffer.extremes)

    def _leave_out(self, buffer: "_Buffer", lanes: Indices, losses: Losses) -> None:
        """Lanes with an output that is not finite fail at its time, and repeat one that has none."""
        Y = buffer.Y.reshape(len(self.times), self.n_y, -1)
        bad = buffer.lost.astype(bool)
        for lane in np.flatnonzero(bad):
            losses.irregular[lanes[lane]] = True
            losses.t_failed[lanes[lane]] = self.times[np.argmin(np.isfinite(Y[:, :, lane]).all(axis=1))]
        if not bad.all():
            Y[:, :, bad] = Y[:, :, [int(np.flatnonzero(~bad)[0])]]


class _Buffer:
    """What one thread works on: memory aligned for vectors, and the arguments of the compiled functions."""

    def __init__(self, engine: Engine, extremes: bool) -> None:
        W, n = engine.width, len(engine.times) * engine.n_y
        self.x0, self.p, self.Y = _aligned(engine.n_x, W), _aligned(engine.n_p, W), _aligned(n, W)
        self.lost, self.counts, self.at = np.zeros(W, dtype=np.int64), np.zeros(2, dtype=np.int64), ctypes.c_double()
        self._options = _Options(engine.rtol, engine.atol, MOST_STEPS)
        self._times = np.ascontiguousarray(engine.times)
        self.arguments = (
            _pointer(self.x0), _pointer(self.p), _pointer(self._times), ctypes.c_long(len(engine.times)),
            ctypes.byref(self._options), _pointer(self.Y), _pointer(self.lost), ctypes.byref(self.at),
            _pointer(self.counts),
        )  # fmt: skip
        self.marks = (_pointer(self.Y), ctypes.c_long(n), _pointer(self.lost))
        if extremes:
            self.lower, self.upper = _aligned(n, 1)[:, 0], _aligned(n, 1)[:, 0]
            self.lower[...], self.upper[...] = np.inf, -np.inf
            self.extremes = (_pointer(self.Y), ctypes.c_long(n), _pointer(self.lower), _pointer(self.upper))


def model_function(x: ca.SX, p: ca.SX, t: ca.SX, rates: ca.SX, outputs: ca.SX, projected: ca.SX | None) -> ca.Function:
    """(x, p, t) -> rates, outputs and, where there are constraints, x on them."""
    wanted = (rates, outputs) if projected is None else (rates, outputs, projected)
    return ca.Function("f", [x, p, t], [ca.densify(e) for e in wanted])


def _pointer(a: npt.NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(a.ctypes.data)


def _aligned(rows: int, width: int) -> Array:
    """Memory (rows, width) that starts at a multiple of 64 bytes, as vectors must."""
    raw = np.zeros(rows * width + 8)
    offset = (-raw.ctypes.data % 64) // 8
    return raw[offset : offset + rows * width].reshape(rows, width)


def _source(f: ca.Function, n_x: int, n_p: int, n_y: int, projected: bool) -> str:
    graph = graph_of(f)
    emitter = Emitter(graph)
    for name, nodes in zip(("rates", "outputs", "project"), graph.outputs, strict=False):
        emitter.function(name, nodes)
    model, n_c = emitter.source()
    sizes = {"N_X": n_x, "N_P": n_p, "N_C": n_c, "N_Y": n_y, "PROJECTED": int(projected)}
    return "\n".join(
        [
            (_HEADERS / "lanes.h").read_text(encoding="utf-8"),
            *(f"#define {name} {value}" for name, value in sizes.items()),
            model,
            _pair(),
            (_HEADERS / "loop.h").read_text(encoding="utf-8"),
        ]
    )


def _pair() -> str:
    """The functions of the step from the tableau: stages, errors, dense."""
    lines = ["static void stages(const V *x, const V *c, double t, double h, V *k, V *x_new) {", "  V at[N_X];"]
    for s in range(1, 12):
        lines += _stage(s, "at")
    lines += [f"  for (int i = 0; i < N_X; ++i) x_new[i] = x[i] + h * ({_sum(dop853.B[0])});"]
    lines += ["  rates(x_new, c, zero() + (t + h), k + 12 * N_X);", "}"]
    lines += ["static void errors(const V *k, V *e5, V *e3) {"]
    lines += [f"  for (int i = 0; i < N_X; ++i) {{ e3[i] = {_sum(dop853.E[0])}; e5[i] = {_sum(dop853.E[1])}; }}", "}"]
    lines += [
        "static void dense(const V *x, const V *x_new, const V *c, double t, double h, V *k, V *F) {",
        "  V at[N_X];",
    ]
    for s in range(13, 16):
        lines += _stage(s, "at")
    lines += [
        "  for (int i = 0; i < N_X; ++i) {",
        "    V *f = F + 7 * i, d = x_new[i] - x[i];",
        "    f[0] = d;",
        "    f[1] = h * k[i] - d;",
        "    f[2] = 2 * d - h * (k[12 * N_X + i] + k[i]);",
        *(f"    f[{3 + j}] = h * ({_sum(row)});" for j, row in enumerate(dop853.D)),
        "  }",
        "}",
    ]
    return "\n".join(lines)


def _stage(s: int, name: str) -> list[str]:
    return [
        f"  for (int i = 0; i < N_X; ++i) {name}[i] = x[i] + h * ({_sum(dop853.A[s])});",
        f"  rates({name}, c, zero() + (t + {dop853.C[s]!r} * h), k + {s} * N_X);",
    ]


def _sum(weights: Mapping[int, float]) -> str:
    return " + ".join(f"{value!r} * k[{j} * N_X + i]" for j, value in weights.items())
