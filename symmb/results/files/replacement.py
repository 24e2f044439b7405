"""Files that replace previous files when they are complete, errors about files, and suffixes of names."""

import os
import stat
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from symmb._cleanup import temporary_file
from symmb._errors import DeclarationError, FileError, MissingFileError, text_of
from symmb._options import shown


@contextmanager
def told(path: str | os.PathLike[str], what: str) -> Iterator[None]:
    """Convert errors of the operating system to a FileError that names the file. `what` is "read" or "written"."""
    try:
        if what == "read" and stat.S_IFMT(mode := os.stat(path).st_mode) not in (stat.S_IFREG, stat.S_IFDIR):
            kind = "pipe" if stat.S_ISFIFO(mode) else "device"
            raise FileError(f"{str(path)!r} cannot be read: it is a {kind}, so reading might never end.")
        yield
    except (FileError, BrokenPipeError):  # e.g. the reader `head` has closed the pipe
        raise
    except UnicodeEncodeError as error:
        raise FileError(f"{shown(str(path))} cannot be {what}: this is not the name of a file.") from error
    except OSError as error:
        kind = MissingFileError if isinstance(error, FileNotFoundError) else FileError
        raise kind(f"{str(path)!r} cannot be {what}: {error.strerror or text_of(error)}.") from error


@contextmanager
def replacement(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A binary file to write to, which replaces the file at ``path`` if the block ends without an exception.

    During the block, the data are in a temporary file in the same folder. If the process is killed or the disk is full,
    the previous file is kept. Links are followed, and permissions are kept. Devices and pipes are written directly.
    FileError is raised if the disk is full, or if the folder is not writable.
    """
    with told(path, "written"), _replacement(path) as file:
        yield file


@contextmanager
def _replacement(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    place = Path(os.path.realpath(path))
    previous = _mode(place)
    if previous is not None and not stat.S_ISREG(previous):
        with open(path, "wb") as file:
            yield file
        return
    part = place.with_name(f".symmb-{uuid.uuid4().hex}.part")
    with temporary_file(part):
        with open(part, "xb") as file:
            if previous is not None:
                os.chmod(part, stat.S_IMODE(previous))
            yield file
            file.flush()
            os.fsync(file.fileno())
        # The data are on the disk before the name changes. Otherwise a power failure may leave an empty file.
        os.replace(part, place)


def _mode(place: Path) -> int | None:
    try:
        return place.stat().st_mode
    except FileNotFoundError:
        return None


def require_suffix(path: str | os.PathLike[str], *allowed: str) -> str:
    """The suffix of a file's name, in lower case. DeclarationError if the suffix is not in `allowed`."""
    if not isinstance(path, str | Path | os.PathLike) or "\0" in str(path):
        raise DeclarationError(f"The name of a file must be a text or a Path, got {shown(path)}.")
    suffix = Path(path).suffix.lower()
    if suffix not in allowed:
        raise DeclarationError(f"The name of a file must end in {' or '.join(allowed)} here, got {str(path)!r}.")
    return suffix
