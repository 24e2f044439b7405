"""Bounds by the extremes of many samples: attained, not proved."""

from collections.abc import Mapping
from dataclasses import InitVar, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._limits import require_memory, require_runs
from symmb._options import constructor_text, require_instance, require_kind, require_whole
from symmb._types import Array
from symmb.bound.answers import Bounds, Correlation, Kind, Laws, given_once, laws_text
from symmb.bound.methods.method import Method, OfConstraints
from symmb.bound.nodes import Random, Sampler, grid
from symmb.bound.responses import (
    RunsOverBox,
    allowed_points,
    extremes,
    failure_details,
    failures,
    parameter_samples,
    require_some,
    together,
)

_RANDOM = Random()


@dataclass(frozen=True)
class MonteCarlo(Method):
    """Extremes over random samples of the box.

    The bounds are narrower than the range of the responses. With fewer samples or more parameters, the bounds become
    narrower. A few check runs look for values beyond the bounds. A value that exceeds the bounds by more than a tenth
    of the width causes a warning.

    Parameters
    ----------
    samples : number of runs
    seed : seed of the random numbers; the same seed gives the same samples
    sampler : Random(), Sobol() or LatinHypercube()
    laws : mapping of name to distribution with `cdf` and `ppf`, such as scipy.stats.norm(40, 1.3). Each distribution is
        cut to the interval of its parameter. Other parameters are uniform
    correlation : correlations of a Gaussian copula, in the order of the distributions; default: independent
    distributions : another name of `laws`; the attribute is `laws`

    Raises
    ------
    DeclarationError
        If samples is not a positive integer, or the seed is negative. `bounds` raises the same errors for distributions
        as `Bounds.quantiles`.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.MonteCarlo(10_000)
    MonteCarlo(10000)
    """

    samples: int = 10_000
    seed: int = 0
    sampler: Sampler = _RANDOM
    laws: Mapping[str, Any] | None = field(default=None, hash=False)
    correlation: Correlation | None = field(default=None, hash=False)
    distributions: InitVar[Mapping[str, Any] | None] = None

    kind: ClassVar[Kind] = "sampled"
    constraints: ClassVar[OfConstraints] = "own"

    @property
    def doubtful_miss(self) -> float:  # random samples miss the extremes, with distributions by more
        return 0.1 if self.laws is None else np.inf

    def __post_init__(self, distributions: Mapping[str, Any] | None) -> None:
        require_whole(self, "samples", 1)
        require_whole(self, "seed", 0)
        object.__setattr__(self, "laws", given_once("MonteCarlo", self.laws, distributions))
        if self.laws is not None:
            expected = 'distributions by name, as {"k": norm(40, 1.3)}'
            require_instance("MonteCarlo: distributions", self.laws, Mapping, expected)
        elif self.correlation is not None:
            raise DeclarationError("MonteCarlo: correlation needs distributions. Give both, or neither.")
        require_kind("MonteCarlo", "sampler", self.sampler, "points", "Random(), Sobol() or LatinHypercube()")

    def planned_runs(self, d: int) -> int:
        return self.samples

    def bounds(self, runs: RunsOverBox) -> Bounds:
        require_runs(self, self.samples, "Use fewer samples.")
        require_memory(self, "the samples", self.samples * (2 * len(runs.box) + len(runs.simulator.parameters)))
        points, laws = self.sampler.points(self.samples, len(runs.box), self.seed), None
        if self.laws is not None:
            laws = Laws.of(repr(self), self.laws, self.correlation, runs.box)
            points[:, laws.columns] = laws.unit_points((points[:, laws.columns] + 1) / 2, runs.box)
        bounds = sampled(self, points, runs)
        return bounds if laws is None else replace(bounds, remarks=laws.remarks)

    def __repr__(self) -> str:
        if self.laws is None:
            return constructor_text(self, str(self.samples))
        text = constructor_text(replace(self, laws=None, correlation=None), str(self.samples))
        correlated = "" if self.correlation is None else f", correlation={np.asarray(self.correlation).tolist()}"
        return f"{text[:-1]}, distributions={laws_text(self.laws)}{correlated})"


@dataclass(frozen=True)
class Scanning(Method):
    """Extremes over a regular grid that includes the box's faces and corners (the paper's scanning method).

    Parameters
    ----------
    points : grid points for each parameter, at least 2; ``points**d`` runs in total

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Scanning(21)
    Scanning(21)
    """

    points: int = 21

    kind: ClassVar[Kind] = "sampled"
    constraints: ClassVar[OfConstraints] = "own"

    def __post_init__(self) -> None:
        require_whole(self, "points", 2)

    def planned_runs(self, d: int) -> int:
        return self.points**d

    def bounds(self, runs: RunsOverBox) -> Bounds:
        return _scanned(self, self.points, runs)

    def __repr__(self) -> str:
        return constructor_text(self, str(self.points))


@dataclass(frozen=True)
class Vertex(Method):
    """Extremes over the 2^d corners of the box: exact if the response is monotonic in every parameter.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Vertex()
    Vertex()
    """

    kind: ClassVar[Kind] = "sampled"

    def planned_runs(self, d: int) -> int:
        return 2**d

    def bounds(self, runs: RunsOverBox) -> Bounds:
        return _scanned(self, 2, runs)


def _scanned(method: Method, points: int, runs: RunsOverBox) -> Bounds:
    d, number = len(runs.box), points ** len(runs.box)
    require_runs(method, number, "Use PolynomialChaos() or MonteCarlo(...).")
    require_memory(method, "the points", number * (2 * d + len(runs.simulator.parameters)))
    return sampled(method, grid(np.linspace(-1.0, 1.0, points), d), runs)


def sampled(method: Method, unit: Array, runs: RunsOverBox) -> Bounds:
    """The extremes of runs at the points (N, d) of the unit box that are allowed."""
    simulator, box = runs.simulator, runs.box
    if not len(unit := allowed_points(box, unit)):
        raise PropagationError(f"{method!r}: no sample satisfies all constraints of the box.")
    P = parameter_samples(simulator, box, unit)
    reduction = together(extremes(simulator), failures())
    (lower, upper, _), bad = simulator.stream(P, reduction, runs.executor, runs.progress)
    details = failure_details(simulator, box, unit, P, bad)
    require_some(method, details["failed"], len(P))
    return method._result(runs, lower, upper, len(P), inner=(lower, upper), **details)
