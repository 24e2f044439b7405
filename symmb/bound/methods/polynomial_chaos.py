"""Polynomial chaos: Legendre expansions of the responses from runs at nodes, then their ranges."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._limits import require_memory, require_runs
from symmb._options import (
    constructor_text,
    require_between,
    require_callable,
    require_kind,
    require_truth,
    require_whole,
)
from symmb._types import Array, Executor, Mask
from symmb.bound import methods
from symmb.bound import nodes as fits
from symmb.bound.adaptive import Studies, adaptive_bounds, studies
from symmb.bound.answers import Bounds, Kind
from symmb.bound.methods.method import Method, OfConstraints
from symmb.bound.nodes import ClenshawCurtis, Gauss, Nodes
from symmb.bound.polynomials import Basis, Expansion, TensorDegree, TotalDegree, ranges
from symmb.bound.polynomials.ranges import Exact, Piecewise, Range, last_terms
from symmb.bound.responses import (
    Failure,
    RunsOverBox,
    extremes,
    failed_region,
    failure_records,
    failure_text,
    failures,
    node_values,
    parameter_samples,
    projection,
    together,
    which_failed,
)
from symmb.connect import March, Progress, Simulator, is_recorded, noise_from_runs
from symmb.equations.model import Box, require_only_intervals

_CLENSHAW_CURTIS, _GAUSS, _TENSOR_DEGREE, _EXACT = ClenshawCurtis(), Gauss(), TensorDegree(), Exact()


_Responses = tuple[Array, tuple[Array, Array], Mask, tuple[Failure, ...]]
"""Coefficients (n_b, n_t n_y), extremes of the runs, each (n_t, n_y), mask (N,) of successful runs, failed runs."""


@dataclass(frozen=True)
class PolynomialChaos(Method):
    """Bounds of a Legendre expansion y(xi) = sum a_i phi_i(xi) fitted to runs at nodes of the box, eq. (20).

    ``PolynomialChaos()`` adds nodes until the estimated error is small enough. It is a row of small studies; `studies`
    prints them. Scenes begin with one grid for all outputs, and with runs spread over the box. Up to three parameters
    have tensor grids, and check runs at the extremes of the expansion. For one parameter, runs near kinks reduce the
    error. If the error remains large, the box is divided at jumps. For regular oscillations over many periods,
    polynomials describe the phase and the form of the cycles. For more parameters, each output has check runs and a
    separate sparse grid, which grows where the output varies. If a sparse grid takes too many runs, runs at corners and
    near extremes give the bounds. For simulators that are not scenes, runs at corners come first, because monotonic
    responses have their extremes there. Outputs with at most eight output times use a Gaussian process that finds the
    directions of variation. Narrow bumps may be missed without a warning. Bumps are narrow if their standard deviation,
    divided by the half width of the box, is below 0.2 for two parameters, 0.4 for three and 0.5 for four.
    ``PolynomialChaos(probes=200)`` finds more bumps. `RecordedRuns` get sparse polynomials by least squares.
    ``PolynomialChaos(order=4)`` has a given order: it interpolates at Clenshaw-Curtis nodes, and takes the exact range
    of the interpolant. ``PolynomialChaos.paper(order=2)`` is the
    method of the paper.

    Parameters
    ----------
    order : highest degree; None: the method chooses degrees and nodes
    nodes : ClenshawCurtis(), Gauss(), ChebyshevGauss(), Leja() or SparseGrid(...)
    basis : TensorDegree(), TotalDegree() or HyperbolicCross(q=...)
    range : Exact(...), Bernstein(...), ChebyshevInclusion(), or LegendreInclusion() as in the paper
    tolerance : without order: estimated error at which the study stops, divided by the width of the response
    budget : without order: largest number of runs, for each combination of choices
    seconds : without order: longest time in addition to the runs [s]; None: about 3 s, and 8 to 20 ms for
        each run. This limit counts computing work, so that bounds do not depend on the load of the machine
    probes : without order: number of further runs, evenly spread over the box, with which the surrogate must agree.
        These runs find effects in small parts of the box
    lockstep : advance all nodes together from one output time to the next, and compute the expansion there (Fig. 4).
        This option needs a simulator with a method `march`, and does not use the executor. Without this option, each
        node runs separately (Fig. 5)

    Raises
    ------
    DeclarationError
        If an option is out of its range, or has no meaning with the other options.
    PropagationError
        Raised by ``bounds`` if too many nodes failed for least squares over the other nodes; if, without order, most of
        the first nodes failed; if the nodes do not determine the basis; if the simulator cannot march in lockstep; or
        if the budget is smaller than the number of first runs.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.PolynomialChaos.paper(order=2)
    PolynomialChaos.paper(order=2)
    >>> mb.PolynomialChaos(order=4)
    PolynomialChaos(order=4)

    References
    ----------
    Wang and Yang, Nonlinear Dynamics (2021), sections 3.2-4.1.
    """

    order: int | None = None
    nodes: Nodes = _CLENSHAW_CURTIS
    basis: Basis = _TENSOR_DEGREE
    range: Range = _EXACT
    tolerance: float = 1e-2
    budget: int | None = None
    lockstep: bool = False
    seconds: float | None = None
    probes: int = 0

    kind: ClassVar[Kind] = "estimate"
    constraints: ClassVar[OfConstraints] = "polynomials"

    def __post_init__(self) -> None:
        require_kind("PolynomialChaos", "nodes", self.nodes, "points", "Gauss(), ClenshawCurtis() or Leja()")
        require_callable("PolynomialChaos: nodes.points", self.nodes.points, "d", "order")
        require_kind("PolynomialChaos", "basis", self.basis, "indices", "TensorDegree() or TotalDegree()")
        require_kind("PolynomialChaos", "range", self.range, "bounds", "Exact() or LegendreInclusion()")
        require_truth("PolynomialChaos", "lockstep", self.lockstep)
        require_whole(self, "probes", 0)
        require_between(self, "tolerance", "()", 0.0, 1.0)
        if self.order is not None:
            require_whole(self, "order", 1)
            if self.budget is not None or self.tolerance != 1e-2 or self.seconds is not None or self.probes != 0:
                raise DeclarationError(
                    "PolynomialChaos: tolerance, budget, seconds and probes cannot be used with order. Leave out order."
                )
            return
        chosen = self.nodes != _CLENSHAW_CURTIS or self.basis != _TENSOR_DEGREE or self.range != _EXACT
        if chosen or self.lockstep:
            raise DeclarationError(
                "PolynomialChaos without order chooses nodes, basis and range itself. To set them, give order=... ."
            )
        if self.budget is not None:
            require_whole(self, "budget", 1)
        if self.seconds is not None:
            require_between(self, "seconds", "()", 0.0)

    @classmethod
    def paper(cls, order: int = 2, *, nodes: Nodes = _GAUSS, lockstep: bool = False) -> "PolynomialChaos":
        """The paper's method: Gauss nodes or a SparseGrid, total degree, projection, Legendre inclusion."""
        return cls(order, nodes, TotalDegree(), ranges.LegendreInclusion(), lockstep=lockstep)

    @property
    def studies(self) -> Studies:
        """The small studies of PolynomialChaos(), in the order in which they are tried, with their numbers.

        Examples
        --------
        >>> import symmb as mb
        >>> [study.name for study in mb.PolynomialChaos().studies][:3]
        ['first grid', 'waveforms', 'first grid']
        """
        if self.order is not None:
            raise DeclarationError(f"{self!r} has one grid. PolynomialChaos() without order is a row of small studies.")
        return studies()

    def planned_runs(self, d: int) -> int | None:
        return None if self.order is None else getattr(self.nodes, "size", lambda *_: None)(d, self.order)

    def bounds(self, runs: RunsOverBox) -> Bounds:
        simulator, box, executor, progress = runs.simulator, runs.box, runs.executor, runs.progress
        if is_recorded(simulator) and self == PolynomialChaos():
            require_only_intervals(repr(simulator), box)
            return methods.recorded_bounds(repr(self), simulator, box)
        if self.order is None and not box.radius.any():
            bounds = methods.sampled(self, np.zeros((1, len(box))), runs)
            noise = noise_from_runs(simulator)
            estimate = np.zeros_like(bounds.lower) + (0.0 if noise is None else noise)
            return replace(bounds, estimate=estimate, noise=noise, range_of="one run")
        if self.order is None:
            require_runs(self, self.probes, "Use fewer probes.")
            require_memory(self, "the probes", self.probes * (2 * len(box) + len(simulator.parameters)))
            return adaptive_bounds(
                repr(self), self.tolerance, self.budget, self.seconds, self.probes, simulator, box, executor, progress
            )
        fit = fits.Fit.of(self.nodes, self.basis, len(box), self.order)
        values = len(fit.alpha) + (2 * len(fit.nodes) if fit.line is not None and not self.lockstep else 0)
        outputs = len(simulator.times) * len(simulator.outputs)
        require_memory(self, "the values at nodes and the coefficients", values * outputs)
        P = parameter_samples(simulator, box, fit.nodes)
        if self.lockstep:
            coefficients, inner, ok, failed = self._marched(fit, P, simulator, box, progress)
        else:
            coefficients, inner, ok, failed = self._streamed(fit, P, simulator, box, executor, progress)
        shape, noise = runs.shape, noise_from_runs(simulator)
        with np.errstate(over="ignore"):
            widest = (inner[1] - inner[0]).max(axis=0)
        is_noise = np.zeros(shape[1], dtype=bool) if noise is None else widest <= 2 * noise
        expansion = Expansion(fit.alpha, coefficients.reshape(-1, *shape), box.names)
        expansion = expansion.without(box.lower == box.upper, is_noise)
        lower, upper = (np.reshape(bound, shape) for bound in self._range(expansion))
        lower, upper = np.where(is_noise, inner[0], lower), np.where(is_noise, inner[1], upper)
        details = {"inner": inner, "failed": failed, "expansion": expansion, "noise": noise}
        exact = isinstance(self.range, Exact)
        details["surrogate"] = Piecewise.whole(expansion, last_terms(expansion), exact)
        details["failed_region"] = failed_region(box, fit.nodes, ~ok)
        return self._result(runs, lower, upper, len(P), **details)

    def _range(self, expansion: Expansion) -> tuple[Array, Array]:
        """Lower and upper bounds (m,) of all responses. No products of very large or very small numbers are formed."""
        coefficients = expansion.coefficients.reshape(len(expansion.alpha), -1)
        power = np.frexp(np.maximum(coefficients.max(axis=0), -coefficients.min(axis=0)))[1]
        # Coefficients between these powers of two are multiplied without scaling.
        if (np.abs(power) < 100).all():
            return self.range.bounds(expansion.alpha, coefficients)
        lower, upper = self.range.bounds(expansion.alpha, np.ldexp(coefficients, -power))
        with np.errstate(over="ignore"):
            return np.ldexp(lower, power), np.ldexp(upper, power)

    def _streamed(
        self,
        fit: "fits.Fit",
        P: Array,
        simulator: Simulator,
        box: Box,
        executor: Executor | None,
        progress: Progress | None,
    ) -> _Responses:
        runs = node_values() if fit.line is not None else projection(fit.functionals, simulator)
        reduction = together(runs, extremes(simulator), failures())
        state, inner, failed_runs = simulator.stream(P, reduction, executor, progress)
        failed = failure_records(simulator, box, P, failed_runs)
        ok = ~which_failed(failed_runs, len(P))
        self._require_determined(fit, ok, failed)
        if fit.line is None:
            return fit.coefficients(state, ok), inner[:2], ok, failed
        return fit.transform(*(values for _, values in state)), inner[:2], ok, failed

    def _marched(
        self, fit: "fits.Fit", P: Array, simulator: Simulator, box: Box, progress: Progress | None
    ) -> _Responses:
        if not isinstance(simulator, March):
            raise PropagationError(
                f"{self!r}: with lockstep=True, all samples must advance together in time, but {simulator!r} runs "
                "each sample separately. Leave out lockstep."
            )
        n_t, n_y = len(simulator.times), len(simulator.outputs)
        coefficients = np.empty((len(fit.alpha), n_t, n_y))
        inner_lower, inner_upper = np.empty((2, n_t, n_y))
        ok = np.ones(len(P), dtype=bool)
        failed: tuple[Failure, ...] = ()
        for i, Y in simulator.march(P):
            lost = ok & ~np.isfinite(Y).all(axis=1)
            time = float(simulator.times[i])
            new = tuple((int(n), time, "not finite") for n in np.flatnonzero(lost))
            failed += failure_records(simulator, box, P, new)
            ok &= ~lost
            self._require_determined(fit, ok, failed)
            sums = fit.transform(Y) if ok.all() else fit.functionals[:, ok] @ Y[ok]
            coefficients[:, i] = fit.coefficients(sums, ok)
            inner_lower[i], inner_upper[i] = Y[ok].min(axis=0), Y[ok].max(axis=0)
            if progress is not None:
                progress(i + 1, n_t)
        return coefficients.reshape(len(coefficients), -1), (inner_lower, inner_upper), ok, failed

    def _require_determined(self, fit: "fits.Fit", ok: Mask, failed: tuple[Failure, ...]) -> None:
        if not fit.determined(ok):
            raise PropagationError(
                f"{self!r}: {len(failed)} of {len(ok)} nodes failed, and the other nodes do not determine "
                f"{len(fit.alpha)} coefficients.\n{failure_text(failed)}"
            )

    def __repr__(self) -> str:
        order = "" if self.order is None else f"order={self.order}"
        if self.basis == TotalDegree() and self.range == ranges.LegendreInclusion() and self.nodes != _CLENSHAW_CURTIS:
            options = [order]
            if self.nodes != _GAUSS:
                options.append(f"nodes={self.nodes!r}")
            if self.lockstep:
                options.append("lockstep=True")
            return f"PolynomialChaos.paper({', '.join(options)})"
        return constructor_text(self, order)
