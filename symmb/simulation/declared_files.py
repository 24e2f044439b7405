"""Files that must stay as they were when a simulator was declared."""

from collections.abc import Iterable
from pathlib import Path

from symmb._errors import SimulationError
from symmb.simulation.identity import file_digest

Stamp = tuple[tuple[str, int, int], ...]


class ChangedFileError(SimulationError):
    """A file has changed: the study ends, as its runs would not belong together."""


class DeclaredFiles:
    """Files and folders as they are now, by their contents."""

    def __init__(self, paths: Iterable[Path]) -> None:
        self._declared = {path: (_stamp(path), file_digest(path)) for path in paths}

    def digests(self) -> list[tuple[str, str]]:
        """Names and digests of the contents."""
        return [(path.name, content) for path, (_, content) in self._declared.items()]

    def require_same(self) -> None:
        """ChangedFileError if a file has other contents. Files of the same size and date are not read."""
        for path, (stamp, content) in self._declared.items():
            try:
                is_same = _stamp(path) == stamp or file_digest(path) == content
            except OSError:
                is_same = False
            if not is_same:
                raise ChangedFileError(f"{path} has changed since the simulator was declared; declare it anew.")


def _stamp(path: Path) -> Stamp:
    files = [path, *path.rglob("*")] if path.is_dir() else [path]
    states = [(file, file.stat()) for file in files if file.is_file()]  # links may lead nowhere
    return tuple(sorted((str(file), state.st_size, state.st_mtime_ns) for file, state in states))
