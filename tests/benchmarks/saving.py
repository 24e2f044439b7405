"""Saves that are killed, or run out of space, at random moments: python tests/benchmarks/saving.py [MOMENTS].

Each format, at 100 moments: a process saves again and again, and is killed; or its files may not grow beyond a random
size. The file must be whole every time.
"""

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb

SAVE = """
import resource, sys
import numpy as np, symmb as mb
limit, path = int(sys.argv[1]), sys.argv[2]
t, values = np.linspace(0, 1, 1000), np.ones((1000, 20))
bounds = mb.Bounds(t, tuple(f"x{k}" for k in range(20)), values * 0, values, "sampled", "Vertex()", 4)
bounds.save(path)
print("ready", flush=True)
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
while True:
    try:
        bounds.save(path)
    except OSError:
        sys.exit(7)
"""
LARGEST = 100_000
"""Size below which files may not grow [bytes]: all are larger."""


def damaged(suffix: str, moment: float, limit: int) -> str:
    """What is wrong with a file after its save was killed at a moment [s], or limited; empty if nothing."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"bounds.{suffix}")
        process = subprocess.Popen([sys.executable, "-c", SAVE, str(limit), str(path)], stdout=subprocess.PIPE)
        assert process.stdout is not None
        process.stdout.readline()
        if limit:
            process.wait()
        else:
            time.sleep(moment)
            process.send_signal(signal.SIGKILL)
            process.wait()
        process.stdout.close()
        try:
            mb.Bounds.load(path)
        except mb.SymmbError as error:
            return f"{suffix}, {moment:.4f} s, limit {limit}: {error}"
        if limit and len(list(Path(folder).iterdir())) > 1:
            return f"{suffix}, limit {limit}: left more than the file"
        return ""


if __name__ == "__main__":
    MOMENTS = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    choice = random.Random(0)
    for suffix in ("npz", "json", "csv"):
        killed = [damaged(suffix, choice.uniform(0.0, 0.1), 0) for _ in range(MOMENTS)]
        full = [damaged(suffix, 0.0, choice.randrange(1, LARGEST)) for _ in range(MOMENTS)]
        faults = [*filter(None, [*killed, *full])]
        print(
            f"{suffix}: {MOMENTS} kills, {MOMENTS} full disks, {len(faults)} faults", *faults, sep="\n    ", flush=True
        )
