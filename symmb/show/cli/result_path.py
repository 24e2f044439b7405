"""Files of results. Paths are checked before the work, and files are written after it."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from symmb._errors import DeclarationError
from symmb.results.files import require_suffix, save_json
from symmb.results.plot import PICTURES
from symmb.show.drawing import FORMATS

_SUFFIXES = {
    "json": (".json",),
    "save": (".npz", ".json"),
    "csv": (".csv",),
    "plot": PICTURES,
    "view": FORMATS,
    "report": (".html",),
}
"""Options that name files of results, and their suffixes."""


def result_paths(options: argparse.Namespace) -> dict[str, Path]:
    """The requested files of results, by their options. DeclarationError is raised as by `result_path`."""
    paths = {name: result_path(getattr(options, name, None), *suffixes) for name, suffixes in _SUFFIXES.items()}
    return {name: path for name, path in paths.items() if path is not None}


def write_results(paths: Mapping[str, Path], result: Any, more: Mapping[str, Any] = {}, drawn: Any = None) -> None:
    """Write the requested files of a result. JSON also has the entries `more`. A given `drawn` is drawn instead."""
    if "json" in paths:
        save_json(paths["json"], result.to_json() | more)
    for name in {"csv", "save"} & {*paths}:
        result.save(paths[name])
    if "plot" in paths:
        (drawn or result).plot(paths["plot"])


def result_path(name: str | None, *suffixes: str) -> Path | None:
    """The path of a file for a result; None if the name is None.

    DeclarationError is raised if the path is a folder, its folder does not exist, or its suffix is not allowed.
    """
    if name is None:
        return None
    path = Path(name)
    if path.is_dir() or not path.parent.is_dir():
        raise DeclarationError(f"Cannot write {name}: it is a folder, or its folder does not exist. Give another name.")
    if path.suffix or ".json" not in suffixes:  # /dev/stdout receives JSON
        require_suffix(path, *suffixes)
    return path
