"""Kills at random moments: python tests/benchmarks/kill_studies.py [KILLS] kills stored studies and their workers.

A study makes 400 runs of 5 to 20 ms on two processes, and stores them; in every other one the rows are so large that
most of the time goes into writing. SIGKILL ends it at a random moment, again and again, until it comes to its end.
After each kill the file must be sound, and hold every run that was told to be stored. At the end the bounds must be
those of an undisturbed study to the last bit, and each kill may cost no more than the runs that were under way. The
same holds if a worker of the pool is killed, or one of Dask. It prints what each kind of kill cost, and what did not
hold.

python tests/benchmarks/kill_studies.py damaged [STORES [SEED]] damages stores by other bytes, by their ends, by other
values in their rows and by other tables. A study with such a store, and the command that lists it, must end with one
sentence or with the right bounds.
"""

import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb
from symmb.connect import RunDatabase, open_run_database
from symmb.connect.run_database import sample_keys

RUNS = 400
BOX = mb.Box(a=(0.5, 1.5), b=(0.8, 1.2))
SIZES = {"small": (11, 2), "large": (5001, 12)}
"""Rows and columns of a response."""
UNDER_WAY = {"study": 7, "worker": 8, "dask": 100}
"""Runs that a kill may cost: two that run, three that wait in the queue of the workers, and two that are not stored
yet; where the study goes on, those of a worker that died are tried again. A worker of Dask holds its results until they
are fetched, for up to half a second, in which it makes some tens of these fast runs."""


def response(a: float, b: float) -> np.ndarray:
    """A run of 5 to 20 ms, which notes its process and its parameters first."""
    shape = SIZES[os.environ["STUDY_SIZE"]]
    with open(os.environ["STUDY_CALLS"], "a") as calls:
        calls.write(f"{os.getpid()} {a!r} {b!r}\n")
    time.sleep(0.005 + 0.015 * (abs(np.sin(1e4 * a)) % 1))
    t = np.linspace(0.0, 1.0, shape[0])[:, None]
    return np.exp(-a * t) * np.cos(b * t * np.arange(shape[1]))


def study(database: str, stored: str, result: str, workers: str) -> None:
    """The study: what the store has written is noted afterwards."""
    warnings.simplefilter("ignore")
    add = RunDatabase.add

    def noted(self: RunDatabase, number: int, p: np.ndarray, *run: object) -> None:
        with open(stored, "ab", buffering=0) as file:
            file.write(b"begun\n")
            add(self, number, p, *run)  # pyright: ignore[reportArgumentType]
            file.write(sample_keys(p[None])[0].hex().encode() + b"\n")

    RunDatabase.add = noted  # pyright: ignore[reportAttributeAccessIssue]
    times = np.linspace(0.0, 1.0, SIZES[os.environ["STUDY_SIZE"]][0])
    outputs = [f"y{k}" for k in range(SIZES[os.environ["STUDY_SIZE"]][1])]
    f = mb.FunctionSimulator(response, {"a": 1.0, "b": 1.0}, times, outputs)
    made = mb.StoredSimulator(f, database)
    if workers == "dask":
        from distributed import Client, LocalCluster

        with (
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
            Client(cluster) as client,
        ):
            bounds = mb.propagate(made, mb.MonteCarlo(RUNS), BOX, executor=client)
    else:
        bounds = mb.propagate(made, mb.MonteCarlo(RUNS), BOX, executor=lambda: ProcessPoolExecutor(2))
    np.save(result, np.stack([bounds.lower, bounds.upper]))


@dataclass
class Findings:
    """Kills, runs that were made again because of them, kills in the middle of a write, and what did not hold."""

    kills: int = 0
    again: list[int] = field(default_factory=list)
    in_writes: int = 0
    faults: list[str] = field(default_factory=list)


