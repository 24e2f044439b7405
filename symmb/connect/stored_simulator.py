"""A simulator that stores every finished run in a file, and does not make stored runs again."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from symmb._errors import DeclarationError, WithWarnings
from symmb._options import shown
from symmb._types import Array, Executor
from symmb.connect.black_box import BlackBox, lost_runs, samples_of_block, timed_runs
from symmb.connect.identity import UndigestedError, digest
from symmb.connect.program_files import is_text
from symmb.connect.run_database import RunDatabase, StoredStudy, open_run_database, sample_keys
from symmb.connect.simulator import (
    BLOCK,
    Ensemble,
    Merging,
    Progress,
    Reduction,
    SecondLook,
    Simulator,
    blocks,
    checked_samples,
)
from symmb.connect.tasks import LostTask, finished
from symmb.equations.model import Box

S = TypeVar("S")


@dataclass(frozen=True, eq=False, repr=False)
class StoredSimulator(WithWarnings):
    """Runs of another simulator. Each run is stored in a file as soon as it ends.

    If a study is started again, only missing runs are made. A study with higher resolution, or another method, also
    uses the stored runs. Failed runs are stored with their reason. `symmb runs FILE --prune failed` removes them.
    A failed run is made again if its worker died, or if it timed out and the timeout is now longer.
    Runs are stored with a digest of the simulator's model, solver, templates or function, times and outputs.
    A Python function is identified by its code, and by the values and functions that the code uses. Python's modules
    and installed packages are identified by name. Give another `version` if a module or a package changes.

    Each sample runs alone. This is slower: without a store, eight samples of a scene are computed as one vector.

    Parameters
    ----------
    simulator : DAESimulator, FunctionSimulator, CommandSimulator, FMUSimulator, ...
    path : str or Path
        the file, an SQLite database; it is created if it does not exist
    version : str
        a text that distinguishes simulators whose other data are equal

    Raises
    ------
    DeclarationError
        If the simulator has no method `identity`. At a run, if the file is not a run store
    SimulationError
        At a run, if the file cannot be written

    Examples
    --------
    >>> import tempfile, numpy as np, symmb as mb
    >>> t, calls = np.linspace(0.0, 1.0, 3), []
    >>> decay = mb.FunctionSimulator(lambda k: calls.append(k) or np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> stored = mb.StoredSimulator(decay, tempfile.mkdtemp() + "/runs.db")
    >>> for _ in range(2):
    ...     bounds = mb.propagate(stored, mb.Vertex(), mb.Box(k=(0.5, 2.0)))
    ...     print(len(calls))
    3
    3
    """

    simulator: Simulator
    path: Path
    version: str
    identity: str
    parameters: Mapping[str, float]
    times: Array
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    box: Box | None

    def __init__(self, simulator: Simulator, path: str | Path, version: str = "") -> None:
        if isinstance(simulator, type) or not isinstance(getattr(simulator, "parameters", None), Mapping):
            raise DeclarationError(f"StoredSimulator: expected a simulator, got {shown(simulator)}.")
        if figures := getattr(getattr(simulator, "scene", None), "figures", None):
            raise DeclarationError(f"StoredSimulator: scalar outputs cannot be stored: {', '.join(figures)}.")
        if isinstance(simulator, StoredSimulator):
            raise DeclarationError(
                "StoredSimulator: the simulator is already a StoredSimulator. Give the simulator inside it."
            )
        if (identity := getattr(simulator, "identity", None)) is None:
            raise DeclarationError(
                f"StoredSimulator: {simulator!r} has no method identity(). Add this method. It must return a text with "
                "all data that affect the runs, except the parameters."
            )
        if not isinstance(path, str | Path) or not is_text(str(path)):
            raise DeclarationError(f"StoredSimulator: path must be the path of a file, got {shown(path)}.")
        if not isinstance(version, str):
            raise DeclarationError(f"StoredSimulator: version must be a text, got {shown(version)}.")
        # The digest is computed once, because a function may change an outside object, such as a list of its calls.
        try:
            key = identity()
        except UndigestedError as error:
            if not version:
                raise
            key = error.key
        vars(self).update(simulator=simulator, path=Path(path), version=version, identity=key)
        vars(self).update({name: getattr(simulator, name) for name in ("parameters", "times", "outputs")})
        vars(self).update(units=getattr(simulator, "units", ()), box=getattr(simulator, "box", None))

    def second_look(self) -> None:
        """Call `second_look` of the simulator, if it has this method. The runs of this call are not stored."""
        if isinstance(self.simulator, SecondLook):
            self.simulator.second_look()

    @property
    def noise(self) -> Array | None:
        """Errors (n_y,) of the output values; None if not known."""
        return getattr(self.simulator, "noise", None)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about the runs, as sentences."""
        return getattr(self.simulator, "doubts", ())

    def run(self, P: Array) -> Ensemble:
        """Make the runs of samples P (N, d) that are not in the file, and read all runs."""
        P = checked_samples(self, P, None)
        with open_run_database(self.path) as database:
            number = self._make(database, P, None, None)
            return database.read(number, P, (len(self.times), len(self.outputs)))

    def run_seconds(self, p: Array) -> float:
        """Duration of the run of a sample p (d,) [s]. The run is made if it is not in the file."""
        with open_run_database(self.path) as database:
            return database.seconds(self._make(database, p[None], None, None), p)

    def stream(
        self, P: Array, reduction: Reduction[S], executor: Executor | None = None, progress: Progress | None = None
    ) -> S:
        """Make the runs of samples P (N, d) that are not in the file, and reduce all runs in blocks."""
        P = checked_samples(self, P, progress)
        merging = Merging(reduction, None, P)
        with open_run_database(self.path) as database:
            number = self._make(database, P, executor, progress)
            # The same blocks as without a store, so that sums have the same last digits.
            for indices in blocks(len(P), samples_of_block(len(P)) if isinstance(self.simulator, BlackBox) else BLOCK):
                merging.reduce(database.read(number, P[indices], (len(self.times), len(self.outputs))), indices)
        return merging.state

    def _make(self, database: RunDatabase, P: Array, executor: Executor | None, progress: Progress | None) -> int:
        """Make the runs of samples P (N, d) that are not in the database, and return the number of the study."""
        names, times = tuple(self.parameters), np.ascontiguousarray(self.times)
        key = digest(self.identity, self.version, names, self.outputs, times)
        number = database.begin(StoredStudy(key, repr(self.simulator), names, self.outputs, times))
        known, missing = database.known(number, P, getattr(self.simulator, "timeout", None)), list[Array]()
        for key, p in zip(sample_keys(P), P, strict=True):
            if key not in known:
                known.add(key)
                missing.append(p[None])
        if missing:
            database.require_writable()
        done = len(P) - len(missing)
        if progress is not None and done:
            progress(done, len(P))
        for k, result in finished(partial(timed_runs, self.simulator), missing, executor):
            is_lost = isinstance(result, LostTask)
            runs, seconds = (lost_runs(self.simulator, missing[k], result.reason), 0.0) if is_lost else result
            database.add(number, missing[k][0], runs, seconds, is_lost)
            done += 1
            if progress is not None:
                progress(done, len(P))
        return number

    def __repr__(self) -> str:
        return f"StoredSimulator({self.simulator!r}, {str(self.path)!r})"
