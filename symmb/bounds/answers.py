"""What bounds answer beyond their curves: contributions, quantiles and probabilities."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array, Mask
from symmb.bounds.contributions import Contributions, contributions_of, takes_runs
from symmb.bounds.probabilities import Probability, Quantiles, probability_of, quantiles_of, samples_of
from symmb.bounds.responses import Responses, Runs
from symmb.bounds.time_windows import is_doubtful
from symmb.model import Box
from symmb.polynomials.ranges import Piecewise
from symmb.simulation import Sweep

_GOOD = 0.25
"""Largest error of a surrogate over the widths at which it is asked: its answers stand beside their errors."""
_ROUNDING = 1e-12
"""Share of an output's largest value below which what a parameter changes is rounding."""
_MISSED = 2.0
"""Largest error over the largest one at verifying runs."""


class Answers:
    """The part of `Bounds` that asks the surrogate, or further runs."""

    t: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    lower: Array
    upper: Array
    estimate: Array | None
    noise: Array | None
    method: str
    range_of: str
    box: Box | None
    surrogate: Piecewise | None
    study: Runs | None
    nominal_parameters: Mapping[str, float]

    @property
    def doubts(self) -> tuple[str, ...]:
        raise NotImplementedError

    def contributions(self) -> Contributions:
        """What each parameter contributes to the widths and to the variance.

        They are those of polynomials that stand for the responses, which take no runs. A method that has none, or none
        that is good enough, is followed by a study with PolynomialChaos(). Where that has none either, widths come from
        studies with fewer parameters, and Sobol's indices are not known.

        Raises
        ------
        DeclarationError
            If there are no such polynomials, and bounds that were read or pickled cannot make runs.
        PropagationError
            If too many of these runs fail.
        """
        return contributions_of(self._responses("Bounds.contributions"))

    def _contributions_take_runs(self) -> bool:
        """Whether `contributions` makes further runs."""
        if not self.range_of and self.study is not None:
            return True
        return takes_runs(self._responses("Bounds.contributions"))

    def _acting(self, box: Box) -> tuple[str, ...]:
        """The parameters of the box, but those with a fixed value, and those that change no output beyond noise and
        rounding, if polynomials tell that.
        """
        acts = box.radius > 0
        if self.surrogate is not None:
            rounding = _ROUNDING * np.abs([self.lower, self.upper]).max(axis=(0, 1), initial=0.0)
            acts &= self.surrogate.acting(np.maximum(rounding, 0.0 if self.noise is None else self.noise))
        return tuple(name for name, is_acting in zip(box.names, acts, strict=True) if is_acting)

    def quantiles(
        self,
        output: str,
        levels: float | Sequence[float] | Array,
        laws: Mapping[str, Any],
        correlation: Sequence[Sequence[float]] | Array | None = None,
    ) -> Quantiles:
        """Quantiles of an output over time, for parameters that have distributions.

        A parameter without a law may be anything in its interval, in each sample something else: there is then a least
        and a greatest quantile. They are those of the polynomials that `contributions` uses, or of runs.

        Parameters
        ----------
        output : str
        levels : float or list
            probabilities between 0 and 1
        laws : mapping
            name -> distribution with `cdf` and `ppf`, such as scipy.stats.norm(40, 1.3). It is cut to the interval of
            the box
        correlation : (n, n)
            correlations of a Gaussian copula, in the order of the laws; default: independent

        Raises
        ------
        DeclarationError
            If an output or a parameter is unknown, a law or a level is none, or lies outside of the box, or the
            correlations are not positive definite.
        PropagationError
            If no polynomials are good enough, and some parameters have no law.
        """
        return quantiles_of(self._verified("Bounds.quantiles"), output, levels, laws, correlation)

    def probability(
        self,
        output: str,
        *,
        above: float | None = None,
        below: float | None = None,
        laws: Mapping[str, Any],
        correlation: Sequence[Sequence[float]] | Array | None = None,
    ) -> Probability:
        """Probability that an output is above or below a value, at each time and ever; see `quantiles`."""
        return probability_of(self._verified("Bounds.probability"), output, above, below, laws, correlation)

    def samples(
        self,
        n: int,
        laws: Mapping[str, Any],
        correlation: Sequence[Sequence[float]] | Array | None = None,
        seed: int = 0,
    ) -> Sweep:
        """Responses for n random samples of parameters that all have laws; see `quantiles`.

        They are those of the polynomials that `contributions` uses, or of runs.
        """
        return samples_of(self._verified("Bounds.samples"), n, laws, correlation, seed, self.nominal_parameters)

    def _responses(self, owner: str) -> Responses:
        """What questions about the responses are put to."""
        if self.box is None:
            raise DeclarationError(f"{owner}: these bounds do not know their box. A .csv file does not hold it.")
        adaptive: Any = self if self.range_of or self.study is None else self.study.adaptive
        surrogate = adaptive.good_surrogate()
        remarks = [f"The bounds are doubted: {doubt}" for doubt in self.doubts[:1]]
        if surrogate is None and self.study is None:
            surrogate = self.surrogate
            if surrogate is None:
                raise DeclarationError(
                    f"{owner}: {self.method} leaves no polynomials, and bounds that were read from a file or pickled "
                    "make no runs. Ask the bounds that propagate returns."
                )
            remarks.append("Polynomials that are not good enough answer here: bounds from a file make no runs.")
        values = [self.nominal_parameters.get(n, m) for n, m in zip(self.box.names, self.box.center, strict=True)]
        point = self.box.to_unit(np.array(values))
        outside = ", ".join(n for n, x in zip(self.box.names, point, strict=True) if abs(x) > 1 + 1e-12)
        if outside:
            remarks.append(f"Nominal values are outside of the intervals, whose ends stand for them: {outside}.")
        estimate = adaptive.estimate if adaptive.estimate is not None else adaptive.surrogate.error
        own = self.t, self.names, self.units, self.box, np.clip(point, -1.0, 1.0)
        made = 0 if adaptive is self else adaptive.evaluations
        ranges = adaptive.lower, adaptive.upper, estimate, surrogate, self.study
        return Responses(*own, *ranges, adaptive.method, made, tuple(remarks))

    def _verified(self, owner: str) -> Responses:
        """Responses whose polynomials agree with some runs all over the box, within an error that these tell."""
        found = self._responses(owner)
        if found.surrogate is None or found.runs is None:
            return found
        points, Y = found.runs.sample
        missed = np.abs(found.surrogate.values(points) - Y).max(axis=0, initial=0.0)
        error = np.maximum(found.surrogate.error, _MISSED * missed)
        is_good = not is_doubtful(*self._scaled(error), _GOOD).any()
        return replace(found, surrogate=replace(found.surrogate, error=error) if is_good else None)

    def good_surrogate(self, outputs: Sequence[int] | None = None) -> Piecewise | None:
        """The surrogate, if its error is known and small beside the widths of outputs, by numbers; default: all."""
        if self.surrogate is None or self.estimate is None:
            return None
        is_large: Mask = np.any(is_doubtful(*self._scaled(self.surrogate.error), _GOOD), axis=0)
        asked = range(len(self.names)) if outputs is None else outputs
        return None if any(is_large[k] for k in asked) else self.surrogate

    def _scaled(self, estimate: Array) -> tuple[Array, Array, Array]:
        raise NotImplementedError