class Files:
    """The files of a study in a folder."""

    def __init__(self, folder: Path, size: str) -> None:
        self.database, self.stored, self.result, self.calls = (
            folder / name for name in ("runs.db", "stored", "out.npy", "calls")
        )
        self.environment = {
            **os.environ,
            "STUDY_CALLS": str(self.calls),
            "STUDY_SIZE": size,
            "OPENBLAS_NUM_THREADS": "1",
        }

    def start(self, workers: str) -> "subprocess.Popen[bytes]":
        arguments = [str(path) for path in (self.database, self.stored, self.result)]
        command = [sys.executable, __file__, "study", *arguments, workers]
        return subprocess.Popen(command, env=self.environment, start_new_session=True, stderr=subprocess.DEVNULL)

    def made(self) -> list[str]:
        """Runs that were begun: process, and parameters."""
        return self.calls.read_text().splitlines() if self.calls.exists() else []

    def written(self) -> list[str]:
        """Begins of writes, and the keys of runs that were stored after them."""
        return self.stored.read_text().split() if self.stored.exists() else []

    def bounds(self) -> bytes:
        return np.load(self.result).tobytes()

    def lost(self) -> list[str]:
        """What does not hold of the file."""
        connection = sqlite3.connect(self.database)
        try:
            faults = [row[0] for row in connection.execute("PRAGMA integrity_check") if row[0] != "ok"]
            kept = {row[0].hex() for row in connection.execute("SELECT sample FROM runs")}
        finally:
            connection.close()
        return faults + [f"lost: {key}" for key in self.written() if key != "begun" and key not in kept]


def killed_study(size: str, expected: bytes, most: int, findings: Findings) -> None:
    """Kill a study at random moments until it ends."""
    with tempfile.TemporaryDirectory() as folder:
        files, kills = Files(Path(folder), size), 0
        while not files.result.exists():
            begun = len(files.made())
            process = files.start("processes")
            moment = random.randint(begun, RUNS + 30) if kills < most else 10**9
            while process.poll() is None and len(files.made()) <= moment:
                time.sleep(0.001)
            time.sleep(random.uniform(0, 0.02))
            if process.poll() is None:
                os.kill(process.pid, signal.SIGKILL)
                kills += 1
                findings.kills += 1
            process.wait()
            _end(process.pid, findings)
            findings.in_writes += files.written()[-1:] == ["begun"]
            if files.database.exists():
                findings.faults += files.lost()
        _judge(files, expected, kills, "study", findings)


def killed_worker(size: str, workers: str, expected: bytes, findings: Findings) -> None:
    """Kill the worker that began the latest run, at a random moment."""
    with tempfile.TemporaryDirectory() as folder:
        files = Files(Path(folder), size)
        process = files.start(workers)
        moment = random.randint(1, RUNS - 20)
        while process.poll() is None and len(files.made()) <= moment:
            time.sleep(0.001)
        os.kill(int(files.made()[-1].split()[0]), signal.SIGKILL)
        findings.kills += 1
        process.wait()
        _end(process.pid, findings)
        findings.faults += files.lost()
        _judge(files, expected, 1, "worker" if workers == "processes" else "dask", findings)


def _judge(files: Files, expected: bytes, kills: int, kind: str, findings: Findings) -> None:
    made = [line.split(" ", 1)[1] for line in files.made()]
    findings.again.append(len(made) - RUNS)
    if len(set(made)) != RUNS or len(made) > RUNS + kills * UNDER_WAY[kind]:
        findings.faults.append(f"{len(made)} runs were made, {len(set(made))} different ones, with {kills} kills")
    if not files.result.exists() or files.bounds() != expected:
        findings.faults.append("other bounds than those of the undisturbed study")


def _end(group: int, findings: Findings) -> None:
    """End the workers that outlive a study."""
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return
    for _ in range(500):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.01)
    findings.faults.append("workers cannot be ended")


def undisturbed(size: str) -> bytes:
    """The bounds of a study that nothing kills."""
    with tempfile.TemporaryDirectory() as folder:
        files = Files(Path(folder), size)
        files.start("processes").wait()
        return files.bounds()


TIMES = np.linspace(0.0, 1.0, 3)
ROWS = {
    "studies": ("id", "digest", "simulator", "parameters", "outputs", "times", "begun", "checksum"),
    "runs": ("study", "sample", "state", "t_failed", "reason", "response", "events", "seconds", "checksum"),
}
TABLES = (
    "ALTER TABLE runs RENAME TO other",
    "DROP TABLE runs",
    "ALTER TABLE runs ADD COLUMN more TEXT",
    "ALTER TABLE runs RENAME TO r; CREATE VIEW runs AS SELECT * FROM r",
    "ALTER TABLE runs RENAME TO r; CREATE VIEW runs AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT r.* FROM r, n",
    "CREATE TRIGGER t AFTER INSERT ON runs BEGIN UPDATE runs SET response = zeroblob(24); END",
    "PRAGMA user_version = 99",
    "PRAGMA application_id = 7",
)


def falling(a: float, b: float) -> np.ndarray:
    """A run that is stored."""
    if a > 1.45 and b > 1.1:
        raise RuntimeError("stuck")
    return np.exp(-a * b * TIMES)


