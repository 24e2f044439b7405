"""An instance of an FMU in a separate process: functions to make, start and read an instance, and its messages."""

import ctypes
import faulthandler
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

from symmb._errors import SimulationError
from symmb._types import Array
from symmb.connect.fmu_description import CO_SIMULATION, FMU, Variable, fmpy

ENDED = "the FMU ended the run"
_LOG: dict[str, str] = {}
"""The first error and the last warning that FMUs logged during this run."""


class Status(IntEnum):
    """Status of calls in FMI 2 and 3. DISCARD: the call has no effect. FATAL: no further call is allowed."""

    WARNING = 1
    DISCARD = 2
    FATAL = 4


class Instance:
    """A running model. It has the same methods for FMI 2 and 3, and for co-simulation and model exchange."""

    def __init__(self, fmu: FMU, folder: Path, logs: bool) -> None:
        self.has_states = fmu.fmi_type != CO_SIMULATION
        self.version, self._tolerance = fmu.version, fmu.tolerance
        arguments = {"guid": fmu.token, "modelIdentifier": fmu.identifier, "unzipDirectory": str(folder)}
        module = fmpy(f"fmi{fmu.version}")
        self.model = getattr(module, f"FMU{fmu.version}{'Model' if self.has_states else 'Slave'}")(**arguments)
        if fmu.version == 2:
            self.model.instantiate(callbacks=_callbacks(), loggingOn=logs)
        else:
            self.model.instantiate(logMessage=_note, loggingOn=logs)

    def initialize(self, variables: Sequence[Variable], values: Mapping[str, float], times: Array) -> None:
        """Set variables, and find the initial state."""
        stop = float(times[-1]) if len(times) > 1 else None
        span: dict[str, Any] = {"startTime": float(times[0]), "stopTime": stop}
        if not self.has_states:
            span["tolerance"] = self._tolerance
        if self.version == 2:
            self.model.setupExperiment(**span)
            span = {}
        for variable in variables:
            value = values[variable.name]
            number = int(value) if variable.is_whole else value
            getattr(self.model, f"set{self._accessor(variable.type)}")([variable.reference], [number])
        self.model.enterInitializationMode(**span)
        self.model.exitInitializationMode()

    def advance(self, t: float, length: float) -> None:
        """Make one communication step."""
        if self.version == 2:
            try:
                self.model.doStep(t, length)
            except Exception as error:
                ended = fmpy("fmi2").fmi2Terminated
                if getattr(error, "status", None) == Status.DISCARD and self.model.getBooleanStatus(ended):
                    raise SimulationError(ENDED) from None
                raise
        else:
            _, ends, returned, _ = self.model.doStep(t, length)
            if ends or returned:
                raise SimulationError(ENDED)

    def reader(self, variables: Sequence[Variable]) -> Callable[[Array], None]:
        """A function that reads the values of these variables into a row (n_y,)."""
        kinds: dict[str, list[int]] = {}
        for k, variable in enumerate(variables):
            kinds.setdefault(self._accessor(variable.type), []).append(k)
        calls = [
            (getattr(self.model, f"get{kind}"), [variables[k].reference for k in columns], columns)
            for kind, columns in kinds.items()
        ]

        def read(row: Array) -> None:
            for get, references, columns in calls:
                row[columns] = get(references)

        return read

    def _accessor(self, kind: str) -> str:
        """The FMI type in the names of the functions that read and write a variable of this kind."""
        return kind if kind != "Enumeration" else "Integer" if self.version == 2 else "Int64"

    def free(self) -> None:
        """Release the instance and its library."""
        with suppress(Exception):  # the instance may be broken
            self.model.freeInstance()


def is_fatal(error: BaseException) -> bool:
    """Whether no further call of the instance is allowed after this exception."""
    return getattr(error, "status", None) == Status.FATAL


def listen() -> None:
    """Forget earlier messages, and write the output of FMUs and FMPy in this process to a file, not to the screen."""
    _LOG.clear()
    output = _output()
    os.ftruncate(output, 0)
    os.lseek(output, 0, os.SEEK_SET)


@cache
def _output() -> int:
    """The descriptor of a file for the output of this process. The output of FMUs and of FMPy goes to this file."""
    faulthandler.disable()
    file = tempfile.TemporaryFile()
    for number in (1, 2):
        os.dup2(file.fileno(), number)
    sys.stdout = sys.stderr = open(1, "w", closefd=False, errors="replace", buffering=1)
    return os.dup(file.fileno())


def has_error() -> bool:
    """Whether an FMU has logged an error during this run."""
    return "error" in _LOG


def logged() -> str:
    """The first error that an FMU has logged during this run, or else the last warning."""
    return _short(_LOG.get("error") or _LOG.get("warning", ""))


def last_line() -> str:
    """The last line that this process has printed during this run."""
    sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)
    output = _output()
    end = os.lseek(output, 0, os.SEEK_END)
    text = os.pread(output, 4096, max(0, end - 4096)).decode(errors="replace")
    lines = [line for line in text.split("\n") if line.strip()]
    return _short(lines[-1]) if lines else ""


def _short(text: str, most: int = 200) -> str:
    """A message in one line of at most `most` characters."""
    return " ".join(text.split())[:most].rstrip(".")


def _note(*arguments: Any) -> None:
    """Store a message of an FMU. In FMI 2 and 3 the last arguments are status, category and text."""
    status, _, message = arguments[-3:]
    text = (message or b"").decode(errors="replace")
    if status > Status.WARNING:
        _LOG.setdefault("error", text)
    elif status == Status.WARNING:
        _LOG["warning"] = text


@cache
def _callbacks() -> Any:
    """Callback functions of FMI 2. FMPy's C code keeps a pointer to the last logger."""
    module = fmpy("fmi2")
    callbacks = module.fmi2CallbackFunctions()
    callbacks.logger = module.fmi2CallbackLoggerTYPE(_note)
    callbacks.allocateMemory = module.fmi2CallbackAllocateMemoryTYPE(fmpy().calloc)
    callbacks.freeMemory = module.fmi2CallbackFreeMemoryTYPE(fmpy().free)
    with suppress(OSError):  # on common platforms, C code of FMPy inserts values into messages
        fmpy("logging").addLoggerProxy(ctypes.byref(callbacks))
    return callbacks
