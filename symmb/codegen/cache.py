"""The user's cache folder of built libraries: nothing is taken from it that is damaged or that others can write to.

A library is one file, `<key>-<SHA-256 of its bytes>.so`: moved into place whole, and its bytes are compared with its
name before it is loaded, because loading half a file may end the process instead of raising. Sources of large models,
`.c`, are kept in the same way, as they take seconds to write.
"""

import hashlib
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from symmb._errors import SymmbError

_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class UnsafeFolderError(SymmbError):
    """Others can write to a folder that libraries would be loaded from."""


def folder() -> Path:
    """The cache folder, made if it is missing; no symbolic link on the way to it.

    Raises
    ------
    UnsafeFolderError      if others can write to it, or replace it by way of the folders above it
    SymmbError             if there is no place for one
    OSError                if it cannot be made
    """
    if os.name != "posix":
        raise SymmbError("Models are compiled, and kept, on Linux and macOS only.")
    cache_home = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = Path(cache_home) if os.path.isabs(cache_home) else Path.home() / ".cache"
    except RuntimeError:
        raise SymmbError("Built models are not kept: no home folder found. Set HOME or XDG_CACHE_HOME.") from None
    root.mkdir(parents=True, mode=0o700, exist_ok=True)
    (root / "symmb").mkdir(mode=0o700, exist_ok=True)
    path = (root / "symmb").resolve()
    check_folder(path, "XDG_CACHE_HOME")
    return path


def check_folder(path: Path, variable: str) -> None:
    """See to it that nobody else can put files into a folder (absolute, no links), which a variable can set elsewhere.

    It must be the user's own and closed to the writing of others. The folders above must be the user's or root's, and
    closed too or sticky like /tmp, where others cannot rename what is not theirs.

    Raises
    ------
    UnsafeFolderError
    """
    for place in (path, *path.parents):
        status = place.stat()
        owners, exempt = ((os.getuid(),), 0) if place == path else ((os.getuid(), 0), stat.S_ISVTX)
        if status.st_uid not in owners:
            raise UnsafeFolderError(
                f"{path} is not used for built models: {place} belongs to another user. Set {variable} elsewhere."
            )
        if status.st_mode & _WRITABLE_BY_OTHERS and not status.st_mode & exempt:
            raise UnsafeFolderError(
                f"{path} is not used for built models: others can write to {place}. "
                f"Delete what you do not know in it and close it (chmod go-w), or set {variable} elsewhere."
            )


def find(key: str, suffix: str = ".so") -> Path | None:
    """The whole file of a key, or None; those that are damaged or open to others are removed."""
    with suppress(OSError, SymmbError):
        for path in folder().glob(f"{key}-*{suffix}"):
            if _is_whole(path):
                return path
            path.unlink()
    return None


def keep(key: str, content: bytes, suffix: str = ".so") -> None:
    """Put a file into the cache, where that is possible."""
    with suppress(OSError, SymmbError):
        place = folder()
        handle, part = tempfile.mkstemp(suffix=".part", dir=place)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            os.replace(part, place / f"{key}-{hashlib.sha256(content).hexdigest()}{suffix}")
        except BaseException:
            os.unlink(part)
            raise


def is_noted(key: str) -> bool:
    """Whether the cache holds a note of this key, which says yes to a question that takes long to answer."""
    with suppress(OSError, SymmbError):
        return (folder() / f"{key}.note").is_file()
    return False


def note(key: str) -> None:
    """Put a note into the cache, where that is possible."""
    with suppress(OSError, SymmbError):
        (folder() / f"{key}.note").touch(mode=0o600)


def contents() -> tuple[Path, ...]:
    """The libraries in the cache folder, sources, notes, and what killed processes left of some."""
    kinds = (".so", ".c", ".part", ".note")
    return tuple(path for path in sorted(folder().iterdir()) if path.suffix in kinds and not path.is_dir())


def _is_whole(path: Path) -> bool:
    """Whether a file is the user's own, closed to others, no link, and holds what its name says."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & _WRITABLE_BY_OTHERS:
            return False
        return path.stem.rpartition("-")[2] == hashlib.sha256(file.read()).hexdigest()
