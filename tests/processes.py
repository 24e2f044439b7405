"""Whether processes run."""

import time
from pathlib import Path


def in_time(holds, seconds):
    """Whether something comes true within some seconds."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and not holds():
        time.sleep(0.05)
    return holds()


def runs(number):
    """Whether a process runs; one that has ended and that nobody has asked for its status does not."""
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