def stored_study(path: Path) -> mb.Bounds:
    """Bounds with a store."""
    f = mb.FunctionSimulator(falling, {"a": 1.0, "b": 1.0}, TIMES, ["x"])
    return mb.propagate(mb.StoredSimulator(f, path), mb.Scanning(5), BOX)


def damage(path: Path, choice: random.Random) -> str:
    """Damage a store, and tell how."""
    content = bytearray(path.read_bytes())
    kind = choice.choice(["bytes", "bits", "end", "page", "value", "tables"])
    if kind in ("bytes", "bits"):
        begin = choice.randrange(len(content))
        for k in range(begin, min(begin + (1 if kind == "bits" else choice.randint(1, 300)), len(content))):
            content[k] = content[k] ^ 1 << choice.randrange(8) if kind == "bits" else choice.randrange(256)
    elif kind == "end":
        del content[choice.randrange(16, len(content)) :]
    elif kind == "page":
        a, b = (4096 * choice.randrange(len(content) // 4096) for _ in range(2))
        content[a : a + 4096] = content[b : b + 4096]
    if kind not in ("value", "tables"):
        path.write_bytes(content)
        return kind
    connection = sqlite3.connect(path)
    try:
        if kind == "tables":
            statement = choice.choice(TABLES)
            connection.executescript(statement)
        else:
            table = choice.choice([*ROWS])
            values = ["7", "-1", "NULL", "1e999", "'x'", "x'ff00'", "zeroblob(24)", "CAST(x'ff' AS TEXT)", "1e300"]
            row = f"rowid = (SELECT rowid FROM {table} ORDER BY random() LIMIT 1)"
            statement = f"UPDATE {table} SET {choice.choice(ROWS[table])} = {choice.choice(values)} WHERE {row}"
            connection.execute(statement)
            connection.commit()
    except sqlite3.Error:
        return "nothing"
    finally:
        connection.close()
    return statement


def damaged_store(seed: int) -> str:
    """How a study with a damaged store, and the command that lists it, ended."""
    choice = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "runs.db")
        expected = stored_study(path)
        how = damage(path, choice)
        told = []
        for use in (lambda: stored_study(path), lambda: symmb_runs(path)):
            try:
                result = use()
            except mb.SymmbError as error:
                told.append("a sentence" if "\n" not in str(error) else f"several lines: {error}")
                continue
            except Exception as error:
                told.append(f"{how}: {type(error).__name__}: {error}")
                continue
            if isinstance(result, mb.Bounds):
                same = (result.lower == expected.lower).all() and (result.upper == expected.upper).all()
                told.append("the same bounds" if same else f"{how}: other bounds")
        return ", ".join(sorted(set(told)))


def symmb_runs(path: Path) -> None:
    """What the command `symmb runs` reads."""
    with open_run_database(path, create=False) as database:
        for number, study, _, _ in database.studies():
            P = database.samples(number, len(study.parameters))
            database.read(number, P, (len(study.times), len(study.outputs)))


def damaged(stores: int, seed: int) -> int:
    """Print how studies with damaged stores end."""
    warnings.simplefilter("ignore")
    found = Counter(damaged_store(seed + k) for k in range(stores))
    for outcome, count in sorted(found.items()):
        print(f"{count:4}  {outcome}")
    return int(any(":" in outcome for outcome in found))


def main(kills: int) -> int:
    """Print what kills cost."""
    expected = {size: undisturbed(size) for size in SIZES}
    studies, workers, dask = Findings(), Findings(), Findings()
    while studies.kills < kills:
        for size in SIZES:
            killed_study(size, expected[size], 5, studies)
    for _ in range(max(1, kills // 10)):
        for size in SIZES:
            killed_worker(size, "processes", expected[size], workers)
        killed_worker("small", "dask", expected["small"], dask)
    for name, found in (("study", studies), ("worker", workers), ("worker of Dask", dask)):
        again = sum(found.again) / found.kills
        print(f"{name}: {found.kills} kills, {again:.1f} runs made again for each, {len(found.faults)} faults")
        for fault in found.faults[:10]:
            print(f"  {fault}")
    print(f"{studies.in_writes} kills of studies came in the middle of a write")
    return int(any(found.faults for found in (studies, workers, dask)))


if __name__ == "__main__":
    if sys.argv[1:2] == ["study"]:
        study(*sys.argv[2:])
    elif sys.argv[1:2] == ["damaged"]:
        sys.exit(damaged(*(int(text) for text in (*sys.argv[2:], *("500", "0")[len(sys.argv) - 2 :]))))
    else:
        sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 100))
