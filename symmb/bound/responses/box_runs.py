"""The runs that a method makes over a box."""

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._options import numbers_of, shown
from symmb._types import Array, Executor
from symmb.bound.responses.failures import Failure
from symmb.bound.responses.streams import extremes, failure_records, failures, node_values, together
from symmb.connect import Jets, Progress, Simulator
from symmb.equations.model import Box
from symmb.run import simulation
from symmb.run.simulation import has_exact_jets


class RunsOverBox:
    """Runs of a simulator with parameters of a box: a function of samples, for a method.

    Runs use the lanes of scenes, the executor and the store of the study. They are counted, and their extremes are
    remembered.

    Attributes
    ----------
    parameters : d names
    lower, upper : (d,) ends of the intervals, in the unit of each parameter
    times : (n_t,) [s]
    outputs : n_y names
    evaluations : number of runs until now; derivatives count as d more runs
    failed : failed runs until now
    simulator, box, executor, progress : arguments of the study
    """

    def __init__(
        self,
        owner: str,
        simulator: Simulator,
        box: Box,
        executor: Executor | None = None,
        progress: Progress | None = None,
    ) -> None:
        self._owner = owner
        self.simulator, self.box, self.executor, self.progress = simulator, box, executor, progress
        self.parameters, self.lower, self.upper = box.names, box.lower.copy(), box.upper.copy()
        self.lower.flags.writeable = self.upper.flags.writeable = False
        self.times, self.outputs = np.asarray(simulator.times, dtype=float), tuple(simulator.outputs)
        self.evaluations, self.failed = 0, tuple[Failure, ...]()

    def of(self, simulator: Simulator, box: Box | None = None) -> "RunsOverBox":
        """Runs of another simulator over the same box or another one, of which none is made yet."""
        return RunsOverBox(self._owner, simulator, box or self.box, self.executor, self.progress)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of times and of outputs, (n_t, n_y)."""
        return len(self.times), len(self.outputs)

    def __call__(self, P: Array) -> Array:
        """Values (N, n_t, n_y) of the outputs at samples P (N, d) of the box; nan for failed runs.

        Raises
        ------
        DeclarationError
            If P has another shape, contains something else than finite numbers, or is outside of the box.
        """
        own = self._inside(P, 2)
        samples = np.tile(np.array([*self.simulator.parameters.values()], dtype=float), (len(own), 1))
        samples[:, parameter_columns(self.simulator, self.box)] = own
        reduction = together(node_values(), failures(), extremes(self.simulator))  # which keeps the attaining runs
        blocks, failed, _ = self.simulator.stream(samples, reduction, self.executor)
        Y = np.full((len(own), *self.shape), np.nan)
        for indices, values in blocks:
            Y[indices] = values.reshape(len(indices), *self.shape)
        self.failed += failure_records(self.simulator, self.box, samples, failed)
        self.count(len(own))
        return Y

    def derivatives(self, p: Array) -> Array:
        """First derivatives (d, n_t, n_y) of the outputs with respect to the parameters, at one sample p (d,).

        Raises
        ------
        DeclarationError
            If p has another shape, contains something else than finite numbers, or is outside of the box.
        PropagationError
            If the simulator gives no derivatives, or derivatives that are not finite.
        """
        own = self._inside(p, 1)
        radius = np.where(self.box.radius > 0, self.box.radius, 1.0)
        sample = np.array([*self.simulator.parameters.values()], dtype=float)
        sample[parameter_columns(self.simulator, self.box)] = own
        jets = self._jets(sample, np.diag(radius), 1)
        self.count(1 + len(own))
        return jets[1] / radius[:, None, None]

    def unit_jets(self, point: Array, directions: Array, order: int) -> Array:
        """Taylor coefficients (order + 1, m, n_t, n_y) about points (d,) or (m, d), along directions (m, d).

        Points and directions are of the unit box. At a single point (d,), low orders are differences of runs if the run
        meets a kink, a jump or an event. The method counts these evaluations itself.
        """
        p0 = parameter_samples(self.simulator, self.box, np.atleast_2d(point)).reshape(*point.shape[:-1], -1)
        return self._jets(p0, directions * self.box.radius, order)

    def _jets(self, p0: Array, directions: Array, order: int) -> Array:
        """Taylor coefficients about samples of all parameters, along directions (m, d) in the units of the box."""
        simulator = self.simulator
        if not isinstance(simulator, Jets):
            figures = ", ".join(getattr(simulator, "figures", ()))
            source = f"scalar outputs ({figures}) have" if figures else f"{simulator!r} gives"
            raise PropagationError(
                f"{self._owner}: the method needs derivatives of the trajectory, but {source} values only. "
                "Use MonteCarlo or PolynomialChaos."
            )
        scaled = np.zeros((len(directions), len(simulator.parameters)))
        scaled[:, parameter_columns(simulator, self.box)] = directions
        if p0.ndim == 1 and order <= simulation.HIGHEST_OF_DIFFERENCES and not has_exact_jets(simulator, p0):
            return simulation.differences(simulator, p0, scaled, order)[0]
        jets = np.asarray(simulator.jets(p0, scaled, order), dtype=float)
        if not np.isfinite(jets).all():
            raise PropagationError(f"{self._owner}: {simulator!r} gives derivatives that are not finite.")
        return jets

    def _inside(self, given: Array, ndim: int) -> Array:
        """Samples from a method of the user, as finite numbers inside the box."""
        d, form = len(self.box), "(N, {})" if ndim == 2 else "({},)"
        own = numbers_of(given)
        if own is None or own.ndim != ndim or own.shape[-1] != d or not np.isfinite(own).all():
            got = shown(given) if own is None else f"shape {own.shape}" if np.isfinite(own).all() else "nan or inf"
            names = ", ".join(self.parameters)
            raise DeclarationError(
                f"{self._owner}: runs need finite samples {form.format(d)} of the parameters {names}, got {got}."
            )
        slack = 1e-9 * self.box.radius  # rounding
        if (beyond := (own < self.lower - slack) | (own > self.upper + slack)).any():
            *_, k = np.argwhere(beyond)[0]
            raise DeclarationError(
                f"{self._owner}: {self.parameters[k]} = {own[tuple(np.argwhere(beyond)[0])]:g} is outside of its "
                f"interval [{self.lower[k]:g}, {self.upper[k]:g}]."
            )
        return np.clip(own, self.lower, self.upper)

    def count(self, evaluations: int) -> None:
        """Count runs, and report them as progress."""
        self.evaluations += evaluations
        if self.progress is not None:
            self.progress(self.evaluations, self.evaluations)


def parameter_samples(simulator: Simulator, box: Box, unit: Array) -> Array:
    """Points (N, len(box)) of the unit box as samples (N, d) of all parameters, in the simulator's order."""
    P = np.tile(np.array(list(simulator.parameters.values()), dtype=float), (len(unit), 1))
    P[:, parameter_columns(simulator, box)] = box.from_unit(unit)
    return P


def parameter_columns(simulator: Simulator, box: Box) -> list[int]:
    """Columns of the box's parameters among the parameters of the simulator."""
    order = list(simulator.parameters)
    return [order.index(name) for name in box.names]
