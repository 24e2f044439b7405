"""Checks of the memory and the number of runs that a request needs, and slices that divide large work."""

import os
import resource
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from symmb._errors import PropagationError

MOST_RUNS = 10**8
"""Maximum number of runs of a request. If each run takes 10 microseconds, they take a quarter of an hour."""
MOST_STEPS = 10**8
"""Maximum number of fixed steps in a run. If each step takes a microsecond, the run takes two minutes."""
MOST_STEPS_KEPT = 10**6
"""Maximum number of fixed steps in one call of CasADi. Each step needs a kilobyte, and a signal cannot end the call."""


def windows(n: int, each: int = 1) -> Iterator[slice]:
    """Slices that divide n rows of `each` numbers. Work on one slice at a time needs little memory."""
    size = max(2**20 // each, 1)  # a few arrays of 8 MB
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def fits(numbers: int) -> bool:
    """Whether this many numbers fit into the memory that one request may use."""
    return 8 * numbers <= 0.5 * memory()  # results are copied once while they are made


def require_memory(owner: object, what: str, numbers: int) -> None:
    """Raise PropagationError if this many numbers do not fit into memory. The text names the owner and the size."""
    if not fits(numbers):
        raise PropagationError(
            f"{owner!r}: {what} take {8e-9 * numbers:.3g} GB, more than half of the {1e-9 * memory():.3g} GB of "
            "memory. Reduce the number of values."
        )


def require_runs(owner: object, runs: int, instead: str) -> None:
    """Raise PropagationError if there are too many runs. The text names the owner and the number."""
    if runs > MOST_RUNS:
        number = f"{runs:.1e}" if runs < 10**300 else "more than 1e300"
        raise PropagationError(f"{owner!r} takes {number} runs, more than the {MOST_RUNS:.0e} allowed. {instead}")


def require_steps(owner: object, steps: float, most: float = MOST_STEPS) -> None:
    """Raise PropagationError if a run takes too many fixed steps. The text names the owner and the number."""
    if steps > most:
        number = f"{steps:.1e}" if steps < 10**300 else "more than 1e300"
        raise PropagationError(f"{owner!r} takes {number} steps in each run. Use at most {most:.0e} steps.")


@cache
def memory() -> int:
    """Memory that this process may use [bytes]: the smallest limit of the machine, the container and the process."""
    limits = [4 * 2**30]  # assumed if the machine does not report its memory
    try:
        limits = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
        own = resource.getrlimit(resource.RLIMIT_AS)[0]
        limits += [] if own == resource.RLIM_INFINITY else [own]
        limits.append(int(Path("/sys/fs/cgroup/memory.max").read_text()))
    except (OSError, ValueError, AttributeError):  # the value is not available, or there is no limit
        pass
    return min(limits)
