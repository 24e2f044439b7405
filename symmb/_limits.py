"""What a request costs, before the work: memory and numbers of runs; and large work in windows."""

import os
import resource
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from symmb._errors import PropagationError

_SHARE = 0.5
"""Share of the machine's memory that one request may fill: results are copied once while they are made."""
_UNKNOWN = 4 * 2**30
"""Memory of a machine that does not tell it [bytes]."""
MOST_RUNS = 10**8
"""Most runs of a request: at 10 microseconds each they take a quarter of an hour."""
MOST_STEPS = 10**8
"""Most steps of a fixed length in a run: at a microsecond each they take two minutes."""
MOST_STEPS_KEPT = 10**6
"""The same where CasADi takes them in one call: it keeps a kilobyte of each, and no signal ends it."""
_WINDOW = 2**20
"""Numbers that work on large arrays takes at once: a few arrays of 8 MB."""


def windows(n: int, each: int = 1) -> Iterator[slice]:
    """Slices of n rows of `each` numbers. Work in these windows needs little memory beside its results."""
    size = max(_WINDOW // each, 1)
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def fits(numbers: int) -> bool:
    """Whether so many numbers fit into the share of memory that one request may fill."""
    return 8 * numbers <= _SHARE * memory()


def require_memory(owner: object, what: str, numbers: int) -> None:
    """PropagationError, which names owner and size, if so many numbers do not fit into memory."""
    if not fits(numbers):
        raise PropagationError(
            f"{owner!r}: {what} take {8e-9 * numbers:.3g} GB, more than half of the {1e-9 * memory():.3g} GB of memory."
        )


def require_runs(owner: object, runs: int, instead: str) -> None:
    """PropagationError, which names owner and number, if there are too many runs."""
    if runs > MOST_RUNS:
        number = f"{runs:.1e}" if runs < 10**300 else "more than 1e300"
        raise PropagationError(f"{owner!r} takes {number} runs, more than the {MOST_RUNS:.0e} allowed. {instead}")


def require_steps(owner: object, steps: float, most: float = MOST_STEPS) -> None:
    """PropagationError, which names owner and number, if a run takes too many steps of a fixed length."""
    if steps > most:
        number = f"{steps:.1e}" if steps < 10**300 else "more than 1e300"
        raise PropagationError(f"{owner!r} takes {number} steps a run, more than the {most:.0e} allowed.")


@cache
def memory() -> int:
    """Memory of this machine, of this container, or of this process [bytes]."""
    limits = [_UNKNOWN]
    try:
        limits = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
        own = resource.getrlimit(resource.RLIMIT_AS)[0]
        limits += [] if own == resource.RLIM_INFINITY else [own]
        limits.append(int(Path("/sys/fs/cgroup/memory.max").read_text()))
    except (OSError, ValueError, AttributeError):  # not told, or without a limit
        pass
    return min(limits)
