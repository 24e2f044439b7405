"""Whether bounds keep limits: kept, violated, or not decided by the bounds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from symmb import _html as html
from symmb import plot
from symmb._errors import DeclarationError
from symmb._labelled import Labelled, Result, over_outputs, texts
from symmb._names import did_you_mean
from symmb._options import is_real, shown
from symmb._table import aligned, over_times
from symmb._types import Array
from symmb.files import to_jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from symmb.bounds.worst_case import WorstCase

_WORDS = {True: "kept", False: "violated", None: "undecided"}
_LEFT = (0, 1, 2)


@dataclass(frozen=True, eq=False)
class OutputBounds:
    """The bounds of one output, as `Bounds` has them.

    Attributes
    ----------
    kind : str
    lower, upper : (n_t,)
    estimate : (n_t,)          estimated error; None if there is none
    inner : (lower, upper)     attained by runs; None if none are known
    evaluations : int
    is_doubted : bool
    rounding : float           how far runs may be off by rounding or noise
    """

    kind: Literal["enclosure", "estimate", "sampled"]
    lower: Array
    upper: Array
    estimate: Array | None
    inner: tuple[Array, Array] | None
    evaluations: int
    is_doubted: bool
    rounding: float


@dataclass(frozen=True, eq=False)
class KeptLimit:
    """The limit of one output.

    Attributes
    ----------
    output, unit : str
    low, high : float          limits, infinite where there is none
    kept : True, False, None   whether all responses are inside; None if the bounds do not decide it
    why : str                  what decides, or what would decide, in a sentence
    margin : (n_t,)            distance of the bounds from the closer limit, below 0 beyond it
    """

    output: str
    unit: str
    low: float
    high: float
    kept: bool | None
    why: str
    margin: Array

    @property
    def row(self) -> int:
        """Number of the time of the least margin."""
        return int(self.margin.argmin())

    @property
    def text(self) -> str:
        """The limit as an inequality."""
        low = f"{self.low:g} <= " if np.isfinite(self.low) else ""
        high = f" <= {self.high:g}" if np.isfinite(self.high) else ""
        return f"{low}{self.output}{high}"


@dataclass(frozen=True, eq=False, repr=False)
class LimitCheck(Result):
    """Which limits are kept. `print` shows them, `plot` draws bounds and limits.

    Attributes
    ----------
    t : (n_t,)                 times [s]
    method : str
    limits : tuple of KeptLimit
    draw : function            of names of outputs: a figure of their bounds
    worst : WorstCase          the run that comes closest to a limit, or is farthest beyond it; None if none is known
    """

    t: Array
    method: str
    limits: tuple[KeptLimit, ...]
    draw: "Callable[[list[str]], Figure]"
    worst: "WorstCase | None"

    @property
    def kept(self) -> bool | None:
        """True if all limits are kept, False if one is violated, None if that is not decided."""
        found = [limit.kept for limit in self.limits]
        return False if False in found else None if None in found else True

    @property
    def margin(self) -> Array:
        """(n_t,) the least distance of the bounds from a limit, below 0 beyond it."""
        return np.min([limit.margin for limit in self.limits], axis=0)

    def __getitem__(self, output: str) -> KeptLimit:
        """The limit of an output."""
        for limit in self.limits:
            if limit.output == output:
                return limit
        raise DeclarationError(f"No limit of {shown(output)}.{did_you_mean(output, [x.output for x in self.limits])}")

    def _head(self) -> str:
        return f"Limits by {self.method}: {_WORDS[self.kept]}"

    def _rows(self) -> list[list[str]]:
        rows = [["limit", "result", "why", "least margin", "at [s]"]]
        for limit in self.limits:
            least, time = self._least(limit)
            margin = f"{least:.4g}{' ' * bool(limit.unit)}{limit.unit}"
            rows.append([limit.text, _WORDS[limit.kept], limit.why, margin, f"{time:.6g}"])
        return over_times(rows, self.t)

    def _least(self, limit: KeptLimit) -> tuple[float, float]:
        """The least margin of a limit, and its time [s]."""
        return float(limit.margin[limit.row]), float(self.t[limit.row])

    def to_json(self) -> dict[str, dict[str, Any]]:
        """The result of each output, why, its least margin with the time, and its limits, None where there is none."""
        found = {}
        for limit in self.limits:
            margin, time = self._least(limit)
            result = {"result": _WORDS[limit.kept], "why": limit.why, "margin": margin, "time": time}
            found[limit.output] = to_jsonable(result | {"low": limit.low, "high": limit.high})
        return found

    def __str__(self) -> str:
        worst = [f"  worst case: {self.worst}"] if self.worst else []
        return "\n".join([self._head(), *(f"  {line}" for line in aligned(self._rows(), left=_LEFT)), *worst])

    def as_html(self) -> str:
        """The head and the table, without a picture."""
        return html.page(html.text(self._head()), html.table(self._rows(), _LEFT))

    def _repr_html_(self) -> str:
        return html.page(self.as_html(), html.picture(plot.png(self.plot())))

    def plot(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
    ) -> "Figure":
        """Draw the bounds of outputs with limits, and these as lines; write the picture to `path` if given.

        Without names these are all outputs with limits.

        Parameters
        ----------
        figsize : (width, height)  of the figure [inch]
        title : str                of the figure
        """
        chosen = plot.columns_of("LimitCheck.plot", outputs, [limit.output for limit in self.limits])
        some = self.limits if chosen is None else [self.limits[k] for k in chosen]
        figure = self.draw([limit.output for limit in some])
        plot.add_limits(figure, [(limit.low, limit.high) for limit in some])
        return plot.finish(figure, "LimitCheck.plot", path, None, figsize, title)

    def _labelled(self) -> Labelled:
        names = [limit.output for limit in self.limits]
        coordinates, units = over_outputs(self.t, names, [limit.unit for limit in self.limits])
        kept = texts([_WORDS[limit.kept] for limit in self.limits])
        variables: dict[str, Any] = {
            "margin": (("time", "output"), np.stack([limit.margin for limit in self.limits], axis=1)),
            "low": (("output",), np.array([limit.low for limit in self.limits])),
            "high": (("output",), np.array([limit.high for limit in self.limits])),
            "result": (("output",), kept),
        }
        return Labelled(coordinates, variables, {"method": self.method}, {"time": units["time"]})


def limit_pairs(
    owner: str, limits: Mapping[str, tuple[float | None, float | None]], names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Limits as numbers, infinite where there is none.

    Raises
    ------
    DeclarationError    if an output is unknown, or they are no pairs of numbers or None, or cross
    """
    if not isinstance(limits, Mapping) or not limits:
        raise DeclarationError(
            f'{owner}: limits must be pairs by output, such as {{"x": (None, 0.3)}}, got {shown(limits)}.'
        )
    for name in limits:
        if not isinstance(name, str) or name not in names:
            raise DeclarationError(f"{owner}: no output {shown(name)}.{did_you_mean(str(name), names)}")
    return {name: _ends(owner, name, pair) for name, pair in limits.items()}


