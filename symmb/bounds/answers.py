"""What bounds answer beyond their curves: worst cases, contributions, quantiles and probabilities."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._types import Array, Mask
from symmb.bounds.contributions import Contributions, contributions_of, takes_runs
from symmb.bounds.envelope import Envelope
from symmb.bounds.laws import Correlation
from symmb.bounds.probabilities import Probability, Quantiles, probability_of, quantiles_of, samples_of
from symmb.bounds.responses import Responses
from symmb.bounds.time_windows import ROUNDING_SCALE, is_doubtful
from symmb.bounds.worst_case import SIDES, AttainingRuns, Place, Worst, WorstCase, row_of
from symmb.model import Box
from symmb.polynomials import Moments, moments
from symmb.polynomials.ranges import Piecewise
from symmb.simulation import Sweep

_GOOD = 0.25
"""Largest error of a surrogate over the widths at which it is asked: its answers stand beside their errors."""
_MISSED = 2.0
"""Largest error over the largest one at verifying runs."""
_WITHOUT_RUNS = "Taylor(", "TaylorModel(", "IntervalArithmetic("
"""Methods that make no runs in the box, by the begin of their texts."""


class Answers(Envelope):
    """The part of `Bounds` that asks the runs, the surrogate, or further runs."""

    def worst(self, output: str, time: float | None = None) -> Worst:
        """Where an output is least and largest: values, times, and the parameters of the runs that attain them.

        Parameters
        ----------
        output : name of an output
        time : the output time [s] that is closest to this one; default: the extremes over all times

        Raises
        ------
        DeclarationError
            If there is no such output or time, no runs were made, or a file holds the extremes over all times alone.
        SimulationError
            If the run does not come again.
        """
        k = self._column(output)
        if self.attaining is None:
            known = {case.side: case for case in self.worst_cases if case.output == output}
            if time is None and len(known) == len(SIDES):
                return Worst(**known)
            raise DeclarationError(f"Bounds.worst: {self._why_no_worst(bool(known))}")
        rows = self._extreme_rows(k) if time is None else [row_of("Bounds.worst", self.t, time)] * 2
        places = [(side, row, k) for side, row in zip(SIDES, rows, strict=True)]
        return Worst(*self._cases(self.attaining, places))

    def _cases(self, runs: AttainingRuns, places: Sequence[Place]) -> list[WorstCase]:
        """The worst cases at places. Where runs of the study fall short of the bounds, one is made at the extreme."""
        acting = {k: self._acting(self.box, [k]) for _, _, k in places} if self.box else {}
        cases = list[WorstCase]()
        for place, sample in zip(places, runs.samples(places), strict=True):
            side, i, k = place
            lower, upper = float(self.lower[i, k]), float(self.upper[i, k])
            parameters = dict(zip(runs.simulator.parameters, sample.P[sample.index].tolist(), strict=True))
            varied = acting.get(k, tuple(parameters))
            is_figure = self.names[k] in self.figures
            time, times = (0.0, 1) if is_figure else (float(self.t[i]), len(self.t))
            about = time, parameters, sample.value, upper - lower, varied, times, runs.simulator
            case = WorstCase(self.names[k], side, lower if side == "lower" else upper, *about)
            cases.append(self._at_extreme(case, place) if case.is_short else case)
        return cases

    def _at_extreme(self, case: WorstCase, place: Place) -> WorstCase:
        """The run where the polynomials have their extreme, if it comes closer to the bound."""
        if self.surrogate is None or self.study is None or self.box is None:
            return case
        side, i, k = place
        one = np.ones(len(self.box))
        point = self.surrogate.part([i], [k]).range(-one, one)[2][SIDES.index(side), 0]
        try:
            attained = float(self.study.values(point)[0, i, k])
        except PropagationError:
            return case
        values = self.box.from_unit(point[0]).tolist()
        parameters = {**self.nominal_parameters, **dict(zip(self.box.names, values, strict=True))}
        other = replace(case, parameters=parameters, attained=attained)
        return other if other.shortfall < case.shortfall else case

    def _why_no_worst(self, knows_some: bool) -> str:
        if knows_some:
            return "a file holds the worst cases over all times alone."
        if self.study is not None or self.method.startswith(_WITHOUT_RUNS):
            return f"{self.method} makes no runs that attain its bounds. Use PolynomialChaos() or Vertex()."
        what = "pickled bounds keep" if self.box else "a .csv file keeps"
        return f"{what} no worst cases. Save bounds as .npz or .json."

    def _extreme_rows(self, k: int) -> list[int]:
        """Numbers of the times at which output number k is least and largest."""
        return [int(self.lower[:, k].argmin()), int(self.upper[:, k].argmax())]

    def _all_worst(self) -> Sequence[WorstCase]:
        """Those over all times, for files."""
        if self.attaining is None:
            return self.worst_cases
        rows = enumerate(map(self._extreme_rows, range(len(self.names))))
        places = [(side, row, k) for k, both in rows for side, row in zip(SIDES, both, strict=True)]
        return self._cases(self.attaining, places)

    def moments(self) -> Moments:
        """Mean, variance and Sobol indices, for parameters that are uniform and independent in the box.

        Raises
        ------
        PropagationError
            If the method has no expansion.
        """
        if self.expansion is None:
            raise PropagationError(
                f"Bounds by {self.method} hold no expansion to take moments of. Use PolynomialChaos(order=4); "
                "at kinks or jumps, where PolynomialChaos() cuts the box into pieces, samples of your own."
            )
        return moments(self.expansion, self.t, self.names)

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

    def _acting(self, box: Box, columns: Sequence[int]) -> tuple[str, ...]:
        """The parameters of the box, but those with a fixed value, and those that change none of some outputs, by their
        numbers, beyond noise and rounding, if polynomials tell that.
        """
        acts = box.radius > 0
        if self.surrogate is not None:
            rounding = ROUNDING_SCALE * np.abs([self.lower, self.upper]).max(axis=(0, 1), initial=0.0)
            floor = np.maximum(rounding, 0.0 if self.noise is None else self.noise)
            acts &= self.surrogate.part(slice(None), columns).acting(floor[[*columns]])
        return tuple(name for name, is_acting in zip(box.names, acts, strict=True) if is_acting)

    def quantiles(
        self,
        output: str,
        levels: float | Sequence[float] | Array,
        laws: Mapping[str, Any],
        correlation: Correlation | None = None,
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
        correlation: Correlation | None = None,
    ) -> Probability:
        """Probability that an output is above or below a value, at each time and ever; see `quantiles`.

        With both values it is the probability that the output is above the one or below the other, as the reject rate
        of a limit with two ends.
        """
        return probability_of(self._verified("Bounds.probability"), output, above, below, laws, correlation)

    def samples(self, n: int, laws: Mapping[str, Any], correlation: Correlation | None = None, seed: int = 0) -> Sweep:
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
        runs = 0 if adaptive is self else adaptive.evaluations
        ranges = adaptive.lower, adaptive.upper, estimate, surrogate, self.study
        return Responses(*own, *ranges, adaptive.method, runs, tuple(remarks))

    def _verified(self, owner: str) -> Responses:
        """Responses whose polynomials agree with some runs all over the box, within an error that these tell."""
        responses = self._responses(owner)
        surrogate = responses.surrogate
        if surrogate is None or responses.runs is None:
            return responses
        points, Y = responses.runs.sample
        error = np.maximum(surrogate.error, _MISSED * np.abs(surrogate.values(points) - Y).max(axis=0, initial=0.0))
        is_good = not is_doubtful(*self._scaled(error), _GOOD).any()
        return replace(responses, surrogate=replace(surrogate, error=error) if is_good else None)

    def good_surrogate(self, outputs: Sequence[int] | None = None) -> Piecewise | None:
        """The surrogate, if its error is known and small beside the widths of outputs, by numbers; default: all."""
        if self.surrogate is None or self.estimate is None:
            return None
        is_large: Mask = np.any(is_doubtful(*self._scaled(self.surrogate.error), _GOOD), axis=0)
        asked = range(len(self.names)) if outputs is None else outputs
        return None if any(is_large[k] for k in asked) else self.surrogate
