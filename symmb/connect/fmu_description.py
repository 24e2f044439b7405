"""The model description of an FMU: version, interfaces, variables and units; and whether symmb can run the FMU.

An FMU is extracted once per process, to a folder that the process removes at its end.
"""

import os
import shutil
import threading
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from symmb._cleanup import lasting_folder
from symmb._errors import DeclarationError, SimulationError, text_of
from symmb._names import did_you_mean
from symmb._options import optional_package, shown
from symmb.connect.identity import file_digest
from symmb.connect.limited_calls import LimitedCalls, fault_text
from symmb.results.files import require_usual_size

OWNER = "FMUSimulator"
CO_SIMULATION, MODEL_EXCHANGE = "CoSimulation", "ModelExchange"
FMI_TYPES = CO_SIMULATION, MODEL_EXCHANGE
_REAL = "Real", "Float64", "Float32"
_WHOLE = {"Integer": "int32", "Enumeration": "int32"} | {
    f"{sign}Int{bits}": f"{sign}int{bits}".lower() for sign in ("", "U") for bits in (8, 16, 32, 64)
}
"""Types of FMI for integers -> NumPy's names of these types."""
_AGAINST_SCHEMA = "ERROR (line", "FATAL (line"
"""First words of FMPy's messages about the form of a description. FMPy's other messages concern the content."""
_DIMENSIONLESS = "1", "-"


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU: its name, its value reference, the type to read and write it, and its unit."""

    name: str
    reference: int
    type: str
    unit: str

    @property
    def is_whole(self) -> bool:
        return self.type in _WHOLE

    def fault_of(self, value: float) -> str:
        """The reason why the variable cannot have a value; empty if the value is valid."""
        if not self.is_whole:
            return ""
        limits = np.iinfo(_WHOLE[self.type])
        fits = value == int(value) and limits.min <= value <= limits.max
        return "" if fits else f"{self.name!r} cannot be {value:g}: it is of the type {self.type}"


@dataclass(frozen=True)
class FMU:
    """The data that a run of an FMU with one of its interfaces needs.

    Attributes
    ----------
    path, digest : the file, and the digest of its contents
    version : version of FMI, 2 or 3
    fmi_type : "CoSimulation" or "ModelExchange"
    identifier, token : the name of the library in the FMU, and the token that this library checks
    n_states, n_indicators : numbers of continuous states and of event indicators
    tells_steps : whether the FMU must be called when a step of the solver is complete
    tolerance : relative tolerance for the solver of the FMU; None: the default of the FMU
    step : step of the default experiment [s]; None if not stated
    grid : step of the solver in the FMU [s]. Communication steps must be multiples of this step; None if not stated
    is_uniform : whether all communication steps must have the same length
    """

    path: Path
    digest: str
    version: int
    fmi_type: str
    identifier: str
    token: str
    n_states: int
    n_indicators: int
    tells_steps: bool
    tolerance: float | None
    step: float | None
    grid: float | None
    is_uniform: bool


def fmpy(module: str = "") -> Any:
    """FMPy, or a module of FMPy. ImportError is raised if FMPy is not installed."""
    return optional_package(f"fmpy.{module}" if module else "fmpy", OWNER, "fmu")


def described(path: Path, fmi_type: str | None) -> tuple[FMU, dict[str, Any]]:
    """An FMU, and FMPy's descriptions of its variables by name.

    DeclarationError is raised if the file is not an FMU, lacks the interface, or has no binary for this computer.
    """
    fmpy()
    names = _files(path)
    code = file_digest(path)
    try:
        folder = extracted(path, code)  # extracted now for workers that are forked later
    except SimulationError as error:
        raise DeclarationError(f"{OWNER}: {error}.") from None
    description = _description(path, folder)
    major = str(description.fmiVersion).partition(".")[0]
    if major not in ("2", "3"):
        raise DeclarationError(f"{OWNER}: {path.name} uses FMI {description.fmiVersion}. Only 2 and 3 are supported.")
    chosen = _interface(path, description, fmi_type)
    interface = description.coSimulation if chosen == CO_SIMULATION else description.modelExchange
    _require_binary(path, names, int(major), interface.modelIdentifier)
    experiment = description.defaultExperiment
    fmu = FMU(
        path,
        code,
        int(major),
        chosen,
        interface.modelIdentifier,
        description.guid or "",
        description.numberOfContinuousStates,
        description.numberOfEventIndicators,
        bool(getattr(interface, "needsCompletedIntegratorStep", False)),
        _number(experiment and experiment.tolerance),
        _number(experiment and experiment.stepSize),
        _number(getattr(interface, "fixedInternalStepSize", None)),
        not getattr(interface, "canHandleVariableCommunicationStepSize", True),
    )
    return fmu, {variable.name: variable for variable in description.modelVariables}


def _files(path: Path) -> list[str]:
    """The names of the files in an FMU."""
    if not os.path.isfile(path):  # also if the name is too long for a file
        raise DeclarationError(f"{OWNER}: there is no file {path}.")
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            require_usual_size(archive)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise DeclarationError(f"{OWNER}: {path.name} is not an FMU, or is damaged: {text_of(error)}.") from None
    if "modelDescription.xml" not in names:
        raise DeclarationError(f"{OWNER}: {path.name} is not an FMU: it contains no modelDescription.xml.")
    return names


def _description(path: Path, folder: Path) -> Any:
    """FMPy's model description of a file that follows the schema of FMI. In other files, FMPy may miss states."""
    read = fmpy("model_description").read_model_description
    try:
        return read(str(folder))
    except Exception as error:  # a wrong file may cause any exception in FMPy
        reason = error
    problems = getattr(reason, "problems", [])
    if problems and not problems[0].startswith(_AGAINST_SCHEMA):  # other problems are harmless, such as unknown units
        return read(str(folder), validate=False)
    text = " ".join((problems or [text_of(reason)])[0].split())[:300].rstrip(".")
    raise DeclarationError(f"{OWNER}: modelDescription.xml of {path.name} cannot be read: {text}.")


