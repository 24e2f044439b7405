"""Parameters of a scene from measured outputs, by least squares."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from symmb._errors import DeclarationError, WithWarnings, warn_of
from symmb._interrupts import kept_interrupts
from symmb._labelled import Counted, Labelled, Result, over_parameters, texts
from symmb._names import ByName, counted
from symmb._options import is_finite_number, require_truth, shown
from symmb._types import Array, Figure
from symmb._units import label, told_units, units_of_parameters
from symmb.connect import Simulator
from symmb.equations.model import Box, Scene, with_some_outputs
from symmb.results import plot
from symmb.results.files import NOT_KEPT, Record, Saved, entry
from symmb.run.integrate import Solver
from symmb.run.simulation import Subject, chosen_parameters
from symmb.study.best_fit import best_fit
from symmb.study.consistent import ConsistentSet, consistent_set, errors_of
from symmb.study.measurements import OWNER, limits_of, measured_values, noise_of_outputs, priors_of, with_signs
from symmb.study.residuals import Residuals

_LEAST_COMPONENT = 0.05
"""A parameter is undetermined if its component in an undetermined combination exceeds this value."""

_VAGUE = 1e3
"""Standard deviation of an estimate beside the larger of its absolute value and its nominal value, above which it has a
warning. Linear confidence intervals mean nothing there."""


def _series(record: Record, name: str) -> dict[str, Array]:
    """The numbers (n,) of each output with data, one for each of its times."""
    own, times = record.record(name), record.record("data_times")
    return {output: own.array(output, times.length(output)) for output in record.numbers("noise")}


def _limits(record: Record, name: str) -> dict[str, Array]:
    """Limits (2,) of parameters. Missing limits are nan in JSON."""
    own = record.record(name)
    ends = {key: own.with_nan(key, 2) for key in own.plain}
    return {key: np.where(np.isnan(both), [-np.inf, np.inf], both) for key, both in ends.items()}


def _sentences(record: Record, name: str) -> tuple[str, ...]:
    """Warnings. Files of earlier versions have no warnings apart from those about undetermined quantities."""
    return record.texts(name, default=record.texts("undetermined", default=()))


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(plot.OverTimeBesideGiven, Counted, Result, WithWarnings, Saved):
    """Estimates of parameters from data, and their accuracy.

    `print` shows the estimates, `plot` draws the data and the fitted run. `save` writes a file, and `load` reads it.

    Attributes
    ----------
    name : str
        name of the scene
    parameters : dict
        n_p estimates by name
    covariance : (n_p, n_p)
        covariance of the estimates, for independent, normal errors of the data. If the data do not determine a
        parameter, or its estimate is at a limit, its variance is inf, and its covariances are nan
    noise : dict
        output -> standard deviation of the data, given or estimated, but not below the error of the runs
    times, data, residuals : dict
        output -> (n,) times [s], data, and data minus the outputs of the fitted run
    degrees : int
        degrees of freedom: number of values and priors minus number of determined quantities; 0 if the noise was given
    undetermined : tuple of str
        sentences about quantities that the data do not determine, and estimates at a limit
    doubts : tuple of str
        warnings: undetermined quantities, and residuals that are not noise. Estimates may then be wrong
    evaluations, runs : int
        number of runs with derivatives
    units : tuple of str
        units of the outputs, '' if not known
    priors : dict
        parameter -> value and standard deviation (2,) known before the fit
    limits : dict
        parameter -> limits (2,) of the search and of `box`: those of ``calibrate(box=)``, and limits of masses and
        other numbers that cannot be negative
    study : Residuals
        the runs of the scene, for `consistent`; None if read from a file

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> data = {"x": ([0.5, 1.0, 1.5, 2.0], [0.5403, -0.4161, -0.9900, -0.6536])}
    >>> fit = mb.calibrate(scene, data, ["k"])
    >>> round(fit.parameters["k"], 2)
    4.0
    """

    name: str
    parameters: dict[str, float]
    covariance: Array = field(metadata=entry(Record.covariance, "parameters"))
    noise: dict[str, float]
    times: dict[str, Array] = field(metadata=entry(_series, name="data_times"))
    data: dict[str, Array] = field(metadata=entry(_series))
    residuals: dict[str, Array] = field(metadata=entry(_series))
    degrees: int
    undetermined: tuple[str, ...] = field(metadata=entry(_sentences))
    doubts: tuple[str, ...] = field(metadata=entry(_sentences))
    evaluations: int
    units: tuple[str, ...] = ()
    priors: dict[str, Array] = field(default_factory=dict, metadata=entry(lambda record, name: record.arrays(name, 2)))
    limits: dict[str, Array] = field(default_factory=dict, metadata=entry(_limits))
    study: Residuals | None = field(default=None, metadata=NOT_KEPT)

    _most = None

    @property
    def names(self) -> tuple[str, ...]:
        """The outputs that have data."""
        return tuple(self.data)

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the estimates."""
        return ByName(zip(self.parameters, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """(n_p, n_p) correlation of the estimates."""
        sizes = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore"):
            return self.covariance / np.outer(sizes, sizes)

    @property
    def laws(self) -> dict[str, Any]:
        """A normal distribution of SciPy for each parameter. `correlation` gives their correlations.

        Raises
        ------
        DeclarationError
            If the data do not determine the parameters
        """
        from scipy.stats import norm

        self._require_determined("laws")
        return ByName((name, norm(self.parameters[name], size)) for name, size in self.deviations.items())

    @property
    def distributions(self) -> dict[str, Any]:
        """Another name of `laws`."""
        return self.laws

    def box(self, level: float = 0.95) -> Box:
        """Intervals that contain the true values of all parameters with at least the probability `level`.

        Each interval has the probability level ** (1 / n_p), by Šidák's inequality. If the noise is estimated,
        Student's distribution gives the quantiles. Intervals end at `limits`.

        Raises
        ------
        DeclarationError
            If the level is not between 0 and 1, or the data do not determine the parameters
        """
        from scipy.stats import norm, t

        if not is_finite_number(level) or not 0 < level < 1:
            raise DeclarationError(f"Calibration.box: level must be between 0 and 1, got {shown(level)}.")
        self._require_determined("box")
        tail = (1 + level ** (1 / len(self.parameters))) / 2
        factor = float(t(self.degrees).ppf(tail) if self.degrees else norm.ppf(tail))
        sizes = self.deviations
        ends = {n: p + factor * sizes[n] * np.array([-1.0, 1.0]) for n, p in self.parameters.items()}
        box = Box(**{n: tuple(np.clip(both, *self.limits.get(n, (None, None))).tolist()) for n, both in ends.items()})
        return box.with_units(units_of_parameters(self.parameters))

    def consistent(self, error: float | str | Mapping[str, float | str]) -> ConsistentSet:
        """The set of all parameters around the estimates whose outputs stay within an error of all data.

        Polynomials describe the outputs over a box around the estimates. Parts of the box are halved. A part is left
        out if an output has a distance of more than the error from a value of the data.

        Parameters
        ----------
        error : float, str or mapping
            largest error of the data, in the unit of the output. A text such as "0.1%" is a percentage of the largest
            absolute value of the output's data. A mapping has an error for each output

        Returns
        -------
        ConsistentSet
            `box` is the smallest box around the set. `pieces` are boxes that together contain the set. Their volume is
            at most twice the volume of the set, or a warning states the ratio

        Raises
        ------
        DeclarationError
            If an error is not valid, if the data do not determine the parameters, or if the fit was read from a file
        SimulationError
            If no run is within the error of all data, or the data do not limit the parameters

        Examples
        --------
        >>> import symmb as mb
        >>> p = mb.Parameters(speed=1.0)
        >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
        >>> start, outputs = {"ball.vx": p.speed}, {"x": ball.x}
        >>> scene = mb.Scene(mb.System(ball, parameters=p), start, times=[0.0, 1.0, 2.0], outputs=outputs)
        >>> fit = mb.calibrate(scene, {"x": [0.0, 1.49, 3.02]})
        >>> [round(end, 3) for end in fit.consistent(0.03).box["speed"]]
        [1.495, 1.52]
        """
        errors = errors_of(error, self.data)
        self._require_determined("consistent")
        if self.study is None:
            raise DeclarationError("Calibration.consistent: a fit from a file has no scene. Call calibrate again.")
        found = consistent_set(self.study, self.name, self.parameters, errors)
        warn_of(found.doubts, f"Calibration.consistent: {self.name}")
        return found

    def _require_determined(self, asked: str) -> None:
        if self.undetermined:
            raise DeclarationError(f"Calibration.{asked}: {' '.join(self.undetermined)}")

    def _head(self) -> str:
        count = sum(map(len, self.data.values()))
        numbers = counted(len(self.parameters), "parameter"), counted(count, "value"), counted(self.evaluations, "run")
        return "\n".join(
            [
                f"{self.name}: {numbers[0]} from {numbers[1]}, {numbers[2]}",
                *map("  noise       {}: {:.3g}".format, self._told_names(), self.noise.values()),
                *(f"  prior       {name}: {value:.6g} ± {size:.2g}" for name, (value, size) in self.priors.items()),
                *(f"  warning     {text}" for text in self.doubts),
            ]
        )

    def _rows(self, names: Sequence[str]) -> list[list[str]]:
        rows, units = [["parameter", "estimate", "deviation", "share"]], units_of_parameters(self.parameters)
        for name, size in self.deviations.items():
            value = self.parameters[name]
            share = f"{size / abs(value):.2%}" if value and np.isfinite(size) else "–"
            rows.append([label(name, units.get(name, "")), f"{value:.6g}", f"{size:.2g}", share])
        return rows

    def _figure(self, columns: list[int] | None, style: plot.Style) -> Figure:
        names = self.names if columns is None else [self.names[k] for k in columns]
        series = [(n, self.times[n], self.data[n], self.data[n] - self.residuals[n]) for n in names]
        units = told_units(self.units, len(self.names), self.parameters)
        return plot.plot_fit(series, [units[self.names.index(name)] for name in names], style)

    def _labelled(self) -> Labelled:
        series = ("value",)
        coordinates = {
            **over_parameters(self.parameters, units_of_parameters(self.parameters)),
            "other": (("other",), texts([*self.parameters])),
            "output": (series, texts([name for name, t in self.times.items() for _ in t])),
            "time": (series, np.concatenate([*self.times.values()])),
        }
        variables = {
            "estimate": (("parameter",), np.array([*self.parameters.values()])),
            "deviation": (("parameter",), np.array([*self.deviations.values()])),
            "covariance": (("parameter", "other"), self.covariance),
            "data": (series, np.concatenate([*self.data.values()])),
            "residual": (series, np.concatenate([*self.residuals.values()])),
            "noise": (series, np.concatenate([np.full(len(t), self.noise[name]) for name, t in self.times.items()])),
        }
        sentences = {"undetermined": self.undetermined, "doubts": self.doubts}
        about = {"scene": self.name, **{key: "\n".join(some) or None for key, some in sentences.items()}}
        return Labelled(coordinates, variables, about, {"time": "s"}, ("parameter",))


@kept_interrupts()
def calibrate(
    scene: Scene | Simulator,
    data: Mapping[str, Any],
    parameters: Sequence[str] | None = None,
    solver: Solver | str | None = None,
    *,
    noise: Mapping[str, float] | None = None,
    box: Box | None = None,
    priors: Mapping[str, Any] | None = None,
    robust: bool = False,
) -> Calibration:
    """Find the parameters that fit measured outputs best. The search starts at the nominal parameters.

    The runs may be those of a scene or of a simulator, such as a `FunctionSimulator` or a `ProgramSimulator`.

    Each residual is divided by the noise of its output, and the sum of squares is minimised. If the noise is not given,
    it is estimated from the residuals of each output. If the residuals are not noise, further fits start at other
    parameters, and the best fit is returned.

    Parameters
    ----------
    scene : Scene
        scene or simulator
    data : mapping
        output -> values (n_t,) at the times of the scene, or a pair (times, values), each (n,). Values of nan are
        left out. A simulator needs data at its own times
    parameters : list of str
        parameters to estimate; default: all
    solver : Solver
        solver of a scene; default: chosen by pilot runs
    noise : mapping
        output -> standard deviation of its data
    box : Box
        limits of some or all parameters. No run is outside of the limits. Parameters of a scene that must be positive,
        such as masses, are also limited by a thousandth of their nominal values
    priors : mapping
        parameter -> value and standard deviation known before the fit: (7.0, 0.1), (7.0, 0.1, "N/m") or
        "7.0 N/m ±0.1 N/m". Each prior is one more residual
    robust : bool
        if True, residuals beyond about 1.3 times the noise count by their size instead of their square, so that
        outliers hardly change the estimates

    Returns
    -------
    Calibration
        with warnings about combinations that the data do not determine, and about residuals that are not noise.
        Undetermined combinations stay as close to the nominal values as the data and limits allow (relative change).
        An estimate at a limit has no standard deviation. The deviations of the other estimates do not use the limits

    Raises
    ------
    DeclarationError
        If an output or a parameter is unknown or repeated, if there are fewer values than parameters, or if a nominal
        value is outside of its limits
    SimulationError
        If no run near the nominal parameters succeeds, or the fit does not end

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> p = mb.Parameters(speed=1.0)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> start, outputs = {"ball.vx": p.speed}, {"x": ball.x}
    >>> scene = mb.Scene(mb.System(ball, parameters=p), start, times=[0.0, 1.0, 2.0], outputs=outputs)
    >>> round(mb.calibrate(scene, {"x": [0.0, 1.49, 3.02]}).parameters["speed"], 6)
    1.506
    >>> data, box, priors = {"x": [0.0, 1.49, 3.02]}, mb.Box(speed=(0.5, 2.0)), {"speed": (1.5, 0.005)}
    >>> fit = mb.calibrate(scene, data, noise={"x": 0.01}, box=box, priors=priors)
    >>> round(fit.parameters["speed"], 4)
    1.5033
    """
    require_truth(OWNER, "robust", robust)
    solver = Subject.of(scene, solver, owner=OWNER).solver
    is_scene = isinstance(scene, Scene)
    outputs, figures = (scene.output_names, scene.figures) if is_scene else (scene.outputs, ())
    measured = measured_values(scene.times, outputs, figures, data)
    times = np.unique(np.concatenate([scene.times[:1], *(t for t, _ in measured.values())]))
    if is_scene:
        own = scene.curves.with_times(times)
        simulator = Subject(own if own.outputs is None else with_some_outputs(own, [*measured]), solver).motion
    else:
        if len(missing := np.setdiff1d(times, scene.times)):
            raise DeclarationError(f"{OWNER}: {scene!r} has no output at t = {missing[0]:g} s.")
        simulator = scene
    some = chosen_parameters(OWNER, parameters, simulator.parameters)
    known_noise = noise_of_outputs(noise, measured)
    count = sum(len(values) for _, values in measured.values())
    units = units_of_parameters(simulator.parameters)
    nominal = {name: simulator.parameters[name] for name in some}
    limits, known = limits_of(box, nominal, units), priors_of(priors, nominal, units)
    if is_scene:
        limits = with_signs(limits, scene.system, nominal)
    if count + len(known) < (needed := len(some) + (not known_noise)):
        unknown, gave = counted(len(some), "parameter"), counted(count, "value")
        more = f"Give {needed} or more values"
        rest = f"{unknown}. {more}" if known_noise else f"{unknown} and the noise. {more}, or noise="
        raise DeclarationError(f"{OWNER}: {gave} cannot determine {rest}, or estimate fewer parameters.")
    name = str(getattr(scene, "name", repr(scene)))
    result = _fitted(Residuals(simulator, some, measured, limits, known, robust), known_noise, name)
    warn_of(result.doubts, f"{OWNER}: {name}")
    return result


def _fitted(fit: Residuals, known_noise: Mapping[str, float], name: str) -> Calibration:
    found, doubts = best_fit(fit, known_noise)
    is_known = found.sizes > 0
    root = fit.sizes[:, None] * found.directions[is_known].T / found.sizes[is_known]
    covariance = root @ root.T
    undetermined = tuple(_undetermined(fit.names, direction) for direction in found.directions[~is_known])
    is_at_limit = (found.u == fit.limits).any(axis=0)
    undetermined += tuple(
        f"The estimate of {fit.names[k]!r} is at its limit {found.u[k] * fit.sizes[k]:g}, so it has no standard "
        "deviation. Change the limit or the nominal value, or leave out this parameter."
        for k in np.flatnonzero(is_at_limit).tolist()
    )
    open_ = is_at_limit | (np.linalg.norm(found.directions[~is_known], axis=0) > _LEAST_COMPONENT)
    covariance[open_], covariance[:, open_] = np.nan, np.nan
    covariance[open_, open_] = np.inf
    deviations = np.sqrt(np.diag(covariance))
    is_vague = np.isfinite(deviations) & (deviations > _VAGUE * np.maximum(fit.sizes, np.abs(found.u * fit.sizes)))
    for k in np.flatnonzero(is_vague).tolist():
        doubts += (
            f"The data hardly determine {fit.names[k]!r}: its standard deviation {deviations[k]:.2g} is more than "
            f"{_VAGUE:g} times its value. Give a prior, or leave out this parameter.",
        )
    units = getattr(fit.simulator, "units", None) or ("",) * len(fit.simulator.outputs)
    return Calibration(
        name,
        ByName(
            zip(fit.names, (found.u * fit.sizes).tolist(), strict=True), units_of_parameters(fit.simulator.parameters)
        ),
        covariance,
        dict(zip(fit.measured, found.noise.tolist(), strict=True)),
        {output: t for output, (t, _) in fit.measured.items()},
        {output: values for output, (_, values) in fit.measured.items()},
        dict(zip(fit.measured, fit.parts(fit(found.u)[0]), strict=True)),
        0 if known_noise else len(fit.data) + len(fit.priors) - int(is_known.sum()),
        undetermined,
        (*undetermined, *doubts),
        fit.runs,
        tuple(units[fit.simulator.outputs.index(name)] for name in fit.measured),
        dict(fit.priors),
        {
            name: ends
            for name, ends in zip(fit.names, (fit.limits * fit.sizes).T, strict=True)
            if (abs(ends) < np.inf).any()
        },
        fit,
    )


def _undetermined(names: Sequence[str], direction: Array) -> str:
    """A sentence about a combination of parameters that does not change the outputs."""
    some = [name for name, part in zip(names, np.abs(direction), strict=True) if part > _LEAST_COMPONENT]
    if len(some) == 1:
        return f"The data do not determine {some[0]!r}: the outputs do not depend on it. Leave out this parameter."
    return f"The data do not determine {', '.join(map(repr, some))} separately. Leave out one of these parameters."
