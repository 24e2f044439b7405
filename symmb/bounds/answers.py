"""What bounds answer beyond their curves: contributions, quantiles and probabilities."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array, Mask
from symmb.bounds.contributions import Contributions, contributions_of
from symmb.bounds.probabilities import Probability, Quantiles, probability_of, quantiles_of, samples_of
from symmb.bounds.responses import Responses, Runs
from symmb.bounds.time_windows import is_doubtful
from symmb.model import Box
from symmb.polynomials.ranges import Piecewise
from symmb.simulation import Sweep

_GOOD = 0.25
"""Largest error of a surrogate over the widths at which it is asked: its answers stand beside their errors."""


class Answers:
    """The part of `Bounds` that asks the surrogate, or further runs."""

    t: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    lower: Array
    upper: Array
    estimate: Array | None
    method: str
    range_of: str
    box: Box | None
    surrogate: Piecewise | None
    study: Runs | None
    nominal_parameters: Mapping[str, float]

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
        levels : float or list         probabilities between 0 and 1
        laws : mapping                 name -> distribution with `cdf` and `ppf`, such as scipy.stats.norm(40, 1.3). It
                                       is cut to the interval of the box
        correlation : (n, n)           correlations of a Gaussian copula, in the order of the laws; default: independent

        Raises
        ------
        DeclarationError
            If an output or a parameter is unknown, a law or a level is none, or lies outside of the box, or the
            correlations are not positive definite.
        PropagationError
            If no polynomials are good enough, and some parameters have no law.
        """
        return quantiles_of(self._responses("Bounds.quantiles"), output, levels, laws, correlation)

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
        return probability_of(self._responses("Bounds.probability"), output, above, below, laws, correlation)

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
        return samples_of(self._responses("Bounds.samples"), n, laws, correlation, seed, self.nominal_parameters)

    def _responses(self, owner: str) -> Responses:
        """What questions about the responses are put to."""
        if self.box is None:
            raise DeclarationError(f"{owner}: these bounds do not know their box. A .csv file does not hold it.")
        good = self.good_surrogate()
        if good is not None or self.study is None:
            if self.surrogate is None:
                raise DeclarationError(
                    f"{owner}: {self.method} leaves no polynomials, and bounds that were read from a file or pickled "
                    "make no runs. Ask the bounds that propagate returns."
                )
            return self._asked(self.surrogate)
        adaptive: Any = self if self.range_of else self.study.adaptive
        adaptive = replace(adaptive, study=self.study, nominal_parameters=self.nominal_parameters)
        return adaptive._asked(adaptive.good_surrogate())

    def good_surrogate(self, outputs: Sequence[int] | None = None) -> Piecewise | None:
        """The surrogate, if its error is small beside the widths of outputs, by their numbers; default: all."""
        if self.surrogate is None:
            return None
        is_large: Mask = np.any(is_doubtful(*self._scaled(self.surrogate.error), _GOOD), axis=0)
        asked = range(len(self.names)) if outputs is None else outputs
        return None if any(is_large[k] for k in asked) else self.surrogate

    def _asked(self, surrogate: Piecewise | None) -> Responses:
        assert self.box is not None
        values = [
            self.nominal_parameters.get(name, middle)
            for name, middle in zip(self.box.names, self.box.center, strict=True)
        ]
        nominal = np.clip(self.box.to_unit(np.array(values)), -1.0, 1.0)
        if self.estimate is not None:
            estimate = self.estimate
        else:
            estimate = np.zeros_like(self.lower) if surrogate is None else surrogate.error
        own = self.t, self.names, self.units, self.box, nominal, self.lower, self.upper, estimate
        return Responses(*own, surrogate, self.study, self.method)

    def _scaled(self, estimate: Array) -> tuple[Array, Array, Array]:
        raise NotImplementedError
