"""Failed runs and their text."""

import re
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Failure:
    """A failed run: parameter values by name, time of the failure [s], message."""

    parameters: dict[str, float]
    time: float
    message: str

    def __str__(self) -> str:
        if all(re.search(rf"\b{re.escape(name)} ?= ?", self.message) for name in self.parameters):
            return self.message  # messages of scenes and functions contain them
        values = ", ".join(f"{name}={value:.6g}" for name, value in self.parameters.items())
        return f"{values}: t = {self.time:.6g}: {self.message}"


def failure_text(failed: Sequence[Failure], most: int = 5, indent: str = "  ") -> str:
    """The first failed runs, a line for each."""
    lines = [f"{indent}{run}" for run in failed[:most]]
    if len(failed) > most:
        lines.append(f"{indent}and {len(failed) - most} more")
    return "\n".join(lines)
