"""An FMU, which is a model exported by another program, as a simulator."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from symmb._cleanup import real_path
from symmb._errors import DeclarationError, SimulationError
from symmb._magnitudes import SLIGHT
from symmb._names import ByName
from symmb._options import is_finite_number, require_timeout, shown
from symmb._types import Array
from symmb._units import number_in, units_of_parameters
from symmb.connect.black_box import BlackBox
from symmb.connect.fmu_description import (
    CO_SIMULATION,
    FMU,
    MODEL_EXCHANGE,
    OWNER,
    described,
    extracted,
    fmpy,
    parameters_of,
    variable_of,
)
from symmb.connect.fmu_runs import RTOL, FMURunner, steps_between
from symmb.connect.identity import digest
from symmb.connect.limited_calls import LimitedCalls

_LONG_RUN = 10.0
"""Duration of a long run [s]. Each long run gets a new process, whose start takes little time in comparison."""
_RESET, _NEW_INSTANCE, _NEW_PROCESS = "reset", "new instance", "new process"
_KINDS: dict[tuple[str, str], str] = {}
"""Digest of an FMU's file, and its interface -> a way to get repeatable runs: reset, new instance or new process."""


@dataclass(frozen=True, eq=False, repr=False)
class FMUSimulator(BlackBox):
    """Trajectories from a Functional Mock-up Unit of FMI 2 or 3. Install FMPy by `pip install 'symmb[fmu]'`.

    Runs are made in separate processes. If an FMU crashes, only one run fails. Runs of several threads are parallel.
    Each process keeps an instance, and resets the instance between two runs. The first run is repeated after a reset.
    If the outputs are not bitwise the same, each run gets a new instance. If this does not help, each run gets a new
    process. After a failed run, a new instance is made.

    Parameters
    ----------
    path : str or Path
        the .fmu file. Processes on other computers need it at the same path
    parameters : mapping
        nominal values by name of the variable, in the unit of the model description. They are set before the start
    times : (n_t,)
        increasing times of the rows [s]; the run starts at the first time
    outputs : list of str
        n_y names of variables
    fmi_type : str
        "CoSimulation" or "ModelExchange"; default: co-simulation if the FMU supports it
    step : float
        longest communication step [s]; default: the step of the FMU's default experiment, or 1/500 of the time span.
        Communication steps also end at all times of the rows. For model exchange, this is the longest step of FMPy's
        solver CVODE; default: 1/500 of the time span
    timeout : float
        longest time of a run [s]
    noise : mapping
        errors of the output values, by name of the output

    Attributes
    ----------
    units : tuple of str
        units of the outputs, from the model description; '' if not stated. A Box uses the units of the parameters

    Raises
    ------
    DeclarationError
        If the file is not an FMU that runs on this computer, a variable does not exist, is not a number or cannot be
        set, or an option is out of its range
    ImportError
        If FMPy is not installed

    Examples
    --------
    With an FMU `pendulum.fmu` that has the parameter `length` and the output `angle`::

        times = np.linspace(0.0, 2.0, 101)
        pendulum = mb.FMUSimulator("pendulum.fmu", parameters={"length": 1.0}, times=times, outputs=["angle"])
        bounds = mb.propagate(pendulum, mb.PolynomialChaos(), mb.Box(length=(0.9, 1.1)))
    """

    path: Path
    fmi_type: str
    step: float
    timeout: float | None
    units: tuple[str, ...]
    _fmu: FMU
    _calls: LimitedCalls

    def __init__(
        self,
        path: str | Path,
        parameters: Mapping[str, float],
        times: Array | Sequence[float],
        outputs: Sequence[str],
        fmi_type: str | None = None,
        step: float | None = None,
        timeout: float | None = None,
        noise: Mapping[str, float] | None = None,
    ):
        if not isinstance(path, str | Path):
            raise DeclarationError(f"{OWNER}: path must be the path of a file, got {shown(path)}.")
        self._declare(parameters, times, outputs, noise)
        require_timeout(OWNER, timeout)
        if step is not None and not (is_finite_number(step) and step > 0):
            raise DeclarationError(f"{OWNER}: step must be a number of seconds above 0, got {shown(step)}.")
        fmu, variables = described(real_path(path), fmi_type)
        inputs, given = parameters_of(fmu.path, variables, self.parameters), units_of_parameters(self.parameters)
        units, nominal = {v.name: v.unit or given.get(v.name, "") for v in inputs}, dict(self.parameters)
        for name, unit in given.items():
            if unit != units[name]:
                nominal[name] = number_in(OWNER, f"parameter {name!r}", (nominal[name], unit), units[name])
        found = tuple(variable_of(fmu.path, variables, name, "output") for name in self.outputs)
        step = _step(fmu, self.times, step)
        patience = min(_LONG_RUN, np.inf if timeout is None else timeout / 3)
        runs = FMURunner(fmu, inputs, found, self.times, step, patience)
        vars(self).update(
            path=fmu.path,
            fmi_type=fmu.fmi_type,
            step=step,
            timeout=timeout,
            units=tuple(variable.unit for variable in found),
            parameters=ByName(nominal, {name: unit for name, unit in units.items() if unit}),
            _fmu=fmu,
            _calls=LimitedCalls(runs, timeout, "the FMU"),
        )

    def response(self, values: dict[str, float]) -> Any:
        """Outputs (n_t, n_y) of a run with these parameters."""
        for variable in self._calls.f.parameters:
            fault = variable.fault_of(values[variable.name])
            if fault:
                raise SimulationError(fault)
        key = self._fmu.digest, self.fmi_type
        if key in _KINDS:
            return self._run(values, _KINDS[key])
        begin = time.perf_counter()
        result = self._run(values, _NEW_PROCESS)
        kinds = () if time.perf_counter() - begin > _LONG_RUN else (_RESET, _NEW_INSTANCE)
        _KINDS[key] = next((kind for kind in kinds if self._repeats(values, result, kind)), _NEW_PROCESS)
        return result

    def _run(self, values: dict[str, float], kind: str) -> Any:
        fmpy()  # load FMPy and its solver before a fork, so that each process has both
        if self.fmi_type == MODEL_EXCHANGE:
            fmpy("sundials")
        if kind == _NEW_PROCESS:
            self._calls.end_process()
        folder = extracted(self.path, self._fmu.digest)
        return self._calls({"values": values, "folder": folder, "again": kind == _RESET})

    def _repeats(self, values: dict[str, float], result: Array, kind: str) -> bool:
        """Whether a run is the same after a run with other parameters. Some FMUs keep earlier values, or crash."""
        whole = {variable.name for variable in self._calls.f.parameters if variable.is_whole}
        others = {name: value if name in whole else value * (1 + SLIGHT) + SLIGHT for name, value in values.items()}
        try:
            self._run(others, kind)
            return np.array_equal(self._run(values, kind), result, equal_nan=True)
        except SimulationError:
            return False

    def identity(self) -> str:
        """A digest of the file and of the way to run it, for `StoredSimulator`."""
        return digest("FMU", self._fmu.digest, self.fmi_type, self.step, RTOL)

    def __repr__(self) -> str:
        return f"FMUSimulator({self.path.name})"


def _step(fmu: FMU, times: Array, given: float | None) -> float:
    """The longest communication step [s]. DeclarationError is raised if the FMU cannot stop at the times."""
    if len(times) == 1:
        return 1.0
    own = fmu.step if fmu.fmi_type == CO_SIMULATION else None
    spans = np.diff(times)
    if fmu.grid is not None and given is None:
        step = float(spans.max())  # steps of the solver do not depend on communication steps
    else:
        step = given or own or float(times[-1] - times[0]) / 500  # as in FMPy
    if fmu.is_uniform:
        step = float(spans.min()) / steps_between(0.0, spans.min(), step)
    for length, reason in ((fmu.grid, "its solver has steps"), (step if fmu.is_uniform else None, "its steps are")):
        if length is not None and (np.abs(spans / length - np.round(spans / length)) > SLIGHT * spans / length).any():
            raise DeclarationError(
                f"{OWNER}: {fmu.path.name} cannot stop at all given times: {reason} of {length:g} s. "
                "Times, counted from the first time, must be multiples of this step."
            )
    return step
