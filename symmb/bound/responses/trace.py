"""How an adaptive study came to its errors: its rounds, and the rule that decides each estimated error."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from symmb import _html as html
from symmb._names import counted
from symmb._options import optional_package
from symmb._table import aligned, apart
from symmb._types import Array, Indices, Mask
from symmb.bound.responses.time_windows import rms
from symmb.results.files import Record

if TYPE_CHECKING:
    from pandas import DataFrame


class Rule(NamedTuple):
    """Why an error is estimated, and what would reduce it, each as a sentence."""

    cause: str
    remedy: str

    @property
    def is_reduced(self) -> bool:
        """Whether further runs reduce the error."""
        return self.remedy in (_FINER, _NEAR)


_FINER = "A smaller tolerance adds nodes and check runs, which reduce it."


def tolerance_remark(outputs: Sequence[str], tolerance: float, errors: Array) -> str:
    """A remark if the relative error (n_y,) of an output exceeds the tolerance; otherwise an empty text."""
    error = float(np.max(errors, initial=0.0))
    if error <= tolerance:
        return ""
    asked, told = apart(tolerance, error)
    name = outputs[int(np.argmax(errors))]
    return (
        f"The tolerance {asked} of the method was not reached: the estimated error of {name} is {told} times its width."
    )


def with_tolerance_remark(
    remarks: Sequence[str], outputs: Sequence[str], tolerance: float, estimate: Array, width: Array
) -> tuple[str, ...]:
    """Remarks with that on the tolerance for new errors and widths (n_t, n_y), in place of an earlier one."""
    error, size = rms(estimate), rms(width)
    errors = np.divide(error, size, out=np.zeros_like(size), where=(size > 0) & np.isfinite(size))
    short, before = (
        tolerance_remark(outputs, tolerance, errors),
        [each for each in remarks if "was not reached" in each],
    )
    if short and any(USED_UP in each for each in before):
        short = f"{short} {USED_UP}"
    return (*(each for each in remarks if each not in before), *filter(None, [short]))


USED_UP = "Its runs or its time were used up."
"""The end of a remark on a tolerance that was not reached."""
ENDED = "The study used up its runs or its time; a larger budget=, or more time by seconds=, may reduce it."
"""The remedy if runs or time were used up."""
STALLED = "Further runs reduced it too slowly. Studies of parts of the box, or a smaller tolerance, may reduce it."
"""The remedy if the study ended for another reason before its tolerance was reached, such as kinks and cusps."""
_NEAR = "A smaller tolerance adds runs near the extremes, which reduce it."
RULES = {
    "exact": Rule("All runs have the same value.", "No run would reduce it."),
    "decay": Rule("It follows from the last coefficients of the polynomial and from their decay.", _FINER),
    "check runs": Rule("It follows from the differences between check runs and the polynomial.", _FINER),
    "beyond": Rule("It is the distance of a run beyond the range of the polynomial.", _FINER),
    "unseen": Rule("It allows for errors that check runs do not show.", _FINER),
    "range": Rule("It is the accuracy of the search for the range of the polynomial.", "No run would reduce it."),
    "kinks": Rule("It follows from secants through runs on both sides of a possible kink.", _NEAR),
    "events": Rule("It follows from the changes between runs on both sides of an event.", _NEAR),
    "corners": Rule("It follows from runs at corners, for effects that may change their sign between them.", _NEAR),
    "gains": Rule("It follows from how far the last runs near extremes widened the range.", _NEAR),
    "unconfirmed": Rule("The polynomial exceeds all runs, and runs confirmed only a part of the excess.", _NEAR),
    "surface": Rule("It is the deviation of a Gaussian process near the extreme.", _NEAR),
    "waveforms": Rule("It follows from runs that were predicted from the other runs.", _NEAR),
    "failed runs": Rule("Runs near the extreme failed, and its value is not known.", "Only successful runs reduce it."),
    "noise": Rule("It is the noise or the rounding of the runs.", "Only more accurate runs reduce it."),
}
"""The rules that decide an estimated error, by their names in a trace."""


@dataclass(frozen=True)
class Step:
    """A round of a study.

    Attributes
    ----------
    round : number of the round, from 1 on
    study : what was refined, such as "tensor grid" or "sparse grid"
    request : the runs that were made since the last round, in words
    runs : number of these runs
    output : output with the largest error
    before, after : its error before and after the round, over its width; nan if it is not known
    rule : name of the rule that decides the error
    """

    round: int
    study: str
    request: str
    runs: int
    output: str
    before: float
    after: float
    rule: str


class Rounds:
    """The rounds of a study until now, and the runs since the last round.

    Attributes
    ----------
    steps : the rounds
    made : numbers of runs since the last round, by their purpose
    """

    def __init__(self) -> None:
        self.steps, self._last = list[Step](), dict[str, float]()
        self.made: dict[str, int] = dict.fromkeys(("node", "check run", "noise run"), 0)

    def add(self, study: str, rule: str, output: str, error: float) -> None:
        """End a round, whose largest error over the width is that of an output. A rule decides it."""
        made = {name: n for name, n in self.made.items() if n}
        request = ", ".join(counted(n, name) for name, n in made.items()) or "no run"
        before, self._last[output] = self._last.get(output, np.nan), error
        self.steps.append(Step(len(self.steps) + 1, study, request, sum(made.values()), output, before, error, rule))
        self.made = dict.fromkeys(self.made, 0)


@dataclass(frozen=True, eq=False)
class Trace(Sequence[Step]):
    """The rounds of an adaptive study, and the rule that decides the error of each output at each time.

    `print` shows a table. `to_pandas` makes a DataFrame.

    Attributes
    ----------
    steps : the rounds
    rules : (n_t, n_y) positions in RULES
    """

    steps: tuple[Step, ...]
    rules: Indices

    @classmethod
    def joined(cls, traces: Sequence["Trace"], errors: Sequence[Array]) -> "Trace":
        """The rounds of several studies one after the other. The largest of their errors (n_t, n_y) has its rule."""
        steps = [step for trace in traces for step in trace.steps]
        largest = np.argmax(np.nan_to_num(errors), axis=0)[None]
        rules = np.take_along_axis(np.stack([trace.rules for trace in traces]), largest, axis=0)[0]
        return cls(tuple(replace(step, round=k) for k, step in enumerate(steps, 1)), rules)

    def decided(self, which: Mask, rule: str) -> "Trace":
        """The same rounds. Another rule decides the errors that a mask (n_t, n_y) selects."""
        return replace(self, rules=np.where(which, (*RULES,).index(rule), self.rules))

    def __len__(self) -> int:
        return len(self.steps)

    def __getitem__(self, k: Any) -> Any:
        return self.steps[k]

    def __iter__(self) -> Iterator[Step]:
        return iter(self.steps)

    def rule(self, time: int, output: int) -> str:
        """The name of the rule for a number of a time and of an output."""
        return (*RULES,)[self.rules[time, output]]

    def to_pandas(self) -> "DataFrame":
        """A table with one row for each round."""
        return optional_package("pandas", "to_pandas", "data").DataFrame([asdict(step) for step in self.steps])

    def _rows(self) -> list[list[str]]:
        head = ["round", "study", "request", "runs", "output", "before", "after", "rule"]

        def percent(error: float) -> str:
            return "–" if not np.isfinite(error) else f"{100 * error:.2g} %"

        return [head] + [
            [str(s.round), s.study, s.request, str(s.runs), s.output, percent(s.before), percent(s.after), s.rule]
            for s in self.steps
        ]

    def __repr__(self) -> str:
        return "\n".join(aligned(self._rows(), left=(1, 2, 4, 7)))

    def _repr_html_(self) -> str:
        return html.page(html.table(self._rows(), left=(1, 2, 4, 7)))

    def record(self) -> dict[str, Any]:
        """Entries of a file. For each output, only times at which the rule changes are kept."""
        names = (*RULES,)
        changes = np.vstack([np.ones(self.rules.shape[1], dtype=bool), np.diff(self.rules, axis=0) != 0])
        places = zip(*(each.tolist() for each in np.nonzero(changes)), strict=True)
        decided = [{"output": k, "time": t, "rule": names[self.rules[t, k]]} for t, k in places]
        return {"steps": [asdict(step) for step in self.steps], "decided": decided}

    @classmethod
    def of_record(cls, record: Record, n_t: int, n_y: int) -> "Trace":
        """The trace of a file."""
        numbers = {name: k for k, name in enumerate(RULES)}
        rules = np.zeros((n_t, n_y), dtype=np.intp)
        for own in record.records("decided", "output", "time", "rule"):
            rules[int(own.number("time")) :, int(own.number("output"))] = numbers[own.text("rule", *RULES)]
        return cls(tuple(_step(each) for each in record.records("steps")), rules)


def _step(record: Record) -> Step:
    words = {name: record.text(name) for name in ("study", "request", "output", "rule")}
    return Step(round=int(record.number("round")), runs=int(record.number("runs")), before=record.number("before"),
                after=record.number("after"), **words)  # fmt: skip
