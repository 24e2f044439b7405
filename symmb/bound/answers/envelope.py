"""Lower and upper bounds over time, and warnings about them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from symmb._errors import WithWarnings
from symmb._magnitudes import SAME
from symmb._options import require_name, require_positive
from symmb._types import Array, Figure
from symmb.bound.answers.result_file import INNER, Kind, box_of, kind_of, nominal_of
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import (
    DOUBTFUL,
    AttainingRuns,
    Failure,
    Runs,
    Trace,
    WorstCase,
    is_doubtful,
    is_doubtful_in_window,
)
from symmb.equations.model import Box
from symmb.results import plot
from symmb.results.files import NAMES, NOT_KEPT, TIMES, Record, entry


@dataclass(frozen=True, eq=False, repr=False)
class Envelope(WithWarnings):
    """The attributes of `Bounds`, and the warnings about them."""

    t: Array = field(metadata=TIMES)
    names: tuple[str, ...] = field(metadata=NAMES)
    lower: Array = field(metadata=entry(Record.lower, "t", "names"))
    upper: Array = field(metadata=entry(Record.upper, "t", "names"))
    kind: Kind = field(metadata=entry(kind_of))
    method: str
    evaluations: int
    estimate: Array | None = field(default=None, metadata=entry(Record.size, "t", "names"))
    noise: Array | None = field(default=None, metadata=entry(Record.size, "names"))
    inner: tuple[Array, Array] | None = field(default=None, metadata=INNER)
    failed: tuple[Failure, ...] = field(default=(), metadata=NOT_KEPT)
    failed_region: str = ""
    seconds: float = field(default=float("nan"))
    expansion: Expansion | None = field(default=None, metadata=NOT_KEPT)
    caution: str = ""
    run_doubts: tuple[str, ...] = field(default=(), metadata=NOT_KEPT)
    remarks: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    box: Box | None = field(default=None, metadata=entry(box_of))
    surrogate: Piecewise | None = field(default=None, metadata=NOT_KEPT)
    study: Runs | None = field(default=None, metadata=NOT_KEPT)
    range_of: str = ""
    subject: str = ""
    solver: str = ""
    nominal: Array | None = field(default=None, metadata=entry(nominal_of, "t", "names"))
    nominal_parameters: Mapping[str, float] = field(default_factory=dict)
    attaining: AttainingRuns | None = field(default=None, metadata=NOT_KEPT)
    worst_cases: tuple[WorstCase, ...] = field(default=(), metadata=NOT_KEPT)
    figures: tuple[str, ...] = ()
    trace: Trace | None = field(default=None, metadata=NOT_KEPT)
    next_run: Mapping[str, float] | None = None
    parts: tuple[Any, ...] = field(default=(), metadata=NOT_KEPT)
    lost: Mapping[str, str] = field(default_factory=dict, metadata=NOT_KEPT)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about the bounds, in sentences; empty if no problem is known."""
        doubts = list(self.run_doubts)
        if self.failed:
            where = f" Runs fail {self.failed_region}." if self.failed_region else ""
            doubts.append(
                f"{len(self.failed)} of {self.evaluations} runs failed. The bounds use only the other runs. The "
                f"responses near the failed runs are not known.{where}"
            )
        if since := self.doubtful():
            windows = self.doubtful_windows()
            parts = [name + self._doubtful_part(name, t, windows) for name, t in since.items()]
            doubts.append(f"The estimated error is above 10 % of the width: {', '.join(parts)}.")
        if self.caution:
            doubts.append(f"The bounds are {self.caution}.")
        return tuple(doubts)

    @property
    def _left_out(self) -> tuple[str, ...]:
        """Parameters with a nominal value outside of their interval. The nominal run is then outside of the box."""
        pairs = () if self.box is None else zip(self.box.names, self.box.bounds, strict=True)
        ends = [(n, self.nominal_parameters.get(n, low), low, high) for n, (low, high) in pairs]
        left = tuple(n for n, x, low, high in ends if max(low - x, x - high) > 1e-12 * max(-low, high, abs(x)))
        if self.box is None or left or not {*self.box.names} <= self.nominal_parameters.keys():
            return left
        values, box = {n: x for n, x, _, _ in ends}, self.box
        are_chosen = all(choice.has([values[n] for n in choice.parameters]) for choice in box.choices)
        return () if are_chosen and box.allowed(np.array([[*values.values()]]))[0] else box.names

    def _with_nominal(self) -> Self:
        """The bounds with the nominal run and its noise. A missing nominal run is made."""
        if self.nominal is not None or self.study is None:
            return self
        nominal, noise = self.study.nominal
        return replace(self, nominal=nominal, noise=noise if self.noise is None else self.noise)

    @property
    def outer(self) -> tuple[Array, Array]:
        """(lower, upper), each (n_t, n_y), widened by the estimated error if there is one."""
        if self.estimate is None:
            return self.lower, self.upper
        with np.errstate(over="ignore"):
            return self.lower - self.estimate, self.upper + self.estimate

    def doubtful(self, share: float = DOUBTFUL) -> dict[str, float]:
        """Outputs with an estimated error above a fraction of the width, and the time [s] from which on the error is
        large.

        Error and width are root mean squares from a time to the end. The width is taken as at least a tenth of the
        width over all times. Errors within noise and rounding are ignored. The result is empty without an estimate.
        """
        require_positive("doubtful", "share", share)
        if self.estimate is None:
            return {}
        bad = is_doubtful(*self._scaled(self.estimate), share)
        return {
            name: float(self.t[int(np.argmax(rest))])
            for name, rest in zip(self.names, bad.T, strict=True)
            if rest.any()
        }

    def doubtful_windows(self, share: float = DOUBTFUL) -> tuple[tuple[str, float, float], ...]:
        """Windows of time (name, from, to) [s] with an estimated error above a fraction of the width.

        Error and width are root mean squares over 2 % of the times. The width is taken as at least a tenth of the width
        over all times.
        """
        require_positive("doubtful_windows", "share", share)
        if self.estimate is None:
            return ()
        bad = is_doubtful_in_window(*self._scaled(self.estimate), share)
        edges = np.diff(np.pad(bad, ((1, 1), (0, 0))).astype(int), axis=0)
        return tuple(
            (name, float(self.t[first]), float(self.t[behind - 1]))
            for name, edge in zip(self.names, edges.T, strict=True)
            for first, behind in zip(np.flatnonzero(edge > 0), np.flatnonzero(edge < 0), strict=True)
        )

    def _doubtful_part(
        self, name: str, since: float, windows: Sequence[tuple[str, float, float]], most: int = 3
    ) -> str:
        """Times of a large error of an output, in words."""
        if len(self.t) == 1:
            return ""
        assert self.estimate is not None
        start, end = self.t[[0, -1]]
        first = float(self.t[(self.estimate[:, self._column(name)] > 0).argmax()])  # known start values have no error
        own = [ends for output, *ends in windows if output == name] or [[since, end]]
        spans = [(max(begin, first), max(last, first)) for begin, last in own]  # windows average over errors after them
        if spans[0] == (start, end):
            return " at all times"
        if len(spans) > most:
            return f" at many times from {spans[0][0]:g} s"
        texts = [
            f"from {begin:g} s"
            if last == end
            else f"from {begin:g} to {last:g} s"
            if last > begin
            else f"at {last:g} s"
            for begin, last in spans
        ]
        return " " + " and ".join(texts)

    @property
    def scale(self) -> Array:
        """Largest finite size (n_y,) of the bounds over time."""
        ends = np.abs([self.lower, self.upper])
        return np.asarray(ends.max(axis=(0, 1), initial=0.0, where=np.isfinite(ends)))

    def _scaled(self, estimate: Array) -> tuple[Array, Array, Array]:
        """Estimated error and width, each (n_t, n_y), and the noise or rounding (n_y,), scaled by powers of two.

        The scaling prevents overflow and underflow of squares. If an end is infinite, error and width are 0.
        """
        is_open = np.isinf(self.lower) | np.isinf(self.upper)
        lower, upper, estimate = (np.where(is_open, 0.0, each) for each in (self.lower, self.upper, estimate))
        scale = self.scale
        power = np.frexp(scale)[1]
        lower, upper = np.ldexp([lower, upper], -power)
        floor = SAME * scale if self.noise is None else self.noise
        return np.ldexp(estimate, -power), upper - lower, np.ldexp(floor, -power)

    def __getitem__(self, name: str) -> tuple[Any, Any]:
        """(lower, upper) of one output, each (n_t,), or two numbers if it is a scalar output."""
        k = self._column(name)
        if name in self.figures:
            return float(self.lower[0, k]), float(self.upper[0, k])
        return self.lower[:, k], self.upper[:, k]

    def _figure(self, columns: list[int] | None, style: plot.Style, deviation: bool = False) -> Figure:
        """The picture of some outputs, or of the first six outputs; see `Bounds.plot`."""
        return plot.plot_bounds(
            self.t,
            self.names,
            plot.Band(f"{self.method}, {self.kind}", self.lower, self.upper),
            units=self.units,
            family=plot.family(self.method),
            chosen=columns,
            outer=None if self.estimate is None else self.outer,
            inner=None if self.kind == "sampled" else self.inner,
            nominal=self.nominal,
            deviation=deviation,
            timeless=self.figures if len(self.t) > 1 else (),
            style=style,
        )

    def _without_value(self, k: int) -> str:
        """A sentence if no run has a value of output k; '' otherwise. Such an output has no finite bound."""
        is_open = np.isneginf(self.lower[:, k]).all() and np.isposinf(self.upper[:, k]).all()
        return f"No run has a value of {self.names[k]}, so that it has no bounds." if is_open else ""

    def _column(self, name: str) -> int:
        """Number of an output."""
        return self.names.index(require_name("Bounds", "output", name, self.names))