def _interface(path: Path, description: Any, given: str | None) -> str:
    has = [CO_SIMULATION] * (description.coSimulation is not None)
    has += [MODEL_EXCHANGE] * (description.modelExchange is not None)
    if given is not None and given not in FMI_TYPES:
        raise DeclarationError(
            f"{OWNER}: fmi_type must be one of {', '.join(map(repr, FMI_TYPES))}, got {shown(given)}."
        )
    if not has:
        raise DeclarationError(f"{OWNER}: {path.name} supports neither co-simulation nor model exchange.")
    if given is not None and given not in has:
        raise DeclarationError(f"{OWNER}: {path.name} does not support {given}, only {has[0]}.")
    return given or has[0]


def _require_binary(path: Path, names: Sequence[str], version: int, identifier: str | None) -> None:
    module = fmpy()
    platform = module.platform if version == 2 else module.platform_tuple
    if f"binaries/{platform}/{identifier}{module.sharedLibraryExtension}" in names:
        return
    others = sorted({name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1})
    told = f"only for {', '.join(others)}" if others else "nor for any other platform"
    if platform in others:
        told = f"because its folder lacks {identifier}{module.sharedLibraryExtension}"
    sources = any(name.startswith("sources/") and name.endswith(".c") for name in names)
    remedy = f" Try to compile the sources of the FMU: python -m fmpy compile {path.name}" if sources else ""
    raise DeclarationError(f"{OWNER}: {path.name} has no binary for {platform}, {told}.{remedy}")


def _number(text: Any) -> float | None:
    """A text as a number, or None if the text is not a positive number."""
    try:
        number = float(text)
    except (TypeError, ValueError):
        return None
    return number if 0.0 < number < np.inf else None


def parameters_of(path: Path, known: Mapping[str, Any], parameters: Mapping[str, float]) -> tuple[Variable, ...]:
    """The variables of an FMU that correspond to parameters.

    DeclarationError is raised if a variable does not exist, cannot be set, or is not a number.
    """
    found = tuple(variable_of(path, known, name, "parameter") for name in parameters)
    for variable, value in zip(found, parameters.values(), strict=True):
        reason = _fixed_by(known[variable.name])
        if reason:
            raise DeclarationError(f"{OWNER}: {variable.name!r} cannot be set: {reason}.")
        if fault := variable.fault_of(value):
            raise DeclarationError(f"{OWNER}: {fault}.")
    return found


def variable_of(path: Path, known: Mapping[str, Any], name: str, role: str) -> Variable:
    """A variable of an FMU. DeclarationError is raised if the variable does not exist, or is not a number."""
    variable = known.get(name)
    if variable is None:
        raise DeclarationError(f"{OWNER}: {path.name} has no variable {name!r}.{did_you_mean(name, known)}")
    if variable.shape:
        size = " x ".join(map(str, variable.shape))
        raise DeclarationError(f"{OWNER}: {role} {name!r} is an array ({size}). Only single numbers are supported.")
    if variable.type not in (*_REAL, *_WHOLE, *(["Boolean"] if role == "output" else [])):
        raise DeclarationError(f"{OWNER}: {role} {name!r} is of the type {variable.type}. It must be a number.")
    declared = variable.declaredType and variable.declaredType.unit
    unit = variable.unit or declared or ""
    return Variable(name, variable.valueReference, variable.type, "" if unit in _DIMENSIONLESS else unit)


def _fixed_by(variable: Any) -> str:
    """The reason why a variable cannot be set before a run; empty if the variable can be set."""
    if variable.variability == "constant":
        return "it is a constant"
    if variable.causality == "structuralParameter":
        return "it is a structural parameter, which sets the size of arrays"
    if variable.causality in ("parameter", "input") or variable.initial == "exact":
        return ""
    if variable.initial == "approx":
        return "its start value is only a first guess"
    return "it is calculated by the FMU"


_EXTRACTED: dict[str, Path] = {}
_LOCK = threading.Lock()


def extracted(path: Path, code: str) -> Path:
    """The folder with the files of an FMU. Files are extracted once for this process and its forked processes.

    SimulationError is raised if the FMU cannot be extracted, or the file has changed since its declaration.
    """
    with _LOCK:
        folder = _EXTRACTED.get(code)
        if folder is not None and folder.is_dir():
            return folder
        if not path.is_file() or file_digest(path) != code:
            raise SimulationError(f"{path.name} has changed since it was declared")
        calls = _extraction()
        calls.begin()  # before the folder exists, so that a killed process does not leave the folder
        folder = lasting_folder()
        try:
            calls({"filename": str(path), "unzipdir": str(folder)})
        except SimulationError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise SimulationError(f"{path.name} cannot be extracted: {fault_text(error).rstrip('.')}") from None
        _EXTRACTED[code] = folder
        return folder


@cache
def _extraction() -> LimitedCalls:
    return LimitedCalls(fmpy().extract, None, "FMPy")
