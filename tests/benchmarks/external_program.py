"""A program that crashes, hangs and writes nonsense: python tests/benchmarks/external_program.py [RUNS]

A program of C with four parameters crashes in 5 % of its runs, hangs in 2 % beside a process that it has started,
writes no numbers in 1 %, and NaN in a corner of the box. A hash of the parameters decides, so that the truth is known
for each run. PolynomialChaos, MonteCarlo and Scanning bound it on two threads. Every failure must be told with its
kind, no run may take longer than the timeout, and no process may be left. It prints what was found for each method.
"""

import os
import secrets
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb
from symmb.bound.reductions import bounded
from symmb.connect import open_run_database

TIMES = np.linspace(0.0, 2.0, 5)
BOX = mb.Box(a=(0.9, 1.1), b=(1.8, 2.2), c=(0.4, 0.6), d=(2.9, 3.1))
CODE = """
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <unistd.h>
/* Reads a, b, c, d; writes x = a exp(-c t) and y = b sin(d t). FNV-1a over their bytes decides what fails. */
int main(void) {
    double p[4];
    FILE *in = fopen("in.txt", "r");
    if (!in || fscanf(in, "a = %lf b = %lf c = %lf d = %lf", p, p + 1, p + 2, p + 3) != 4) return 7;
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < sizeof p; i++) hash = (hash ^ ((unsigned char *)p)[i]) * 1099511628211u;
    int kind = (hash >> 32) % 100;
    if (kind < 5) raise(SIGSEGV);
    if (kind < 7) { fork(); for (;;) sleep(1000); }
    FILE *out = fopen("out.csv", "w");
    if (kind < 8) { fputs("time,x,y\\n0,what,is this\\n", out); return fclose(out); }
    fputs("time,x,y\\n", out);
    for (int i = 0; i < 5; i++) {
        double t = 0.5 * i, y = p[0] > 1.05 && p[1] > 2.1 ? NAN : p[1] * sin(p[3] * t);
        fprintf(out, "%.17g,%.17g,%.17g\\n", t, p[0] * exp(-p[2] * t), y);
    }
    return fclose(out);
}
"""
TOLD = {
    "crash": "was killed by SIGSEGV",
    "hang": "timed out: the program had not ended after",
    "nonsense": "out.csv cannot be read",
    "NaN": " is not finite at t = 0 ",
}
"""What the text of a failed run holds, by its kind."""


def truth(p: np.ndarray) -> str:
    """How the run of a sample p (4,) fails; "" if it does not."""
    value = 14695981039346656037
    for byte in struct.pack("4d", *p):
        value = (value ^ byte) * 1099511628211 % 2**64
    kind = (value >> 32) % 100
    fails = "crash" if kind < 5 else "hang" if kind < 7 else "nonsense" if kind < 8 else ""
    return fails or ("NaN" if p[0] > 1.05 and p[1] > 2.1 else "")


def told_kind(message: str) -> str:
    """The kind of failure that a text tells."""
    return next((kind for kind, text in TOLD.items() if text in message), message)


def closed_form(p: np.ndarray) -> np.ndarray:
    """The response (n_t, 2) of a sample p (4,)."""
    return np.column_stack([p[0] * np.exp(-p[2] * TIMES), p[1] * np.sin(p[3] * TIMES)])


def compiled(folder: Path) -> Path | None:
    """The program; None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    (folder / "model.c").write_text(CODE)
    subprocess.run([compiler, "-O1", "-o", folder / "model", folder / "model.c", "-lm"], check=True)
    return folder / "model"


def processes_with(mark: str) -> list[int]:
    """Processes, but for this one, whose environment holds a text: a program and all that it started."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (entry / "environ").read_bytes() and int(entry.name) != os.getpid():
                found.append(int(entry.name))
        except OSError:
            continue
    return found


@dataclass(frozen=True)
class Finding:
    """What a method found, and what did not hold."""

    runs: int
    failed: Counter[str]
    seconds: float
    longest: float
    region: str
    faults: list[str]


