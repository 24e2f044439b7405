"""One step of a scheme as a compiled function of its history, and the march of many samples by it."""

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.declare.symbolic import batch


def interval_steps(times: Array, length: float) -> Indices:
    """Numbers (n_t - 1,) of equal steps, no longer than a length [s], from each output time to the next."""
    return np.maximum(np.ceil(np.diff(times) / length - 1e-9).astype(np.intp), 1)


@dataclass(frozen=True)
class Advance:
    """One step of a scheme on its history w, which begins with the state x (n_x,) and the quadrature (n_quad,).

    begin (x, p, t, h) -> w     history at the start, before a first step of length h
    step (w, p, t, h) -> w      by a step of length h that ends at t
    """

    begin: ca.Function
    step: ca.Function
    n_x: int
    n_quad: int


@dataclass(frozen=True)
class Marching:
    """Samples side by side, one step after the other: counts (n_t - 1,) equal steps in each interval of times."""

    advance: Advance
    times: Array
    counts: Indices

    def march(self, x0: Array, p: Array, project: ca.Function | None) -> Iterator[tuple[int, Array]]:
        """From x0 (N, n_x) with parameters p (N, n_p): yields (i, x (N, n_x)) for every time."""
        n_x, t = self.advance.n_x, float(self.times[0])

        def projected(w: Array, time: float) -> Array:
            if project is None:
                return w
            return np.hstack([batch(project, w[:, :n_x], p, np.array([time]))[0], w[:, n_x:]])

        lengths = np.diff(self.times) / self.counts
        (w,) = batch(self.advance.begin, x0, p, np.array([t]), lengths[:1])
        w = projected(w, t)
        yield 0, w[:, :n_x]
        for i, (h, count) in enumerate(zip(lengths, self.counts, strict=True), start=1):
            for _ in range(count):
                t += float(h)
                (w,) = batch(self.advance.step, w, p, np.array([t]), np.array([h]))
            w = projected(w, t)
            yield i, w[:, :n_x]