def kept_limit(output: str, unit: str, low: float, high: float, bounds: OutputBounds) -> KeptLimit:
    """Whether bounds of an output keep a limit."""
    margin = np.minimum(bounds.lower - low, high - bounds.upper)
    return KeptLimit(output, unit, low, high, *_decision(bounds, margin, low, high), margin)


def _decision(bounds: OutputBounds, margin: Array, low: float, high: float) -> tuple[bool | None, str]:
    """Whether a limit is kept, and why."""
    attained = bounds.inner or ((bounds.lower, bounds.upper) if bounds.kind == "sampled" else (np.inf, -np.inf))
    beyond = max(np.max(low - attained[0]), np.max(attained[1] - high))
    if beyond > bounds.rounding:
        return False, "A run is beyond it."
    if bounds.is_doubted:
        return None, "The bounds are doubted."
    if beyond > 0:
        return None, f"A run is beyond it, but by no more than rounding or noise of {bounds.rounding:.1e}."
    if bounds.kind == "sampled":
        return None, f"All {bounds.evaluations} runs keep it: PolynomialChaos() estimates what is between them."
    if bounds.kind == "enclosure":
        if (margin >= 0).all():
            return True, "This is proved."
        if ((bounds.lower > high) | (bounds.upper < low)).any():
            return False, "All responses are beyond it at a time."
        return None, "The proved bounds are beyond it, and may be wider than the responses: more boxes decide."
    if bounds.estimate is None:
        return None, "The bounds have no estimated error: PolynomialChaos() has one."
    if (margin < -np.maximum(bounds.estimate, bounds.rounding)).any():
        error = bounds.estimate[(margin + bounds.estimate).argmin()]
        return False, f"The bounds are beyond it by more than their estimated error of {error:.1e}."
    error = bounds.estimate.max()
    if (margin >= bounds.estimate).all():
        return True, f"The estimated error is at most {error:.1e}."
    return (
        None,
        f"The estimated error is up to {error:.1e}: PolynomialChaos(tolerance=...) with a smaller number decides.",
    )


def _ends(owner: str, name: str, pair: object) -> tuple[float, float]:
    if not isinstance(pair, list | tuple) or len(pair) != 2 or not any(end is not None for end in pair):
        raise DeclarationError(
            f"{owner}: the limit of {name!r} must be a pair (low, high), of which one may be None, got {shown(pair)}."
        )
    for end in pair:
        if end is not None and (not is_real(end) or np.isnan(end)):
            raise DeclarationError(f"{owner}: the limit of {name!r} must be numbers or None, got {shown(pair)}.")
    low, high = (-np.inf if pair[0] is None else float(pair[0])), (np.inf if pair[1] is None else float(pair[1]))
    if low > high:
        raise DeclarationError(f"{owner}: the limits of {name!r} cross: {low:g} is above {high:g}.")
    if not np.isfinite([low, high]).any():
        raise DeclarationError(f"{owner}: one end of the limit of {name!r} must be finite, got {shown(pair)}.")
    return low, high
