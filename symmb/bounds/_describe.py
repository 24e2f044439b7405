"""Bounds and failed runs in words."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from symmb._table import aligned

if TYPE_CHECKING:
    from symmb.bounds._result import Bounds, Failure

_MEANING = {
    "enclosure": "proved: no response lies outside",
    "estimate": "of a surrogate: may miss to either side",
    "sampled": "attained by runs: the responses reach at least as far",
}


def describe(bounds: "Bounds") -> str:
    """What the bounds are and what they cost, where each output is widest, and which runs failed."""
    t = bounds.t
    lines = [
        f"Bounds by {bounds.method}, {len(t)} times from {t[0]:g} to {t[-1]:g} s",
        f"  kind         {bounds.kind} ({_MEANING[bounds.kind]})",
        f"  evaluations  {bounds.evaluations}, {len(bounds.failed) or 'none'} failed",
    ]
    if bounds.failed:
        lines[-1] += "; the bounds are those of the other runs:"
        lines.append(failure_text(bounds.failed, 3, indent="    "))
    doubtful = [f"{name} from {since:g} s" for name, since in bounds.doubtful().items()]
    if doubtful:
        lines.append(f"  doubtful     estimated error above 10 % of the width: {', '.join(doubtful)}")
    if bounds.caution:
        lines.append(f"  caution      {bounds.caution}")
    return "\n".join([*lines, *(f"  {line}" for line in aligned(_widest(bounds)))])


def _widest(bounds: "Bounds") -> list[list[str]]:
    """A line for each output: the bounds where they are farthest apart, and the largest estimated error."""
    lines = [["output", "widest at [s]", "lower", "upper", "width", "estimated error"]]
    width = bounds.upper - bounds.lower
    widest = np.where(np.isnan(width), np.inf, width).argmax(axis=0)
    for k, (name, i) in enumerate(zip(bounds.names, widest.tolist(), strict=True)):
        numbers = [bounds.t[i], bounds.lower[i, k], bounds.upper[i, k], width[i, k]]
        error = "–" if bounds.estimate is None else f"≤ {bounds.estimate[:, k].max():.1e}"
        lines.append([name, *(f"{number:.6g}" for number in numbers), error])
    return lines


def failure_text(failed: "Sequence[Failure]", most: int = 5, indent: str = "  ") -> str:
    """The first failed runs, a line each."""
    lines = [f"{indent}{run}" for run in failed[:most]]
    if len(failed) > most:
        lines.append(f"{indent}and {len(failed) - most} more")
    return "\n".join(lines)
