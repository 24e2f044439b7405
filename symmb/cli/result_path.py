"""Paths of results, checked before the work."""

from pathlib import Path

from symmb._errors import DeclarationError
from symmb.files import require_suffix


def result_path(name: str | None, *suffixes: str) -> Path | None:
    """The path of a result, or None for None.

    Raises
    ------
    DeclarationError    if it is a folder, its folder does not exist, or its suffix is not one of those given
    """
    if name is None:
        return None
    path = Path(name)
    if path.is_dir() or not path.parent.is_dir():
        raise DeclarationError(f"Cannot write {name}: it is a folder, or its folder does not exist.")
    if path.suffix or ".json" not in suffixes:  # /dev/stdout takes JSON
        require_suffix(path, *suffixes)
    return path
