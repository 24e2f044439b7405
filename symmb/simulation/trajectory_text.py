"""Lines of the text of a run: its start, pulses, its events, and what is doubtful about it."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from symmb._types import Array
from symmb.events import Event

_ROUNDING = 1e-12, 1e-30
"""Shares below which a number counts as 0: of its output's largest, and of the largest of all outputs."""
_START = {"held": "held", "solved": "solved for", "free": "left free"}


def start_lines(start: Mapping[str, list[str]]) -> list[str]:
    """What the start held, solved for and left free, and rows that are redundant."""
    parts = "; ".join(f"{what} {_listed(start[key])}" for key, what in _START.items())
    redundant = [f"  redundant   {_listed(start['redundant'])}: least reactions"] if start["redundant"] else []
    return [f"  start       {parts}", *redundant]


def pulse_lines(longest: float, rtol: float | None) -> list[str]:
    """The longest step that passes over no pulse in a law of time."""
    if not math.isfinite(longest):
        return []
    passes = "at most {:.2g} s, so that none passes over one"
    if rtol is None:  # the user chose the fixed step
        passes = "more than {:.2g} s may pass over one"
    return [f"  pulses      in laws of time: steps of {passes.format(longest)}"]


def event_lines(events: Sequence[Event]) -> list[str]:
    """Impacts by their names, other events with their times, and the work of all."""
    if not events:
        return []
    counts = Counter(event.name for event in events if event.what == "impact")
    parts = [f"{n} of {name!r}" for name, n in counts.items()]
    parts += [f"{e.name!r} {e.what} at {e.time:.6g} s" for e in events if e.what != "impact"]
    work = sum(event.work for event in events)
    return [f"  impacts     {', '.join(parts[:6] + ['...'] * (len(parts) > 6))}; work {work:.4g} J"]


def doubt_lines(doubts: Sequence[str]) -> list[str]:
    """One line for each doubt."""
    return [f"  doubtful    {doubt}" for doubt in doubts]


def extremes(t: Array, values: Array, names: Sequence[str]) -> list[list[str]]:
    """First, last, least and largest value of every output (n_t, n_y) as rows of text. Rounding is shown as 0."""
    size = np.abs(values)
    rounding = np.maximum(_ROUNDING[0] * size.max(axis=0), _ROUNDING[1] * size.max(initial=0.0))
    values = np.where(size < rounding, 0.0, values)
    head = ["output", f"at {t[0]:g} s", f"at {t[-1]:g} s", "least", "largest"]
    columns = [values[0], values[-1], values.min(axis=0), values.max(axis=0)]
    return [head, *([name, *(f"{column[i]:.6g}" for column in columns)] for i, name in enumerate(names))]


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "nothing"
