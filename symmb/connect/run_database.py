"""The file of a run store. It is an SQLite database with each finished run of some studies."""

import json
import os
import sqlite3
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from symmb._cleanup import real_path
from symmb._errors import DeclarationError, SimulationError, text_of
from symmb._types import Array
from symmb.connect.simulator import Ensemble

STATES = "done", "failed", "timed out", "lost"
"""States of runs, by their numbers. A run is lost if its worker died."""
DONE, FAILED, TIMED_OUT, LOST = range(len(STATES))
_APPLICATION, _VERSION = int.from_bytes(b"symb"), 3
"""The mark of a run store, and the version of its tables. Files of other programs have other marks."""
_DAMAGE = sqlite3.Error, ValueError, TypeError, IndexError, OverflowError, RecursionError
"""Exceptions that damaged files cause."""
_HEADER = b"SQLite format 3\0"
_WAIT_AFTER_RUN, _WAIT_AT_FIRST = 60.0, 10.0
"""Times to wait while another study writes to the file [s]: to store a finished run, and at the start."""
_NETWORK = ("nfs", "nfs4", "cifs", "smb3", "smbfs", "lustre", "gpfs", "beegfs", "ceph", "fuse.sshfs", "afs", "9p")
"""File systems that several machines use. A write-ahead log needs shared memory, which these machines do not have."""
_SAMPLES_PER_QUERY = 500
"""Maximum number of samples in a query. SQLite supports at least 999 variables."""
_STUDY = "digest, simulator, parameters, outputs, times, begun"
_RUN = "study, sample, state, t_failed, reason, response, events, seconds"
"""Columns of a run that the checksum protects. The checksum is the last column of the table."""
_TABLES = f"""
CREATE TABLE IF NOT EXISTS studies (
    id INTEGER PRIMARY KEY, digest TEXT UNIQUE NOT NULL, simulator TEXT NOT NULL, parameters TEXT NOT NULL,
    outputs TEXT NOT NULL, times BLOB NOT NULL, begun TEXT NOT NULL, checksum INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS runs (
    study INTEGER NOT NULL REFERENCES studies(id), sample BLOB NOT NULL, state INTEGER NOT NULL, t_failed REAL,
    reason TEXT NOT NULL, response BLOB NOT NULL, events BLOB, seconds REAL NOT NULL, checksum INTEGER NOT NULL,
    UNIQUE (study, sample));
PRAGMA application_id = {_APPLICATION};
PRAGMA user_version = {_VERSION};
"""
_TABLES_OF_2 = f"""
ALTER TABLE studies RENAME TO former_studies;
ALTER TABLE runs RENAME TO former_runs;
{_TABLES}
INSERT INTO studies SELECT id, {_STUDY}, checksum({_STUDY}) FROM former_studies;
INSERT INTO runs SELECT {_RUN}, checksum({_RUN}) FROM former_runs;
DROP TABLE former_runs;
DROP TABLE former_studies;
"""
"""Conversion of files of version 2, which had no checksums."""


@dataclass(frozen=True)
class StoredStudy:
    """The data that all runs of a study have in common. `digest` identifies the simulator."""

    digest: str
    simulator: str
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    times: Array