def study(program: Path, method: mb.MonteCarlo | mb.Scanning | mb.PolynomialChaos, timeout: float) -> Finding:
    """Bounds of the program by a method, checked run by run."""
    mark, durations = secrets.token_hex(16), []

    def timed(response: Callable[[dict[str, float]], object]) -> Callable[[dict[str, float]], object]:
        def call(values: dict[str, float]) -> object:
            begin = time.perf_counter()
            try:
                return response(values)
            finally:
                durations.append(time.perf_counter() - begin)

        return call

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        simulator = mb.CommandSimulator(
            [program],
            dict(zip(BOX.names, BOX.center.tolist(), strict=True)),
            TIMES,
            ["x", "y"],
            templates={"in.txt": " ".join(f"{name} = {{{name}}}" for name in BOX.names)},
            timeout=timeout,
            environment={"STUDY": mark},
            keep="none",
            folder=folder,
        )
        object.__setattr__(simulator, "response", timed(simulator.response))
        begin = time.perf_counter()
        with ThreadPoolExecutor(2) as pool:
            stored = mb.StoredSimulator(simulator, Path(folder, "runs.db"))
            bounds = bounded(method, stored, BOX, executor=pool)  # without check runs, so that runs can be counted
        seconds = time.perf_counter() - begin
        with open_run_database(Path(folder, "runs.db")) as database:
            P = database.samples(1, 4)
            runs = database.read(1, P, (len(TIMES), 2))
            states = database.studies()[0][-1]
        left = [path.name for path in Path(folder).iterdir() if path.is_dir()]
    kinds = [truth(p) for p in P]
    messages = iter(runs.messages)
    found = ["" if ok else told_kind(next(messages)) for ok in runs.ok]
    faults = [f"{p}: {told!r} for {kind!r}" for p, told, kind in zip(P, found, kinds, strict=True) if told != kind]
    faults += [
        f"{p}: wrong response" for p, Y, kind in zip(P, runs.Y, kinds, strict=True) if not kind and not _same(p, Y)
    ]
    named = {
        tuple(failure.parameters[name] for name in BOX.names): told_kind(failure.message) for failure in bounds.failed
    }
    expected = {tuple(p.tolist()): kind for p, kind in zip(P, kinds, strict=True) if kind}
    if named != expected or len(bounds.failed) != len(expected):
        faults.append(f"{len(bounds.failed)} failed runs are told, {len(expected)} failed")
    if states != (kinds.count(""), len(expected) - kinds.count("hang"), kinds.count("hang"), 0):
        faults.append(f"the store counts {states}")
    if len(P) != bounds.evaluations:
        faults.append(f"{len(P)} runs are stored of {bounds.evaluations}")
    if max(durations) > timeout + 1.0:
        faults.append(f"a run took {max(durations):.1f} s")
    if left:
        faults.append(f"folders are left: {left}")
    if processes := processes_with(mark):
        faults.append(f"processes are left: {processes}")
    return Finding(len(P), Counter(filter(None, kinds)), seconds, max(durations), bounds.failed_region, faults)


def _same(p: np.ndarray, Y: np.ndarray) -> bool:
    return bool(np.allclose(Y, closed_form(p), rtol=1e-14, atol=1e-14))


def main(runs: int) -> int:
    """Print the findings of three methods with about so many runs each."""
    with tempfile.TemporaryDirectory() as folder:
        program = compiled(Path(folder))
        if program is None:
            print("There is no C compiler.")
            return 1
        faults = 0
        points = max(2, round(runs**0.25))
        for method in (mb.PolynomialChaos(tolerance=1e-6, budget=runs), mb.MonteCarlo(runs), mb.Scanning(points)):
            finding = study(program, method, 1.0)
            counts = ", ".join(f"{count} {kind}" for kind, count in sorted(finding.failed.items()))
            print(
                f"{method!r}: {finding.runs} runs in {finding.seconds:.1f} s, the longest {finding.longest:.2f} s; "
                f"failed: {counts}; {finding.region}; {len(finding.faults)} faults"
            )
            for fault in finding.faults[:10]:
                print(f"  {fault}")
            faults += len(finding.faults)
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 625))
