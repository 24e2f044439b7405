"""The user's cache folder of libraries. Files that are damaged, or that others can write to, are not used.

A library is one file, `<key>-<SHA-256 of its bytes>.so`, which is moved into place when it is complete. The bytes are
compared with this name before the library is loaded, because an incomplete library may crash the process. Sources of
large models are stored in the same way as files `.c`, because their generation takes seconds, engines that many models
share as files `.o`, and modules of live pages as files `.wasm`. If all files together are larger than `LARGEST`, the
files that were not used for the longest time are removed.
"""

import hashlib
import os
import re
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from symmb._errors import SymmbError

_OWN = re.compile(r"[0-9a-f]{32}(-[0-9a-f]{64}\.(so|o|c|wasm|cubin)|-\w+\.part|\.note)")
"""Names of files of the cache. The folder may contain other files."""
LARGEST = 2**30
"""Maximum size of the cache [bytes], for about 10,000 models of 100 kB. Files above this size are removed."""
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class UnsafeFolderError(SymmbError):
    """Other users can write to a folder of libraries, so that the process could load the code of these users."""


def folder() -> Path:
    """Path of the cache folder, without symbolic links. The folder is created if it is missing.

    Raises
    ------
    UnsafeFolderError      if others can write to the folder, or can replace it or a folder above it
    SymmbError             if there is no home folder
    OSError                if the folder cannot be created
    """
    if os.name != "posix":
        raise SymmbError("Compiled models are stored on Linux and macOS only.")
    cache_home = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = Path(cache_home) if os.path.isabs(cache_home) else Path.home() / ".cache"
    except RuntimeError:
        raise SymmbError(
            "Compiled models cannot be stored: no home folder found. Set HOME or XDG_CACHE_HOME."
        ) from None
    root.mkdir(parents=True, mode=0o700, exist_ok=True)
    (root / "symmb").mkdir(mode=0o700, exist_ok=True)
    path = (root / "symmb").resolve()
    check_folder(path, "XDG_CACHE_HOME")
    return path


def check_folder(path: Path, variable: str) -> None:
    """Raise UnsafeFolderError if others can put files into a folder. `path` is absolute and has no links.

    The folder must belong to the user, and only the user may write to it. The folders above must belong to the user or
    to root. Others must not write to these folders, except to sticky folders such as /tmp, in which others cannot
    rename the user's files.
    """
    for place in (path, *path.parents):
        status = place.stat()
        owners, exempt = ((os.getuid(),), 0) if place == path else ((os.getuid(), 0), stat.S_ISVTX)
        if status.st_uid not in owners:
            raise UnsafeFolderError(
                f"{path} is not used for compiled models: {place} belongs to another user. "
                f"Set {variable} to another folder."
            )
        if status.st_mode & _WRITABLE_BY_OTHERS and not status.st_mode & exempt:
            raise UnsafeFolderError(
                f"{path} is not used for compiled models: others can write to {place}. Delete unknown files in it and "
                f"remove their permission (chmod go-w), or set {variable} to another folder."
            )


def find(key: str, suffix: str = ".so") -> Path | None:
    """The complete file of a key, or None. Files that are damaged or that others can write to are removed."""
    with suppress(OSError, SymmbError):
        for path in folder().glob(f"{key}-*{suffix}"):
            if _is_whole(path):
                os.utime(path)  # files that are not used get older than this one, and are removed first
                return path
            path.unlink()
    return None


def keep(key: str, content: bytes, suffix: str = ".so") -> None:
    """Put a file into the cache, if that is possible."""
    with suppress(OSError, SymmbError):
        place = folder()
        handle, part = tempfile.mkstemp(prefix=f"{key}-", suffix=".part", dir=place)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            os.replace(part, place / f"{key}-{hashlib.sha256(content).hexdigest()}{suffix}")
        except BaseException:
            os.unlink(part)
            raise
        _trim()


def _trim() -> None:
    """Remove the files that were not used for the longest time, if all files together are too large."""
    found = sorted(((path, path.lstat()) for path in contents()), key=lambda each: each[1].st_mtime, reverse=True)
    size = 0
    if sum(status.st_size for _, status in found) > LARGEST:
        for path, status in found:
            size += status.st_size
            if size > 0.9 * LARGEST:  # a smaller size, so that not every new model removes files
                path.unlink(missing_ok=True)


def is_noted(key: str) -> bool:
    """Whether the cache contains a note with this key. A note says that a long test has succeeded."""
    with suppress(OSError, SymmbError):
        return (folder() / f"{key}.note").is_file()
    return False


def note(key: str) -> None:
    """Put a note into the cache, if that is possible."""
    with suppress(OSError, SymmbError):
        (folder() / f"{key}.note").touch(mode=0o600)


def contents() -> tuple[Path, ...]:
    """The libraries, engines, sources and notes in the cache folder, and incomplete files of killed processes."""
    return tuple(path for path in sorted(folder().iterdir()) if _OWN.fullmatch(path.name) and not path.is_dir())


def _is_whole(path: Path) -> bool:
    """Whether only the user owns and can write a file, the file is not a link, and its contents fit its name."""
    # All checks use the open file: a path could lead to another file between a check and the reading. Without
    # O_NONBLOCK, the process would wait forever for a pipe that another user puts there.
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & _WRITABLE_BY_OTHERS:
            return False
        return path.stem.rpartition("-")[2] == hashlib.sha256(file.read()).hexdigest()