class RunDatabase:
    """Runs of studies in a file. A run is stored permanently when `add` returns."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection, self._path = connection, path

    def begin(self, study: StoredStudy) -> int:
        """The number of a study. A new study is added to the file."""
        find = "SELECT id FROM studies WHERE digest = ?"
        with self._reading():
            if found := self._connection.execute(find, (study.digest,)).fetchone():  # no write is needed
                return found[0]
        names = json.dumps(study.parameters), json.dumps(study.outputs)
        begun = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S")
        row = study.digest, study.simulator, *names, study.times.tobytes(), begun
        with self._writing():
            new = f"INSERT OR IGNORE INTO studies ({_STUDY}, checksum) VALUES (?, ?, ?, ?, ?, ?, ?)"
            self._connection.execute(new, (*row, _checksum(*row)))
        with self._reading():
            return self._connection.execute(find, (study.digest,)).fetchone()[0]

    def known(self, study: int, P: Array, timeout: float | None = None) -> set[bytes]:
        """Keys of the samples P (N, d) with stored runs that need not be made again.

        Lost runs are made again. Runs that timed out are made again if the timeout [s] is now longer.
        """
        longest = np.inf if timeout is None else timeout
        keys = sample_keys(P)
        found: set[bytes] = set()
        for k in range(0, len(keys), _SAMPLES_PER_QUERY):
            some = keys[k : k + _SAMPLES_PER_QUERY]
            marks = ", ".join("?" * len(some))
            query = (
                f"SELECT sample FROM runs WHERE study = ? AND sample IN ({marks}) "
                f"AND state != {LOST} AND (state != {TIMED_OUT} OR seconds >= ?)"
            )
            with self._reading():
                found |= {row[0] for row in self._connection.execute(query, (study, *some, longest))}
        return found

    def require_writable(self) -> None:
        """Raise SimulationError if the file cannot be written now, because later runs would be lost."""
        with self._writing():
            self._connection.execute("BEGIN IMMEDIATE")

    def add(self, study: int, p: Array, run: Ensemble, seconds: float, is_lost: bool = False) -> None:
        """Write the run of a sample p (d,) with its duration [s], unless another study has written this run."""
        reason = "".join(run.messages)
        state = LOST if is_lost else DONE if run.ok[0] else TIMED_OUT if reason.startswith("timed out") else FAILED
        events = None if run.events is None else run.events[0].astype(np.int64).tobytes()
        t_failed = None if np.isnan(run.t_failed[0]) else float(run.t_failed[0])
        key = sample_keys(p[None])[0]
        row = study, key, state, t_failed, reason, run.Y[0].tobytes(), events, float(seconds)
        self._connection.execute(f"PRAGMA busy_timeout = {1000 * _WAIT_AFTER_RUN:.0f}")
        # Two studies may make the same run. The first result stays, so that both studies read the same numbers.
        former = f"DELETE FROM runs WHERE study = ? AND sample = ? AND state IN ({TIMED_OUT}, {LOST})"
        with self._writing():
            self._connection.execute(former, row[:2])
            self._connection.execute(
                "INSERT OR IGNORE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", (*row, _checksum(*row))
            )

    def read(self, study: int, P: Array, shape: tuple[int, int]) -> Ensemble:
        """The stored runs of samples P (N, d)."""
        rows = []
        query = f"SELECT {_RUN}, checksum FROM runs WHERE study = ? AND sample = ?"
        with self._reading():
            for key in sample_keys(P):
                own, sample, *row = _sound(self._connection.execute(query, (study, key)).fetchone())
                if (own, sample) != (study, key):
                    raise ValueError("a query returned another run than requested")
                state, t_failed, reason, response, of_events, _ = row
                rows.append((t_failed, reason, response, of_events, state))
            Y = np.array([np.frombuffer(row[2]).reshape(shape) for row in rows]).reshape(-1, *shape)
            ok = np.array([STATES[row[4]] == STATES[DONE] for row in rows], dtype=bool)
            if not np.isfinite(Y[ok]).all():
                raise ValueError("a run is stored as successful, but its values are not all finite")
            t_failed = np.array([np.nan if row[0] is None else row[0] for row in rows], dtype=float)
            events = None
            if rows and rows[0][3] is not None:
                events = np.array([np.frombuffer(row[3], dtype=np.int64) for row in rows]).astype(np.intp)
        return Ensemble(Y, ok, t_failed, tuple(str(row[1]) for row in rows if row[4] != DONE), events)

    def seconds(self, study: int, p: Array) -> float:
        """Duration of the stored run of a sample p (d,) [s]."""
        query = "SELECT seconds FROM runs WHERE study = ? AND sample = ?"
        with self._reading():
            return self._connection.execute(query, (study, *sample_keys(p[None]))).fetchone()[0]

    def studies(self) -> list[tuple[int, StoredStudy, str, tuple[int, ...]]]:
        """For each study: its number, its data, its start time, and its number of runs in each of the STATES."""
        found = []
        query = f"SELECT id, {_STUDY}, checksum FROM studies ORDER BY id"
        by_state = "SELECT state, count(*) FROM runs WHERE study = ? GROUP BY state"
        with self._reading():
            for number, *row in self._connection.execute(query).fetchall():
                key, simulator, parameters, outputs, times, begun = _sound(row)
                counts = dict(self._connection.execute(by_state, (number,)))
                names = tuple(map(str, json.loads(parameters))), tuple(map(str, json.loads(outputs)))
                study = StoredStudy(key, simulator, *names, np.frombuffer(times))
                found.append((number, study, begun, tuple(counts.get(state, 0) for state in range(len(STATES)))))
        return found

    def samples(self, study: int, d: int) -> Array:
        """Samples (N, d) of a study in the order in which they were written."""
        query = "SELECT sample FROM runs WHERE study = ? ORDER BY rowid"
        with self._reading():
            rows = self._connection.execute(query, (study,)).fetchall()
            return np.array([np.frombuffer(row[0]) for row in rows]).reshape(-1, d)

    def prune(self, states: Sequence[int], study: int | None = None) -> int:
        """Remove the runs with these states, of one study or of all studies, and return the number of removed runs."""
        marks = ", ".join("?" * len(states))
        where, values = ("", ()) if study is None else (" AND study = ?", (study,))
        with self._writing():
            count = self._connection.execute(f"DELETE FROM runs WHERE state IN ({marks}){where}", (*states, *values))
            empty = "DELETE FROM studies WHERE id NOT IN (SELECT study FROM runs)"
            self._connection.execute(empty)
        with self._writing():
            self._connection.execute("VACUUM")
        return count.rowcount

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except _DAMAGE as error:
            _require_unlocked(self._path, error)
            raise DeclarationError(f"{self._path} is damaged ({error}). Give another name.") from None

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with self._connection:
                yield
        except (sqlite3.Error, ValueError) as error:
            _require_unlocked(self._path, error)
            raise SimulationError(
                f"{self._path} cannot be written: {text_of(error)}. Earlier entries are kept."
            ) from None


@contextmanager
def open_run_database(path: Path, create: bool = True) -> Iterator[RunDatabase]:
    """The run database in a file. The file is created if it does not exist.

    DeclarationError is raised if the file is not a run store, is damaged, or cannot be opened or written.
    """
    with ExitStack() as stack:
        try:
            connection = stack.enter_context(closing(_connected(path, create)))
            _prepare(connection, path)
        except DeclarationError:
            raise
        except (*_DAMAGE, OSError) as error:
            _require_unlocked(path, error)
            raise DeclarationError(f"{path} cannot be used as a run store: {text_of(error)}.") from None
        yield RunDatabase(connection, path)


def _connected(path: Path, create: bool) -> sqlite3.Connection:
    """A connection to an SQLite database. The file may also be empty or new."""
    size = path.stat().st_size if path.exists() else 0
    if not size and not create:
        raise DeclarationError(f"{path} does not exist, or is empty.")
    is_store = not path.exists() or path.is_file()  # another study may create the file meanwhile
    if size and is_store:
        with path.open("rb") as file:
            is_store = file.read(len(_HEADER)) == _HEADER
    if not is_store:
        raise DeclarationError(f"{path} is not a run store. Give another name.")  # SQLite would overwrite short files
    if size and not _is_writable(path):
        log = Path(f"{path}-wal")  # the log of a killed study
        options = "mode=ro" if log.exists() and log.stat().st_size else "mode=ro&immutable=1"
        return sqlite3.connect(f"{real_path(path).as_uri()}?{options}", timeout=_WAIT_AT_FIRST, uri=True)
    return sqlite3.connect(path, timeout=_WAIT_AT_FIRST)


def _prepare(connection: sqlite3.Connection, path: Path) -> None:
    """Check that a database is a run store. Make a new database a run store."""
    is_new = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
    mark = connection.execute("PRAGMA application_id").fetchone()[0]
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    if not is_new and mark != _APPLICATION:
        raise DeclarationError(f"{path} is a database of another program. Give another name.")
    if not is_new and version not in (2, _VERSION):
        raise DeclarationError(f"{path} was written by another version of symmb. Give another name.")
    connection.create_function("checksum", -1, _checksum, deterministic=True)
    if _is_writable(path):
        _choose_journal(connection, "DELETE" if _is_on_network(path) else "WAL")
        connection.execute("PRAGMA synchronous = NORMAL")
    if is_new or version == 2:
        connection.executescript(f"BEGIN IMMEDIATE; {_TABLES if is_new else _TABLES_OF_2} COMMIT;")
    with closing(sqlite3.connect(":memory:")) as plain:
        plain.executescript(_TABLES)
        if _schema(connection) != _schema(plain):  # a query may never end if a view replaces a table
            raise DeclarationError(f"{path} is damaged (its tables are not those of a run store). Give another name.")


def _is_writable(path: Path) -> bool:
    """Whether the folder and the file can be written. SQLite also writes a log to the folder."""
    return os.access(path.parent, os.W_OK) and (os.access(path, os.W_OK) or not path.exists())


def _choose_journal(connection: sqlite3.Connection, mode: str) -> None:
    """Set the journal mode of a database. If another process sets the mode, wait, because SQLite does not wait."""
    deadline = time.monotonic() + _WAIT_AT_FIRST
    while True:
        try:
            connection.execute(f"PRAGMA journal_mode = {mode}")
            return
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > deadline:
                raise
        time.sleep(0.01)


def _require_unlocked(path: Path, error: Exception) -> None:
    """Raise SimulationError if an error says that another program has locked a database."""
    if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_BUSY:
        raise SimulationError(f"{path} is locked by another program. Try again when that program has ended.") from None


def _schema(connection: sqlite3.Connection) -> list[Any]:
    """The definitions of the tables of a database, in SQL."""
    return connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master ORDER BY name").fetchall()


def _checksum(*values: Any) -> int:
    """The checksum of a row."""
    total = 0
    for value in values:
        content = value if isinstance(value, bytes) else repr(value).encode()
        total = zlib.crc32(content, zlib.crc32(str(len(content)).encode(), total))
    return total


def _sound(row: Sequence[Any]) -> Sequence[Any]:
    """A row without its checksum. ValueError is raised if the checksum is wrong."""
    *values, checksum = row
    if checksum != _checksum(*values):
        raise ValueError("a row has a wrong checksum")
    return values


def sample_keys(P: Array) -> list[bytes]:
    """Keys of samples P (N, d): the bytes of their numbers."""
    return [row.tobytes() for row in np.ascontiguousarray(P, dtype=float) + 0.0]  # no -0


def _is_on_network(path: Path) -> bool:
    """Whether a file is on a network file system."""
    try:
        mounts = Path("/proc/mounts").read_text(encoding="utf-8").splitlines()
    except OSError:
        return False
    place, best, kind = f"{real_path(path).parent}/", "", ""
    for mount in mounts:
        where, what = mount.split()[1:3]
        where = where.replace("\\040", " ").rstrip("/") + "/"
        if place.startswith(where) and len(where) >= len(best):
            best, kind = where, what
    return kind in _NETWORK
