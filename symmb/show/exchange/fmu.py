"""Scenes for other programs: FMUs for FMI 2 and 3, and C source of runs with a main program."""

import platform
import re
import sys
import zipfile
from pathlib import Path

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._options import shown
from symmb.equations.model import Scene
from symmb.results.files import replacement, require_suffix
from symmb.run.codegen import C_FOLDER, c_source, portable_library, require_compiler, scene_source
from symmb.run.simulation import DAESimulator
from symmb.show.exchange.description import BINARY_FILES, build_description, description
from symmb.show.exchange.exported import exported

_SYSTEMS = {"linux": ("linux", "linux", ".so"), "darwin": ("darwin", "darwin", ".dylib")}
"""Names of operating systems in FMI 2 and in FMI 3, and the suffix of libraries."""


@kept_interrupts()
def save_fmu(scene: Scene | DAESimulator, path: str | Path, version: int = 3) -> None:
    """Write a scene as an FMU for co-simulation. Without constraints and impacts, it also supports model exchange.

    Programs can set its parameters, and read its outputs. Co-simulation runs the scene as in studies, with its events,
    in compiled C. The start is computed from the parameters. The tolerance determines the steps, independently of
    communication steps. The FMU contains its C sources. Their compilation needs neither symmb nor Python.

    Parameters
    ----------
    scene : Scene
        a scene; pilot runs select its solver. Or a prepared scene with the solver DormandPrince, EventDriven or
        Rosenbrock
    path : path
        `.fmu`
    version : int
        version of FMI: 2 or 3

    Raises
    ------
    DeclarationError
        If a part of the scene needs Python, two variables have the same name, or the version or suffix is unknown
    AssemblyError
        If the scene cannot be started
    NoCompilerError
        If no C compiler for the binary is installed
    FileError
        If the file cannot be written. A previous file is kept

    Examples
    --------
    >>> import tempfile, zipfile
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), times=[0.0, 1.0], outputs={"height": ball.y})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     mb.save_fmu(fall, f"{folder}/fall.fmu")
    ...     "sources/scene.c" in zipfile.ZipFile(f"{folder}/fall.fmu").namelist()
    True

    References
    ----------
    Modelica Association (2022), Functional Mock-up Interface Specification 3.0, and version 2.0.4.
    """
    if not isinstance(version, int) or version not in (2, 3):
        raise DeclarationError(f"save_fmu: version must be 2 or 3, a version of FMI, got {shown(version)}.")
    require_suffix(path, ".fmu")
    require_compiler("The export of an FMU")
    model = exported(scene)
    identifier = re.sub(r"\W+", "_", model.name, flags=re.ASCII).strip("_") or "scene"
    identifier = f"scene_{identifier}" if identifier[0].isdigit() else identifier
    files = {"modelDescription.xml": description(model, version, identifier)}
    texts = scene_source(model.source)
    texts["fmi.c"] = '#include "scene.h"\n' + c_source("fmu", f"fmi{version}")
    files |= {f"sources/{name}": text.encode() for name, text in texts.items()}
    if version == 3:
        files["sources/buildDescription.xml"] = build_description(identifier)
    of_two, of_three, suffix = _SYSTEMS["darwin" if sys.platform == "darwin" else "linux"]
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    folder = f"{of_two}64" if version == 2 else f"{machine}-{of_three}"
    files[f"binaries/{folder}/{identifier}{suffix}"] = portable_library(texts, BINARY_FILES)
    with replacement(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            # Files of a ZipInfo have the date 1980-01-01. The same scene thus always gives the same FMU.
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)


def save_scene_c(scene: Scene | DAESimulator, folder: Path) -> tuple[Path, ...]:
    """Write scene.h, scene.c and main.c to an existing folder. main.c runs the scene over its times.

    DeclarationError is raised if a part of the scene needs Python.
    """
    model = exported(scene)
    texts = scene_source(model.source) | {"main.c": (C_FOLDER / "main.c").read_text(encoding="utf-8")}
    for name, text in texts.items():
        with replacement(folder / name) as file:
            file.write(text.encode())
    return tuple(folder / name for name in texts)
