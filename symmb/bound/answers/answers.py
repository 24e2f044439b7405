"""Answers from bounds: worst cases, contributions, quantiles and probabilities."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from symmb._errors import DeclarationError, PropagationError
from symmb._magnitudes import ROUNDING, SAME
from symmb._names import ByName
from symmb._options import require_names, whole
from symmb._types import Array, Mask
from symmb._units import told_units, units_of_parameters
from symmb.bound import answers
from symmb.bound.answers.envelope import Envelope
from symmb.bound.polynomials import Moments, moments
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import (
    GOOD,
    SIDES,
    AttainingRuns,
    Place,
    Responses,
    RunsUsedUpError,
    Worst,
    WorstCase,
    is_doubtful,
    row_of,
)
from symmb.equations.model import Box, chosen_words, require_only_intervals
from symmb.run import simulation

Answer = TypeVar("Answer")
_WITHOUT_RUNS = "Taylor(", "TaylorModel(", "IntervalArithmetic("
"""Methods that make no runs in the box. The texts of these methods start with these words."""


class Answers(Envelope):
    """The methods of `Bounds` that use runs, the surrogate, or further runs."""

    def worst(self, output: str, time: float | str | None = None) -> Worst:
        """The lowest and the highest value of an output, their times, and the parameters of the runs that attain them.

        Parameters
        ----------
        output : name of an output
        time : [s], or with a unit, as "250 ms"; the closest output time is used; default: the extremes over all times

        Raises
        ------
        DeclarationError
            If there is no such output or time, if no run has a value of the output, if no runs were made, or if a file
            only contains extremes over all times.
        SimulationError
            If the run fails when it is repeated.
        """
        k = self._column(output)
        if lack := self._without_value(k):
            raise DeclarationError(f"Bounds.worst: {lack}")
        if self.attaining is None:
            known = {case.side: case for case in self.worst_cases if case.output == output}
            if time is None and len(known) == len(SIDES):
                return Worst(**known)
            raise DeclarationError(f"Bounds.worst: {self._why_no_worst(bool(known))}")
        rows = self._extreme_rows(k) if time is None else [row_of("Bounds.worst", self.t, time)] * 2
        places = [(side, row, k) for side, row in zip(SIDES, rows, strict=True)]
        return Worst(*self._cases(self.attaining, places))

    def _cases(self, runs: AttainingRuns, places: Sequence[Place]) -> list[WorstCase]:
        """The worst case at each place. If no run of the study reaches a bound, one run is made at the extreme."""
        acting = {k: self._acting(self.box, [k]) for _, _, k in places} if self.box else {}
        units, cases = told_units(self.units, len(self.names), runs.simulator.parameters), list[WorstCase]()
        for place, sample in zip(places, runs.samples(places), strict=True):
            side, i, k = place
            lower, upper = float(self.lower[i, k]), float(self.upper[i, k])
            own = runs.simulator.parameters
            parameters = ByName(zip(own, sample.P[sample.index].tolist(), strict=True), units_of_parameters(own))
            varied = acting.get(k, tuple(parameters))
            is_figure = self.names[k] in self.figures
            time, times = (0.0, 1) if is_figure else (float(self.t[i]), len(self.t))
            chosen = chosen_words(self.box.choices, parameters) if self.box else ()
            estimate = np.nan if self.estimate is None else float(self.estimate[i, k])
            about = parameters, sample.value, upper - lower, varied, times, units[k], chosen, estimate, runs.simulator
            case = WorstCase(self.names[k], side, lower if side == "lower" else upper, time, *about)
            cases.append(self._at_extreme(case, place, runs) if case.is_short else case)
        return cases

    def _at_extreme(self, case: WorstCase, place: Place, runs: AttainingRuns) -> WorstCase:
        """The run at the extreme of the polynomials if it is closer to the bound; otherwise the given case."""
        side, i, k = place
        if self.surrogate is None or self.study is None or self.box is None or k in runs.others:
            return case
        one = np.ones(len(self.box))
        point = self.surrogate.part([i], [k]).range(-one, one)[2][SIDES.index(side), 0]
        try:
            attained = float(self.study.values(point)[0, i, k])
        except PropagationError:
            return case
        return self._closer(case, side, point[0], attained)

    def _closer(self, case: WorstCase, side: str, place: Array, attained: float) -> WorstCase:
        """The case of the run at a place (d,) of the unit box if this run is closer to the bound; otherwise the given
        case."""
        assert self.box is not None
        values = self.box.from_unit(place).tolist()
        parameters = {**self.nominal_parameters, **dict(zip(self.box.names, values, strict=True))}
        parameters = ByName(parameters, units_of_parameters(case.parameters))
        best = min if side == "lower" else max
        chosen, value = chosen_words(self.box.choices, parameters), best(case.value, attained)
        other = replace(case, parameters=parameters, choices=chosen, attained=attained, value=value)
        return other if case.side == side and other.attained == best(attained, case.attained) else case

    def _why_no_worst(self, knows_some: bool) -> str:
        if knows_some:
            return "a file contains the worst cases over all times only. Omit time=."
        if self.study is not None or self.method.startswith(_WITHOUT_RUNS):
            return f"{self.method} makes no runs that attain its bounds. Use PolynomialChaos() or Vertex()."
        if self.next_run is not None:
            return "no recorded run is in the box."
        what = "pickled bounds contain" if self.box else "a .csv file contains"
        return f"{what} no worst cases. Save the bounds as .npz or .json."

    def _extreme_rows(self, k: int) -> list[int]:
        """Indices of the times at which output k is smallest and largest."""
        return [int(self.lower[:, k].argmin()), int(self.upper[:, k].argmax())]

    def _all_worst(self) -> Sequence[WorstCase]:
        """The worst cases over all times, for files."""
        if self.attaining is None:
            return self.worst_cases
        rows = enumerate(map(self._extreme_rows, range(len(self.names))))
        places = [(side, row, k) for k, both in rows for side, row in zip(SIDES, both, strict=True)]
        return self._cases(self.attaining, places)

    def moments(self) -> Moments:
        """Mean, variance and Sobol indices, for parameters that are uniform and independent in the box.

        They are those of the polynomials, which may be less accurate inside of the box than the bounds are.
        `statistical` and `samples` check polynomials by runs.

        Raises
        ------
        PropagationError
            If the method has no expansion.
        """
        if self.box is not None:
            require_only_intervals("Bounds.moments", self.box)
        if self.expansion is None:
            raise PropagationError(
                f"Bounds by {self.method} have no polynomial for the whole box, so they have no moments. Use "
                "PolynomialChaos(order=4). If the response has kinks or jumps, compute moments from Bounds.samples."
            )
        return moments(self.expansion, self.t, self.names)

    def contributions(self, runs: int | None = None) -> "answers.Contributions":
        """The contribution of each parameter to the widths and to the variance.

        The polynomials of the bounds give the contributions without runs. If the method has no polynomials, a study by
        PolynomialChaos() makes them. If polynomials are not accurate enough for an output, studies with fewer
        parameters give the widths. Least squares then give Sobol's indices, from 64 runs at points spread over the box.
        The number of runs is doubled until the error of the indices is below 0.04, up to 1024 runs.

        Parameters
        ----------
        runs : int
            largest number of further runs; default: half as many as the study made. Studies of one parameter have the
            first of them, and other studies have equal parts of the rest. If a part does not suffice, the error is the
            full width. After another method than PolynomialChaos, the default is as many runs as the study made, and
            any number for a scene

        Raises
        ------
        DeclarationError
            If polynomials are missing and no runs can be made, because the bounds were read or pickled.
        PropagationError
            If too many of the further runs fail, or the allowed ones do not suffice for polynomials.
        """
        if runs is None and (self.range_of or self.surrogate is not None):
            runs = self.evaluations // 2
        most = self._leave("Bounds.contributions", runs)
        if most not in self._contributions:
            found = self._answered("Bounds.contributions", runs, answers.contributions_of)
            assert found is not None
            self._contributions[most] = found
        return self._contributions[most]

    @cached_property
    def _contributions(self) -> "dict[float, answers.Contributions]":
        return {}

    def _known_contributions(self) -> "answers.Contributions | None":
        """The contributions, or None if they require runs that have not been made."""
        if self._contributions:
            return [*self._contributions.values()][-1]
        if (not self.range_of and self.study is not None) or (self.box is not None and self.box.is_cut):
            return None
        return answers.contributions_of(self._responses("Bounds.contributions"), may_run=False)

    def _acting(self, box: Box, columns: Sequence[int]) -> tuple[str, ...]:
        """Names of the parameters that act on some outputs, given by their indices.

        Fixed parameters are left out. If there are good polynomials, parameters with effects below noise and rounding
        are also left out.
        """
        acts = box.radius > 0
        if self.surrogate is not None and (self.estimate is None or self.have_good_surrogate()[[*columns]].all()):
            rounding = ROUNDING * self.scale
            floor = np.maximum(rounding, 0.0 if self.noise is None else self.noise)
            acts &= self.surrogate.part(slice(None), columns).acting(floor[[*columns]])
        return tuple(name for name, is_acting in zip(box.names, acts, strict=True) if is_acting)

    def quantiles(
        self,
        output: str,
        levels: float | Sequence[float] | Array,
        laws: Mapping[str, Any] | None = None,
        correlation: "answers.Correlation | None" = None,
        *,
        error: float | None = None,
        distributions: Mapping[str, Any] | None = None,
        runs: int | None = None,
    ) -> "answers.Quantiles":
        """Quantiles of an output over time, for parameters that have distributions.

        A parameter without a distribution may have any value in its interval, and a different value in each sample.
        With such parameters, there is a lowest and a highest quantile. Quantiles follow from polynomials, which 32 runs
        verify. If polynomials are not accurate enough, quantiles follow from 1,024 runs, or from a million runs on a
        graphics card. If, in addition, some parameters have no distribution, quantiles follow from least squares
        through 256 runs. Some hundreds of further runs then estimate the error.

        Parameters
        ----------
        output : str
        levels : float or list
            probabilities between 0 and 1
        laws : mapping
            name -> distribution with `cdf` and `ppf`, such as scipy.stats.norm(40, 1.3). Each distribution is cut to
            the interval of its parameter
        correlation : (n, n)
            correlations of a Gaussian copula, in the order of the distributions; default: independent
        error : float
            the accepted error of sampling, divided by the largest width of the bounds. The number of samples of the
            polynomials grows until it is reached, up to 16 million values. Default: 4,096 samples
        distributions : mapping
            another name of `laws`
        runs : int
            largest number of further runs, as in `contributions`

        Raises
        ------
        DeclarationError
            If an output or a parameter is unknown, if a distribution or a level is invalid, if a distribution is
            outside of the box, or if the correlations are not positive semidefinite.
        PropagationError
            If runs fail.
        """
        given = answers.given_once("Bounds.quantiles", laws, distributions)
        return self._answered(
            "Bounds.quantiles", runs, lambda own: answers.quantiles_of(own, output, levels, given, correlation, error)
        )

    def probability(
        self,
        output: str,
        *,
        above: float | None = None,
        below: float | None = None,
        laws: Mapping[str, Any] | None = None,
        correlation: "answers.Correlation | None" = None,
        error: float = 0.1,
        distributions: Mapping[str, Any] | None = None,
        runs: int | None = None,
    ) -> "answers.Probability":
        """Probability that an output is above or below a value, at each time and at any time; see `quantiles`.

        With both values, the result is the probability that the output is above `above` or below `below`. This is the
        reject rate of a limit with two ends.

        Parameters
        ----------
        above, below : float, or with a unit, as "60 deg"
        laws, correlation, distributions, runs : as in `quantiles`
        error : float
            the accepted error, relative to the probability of the event at any time. The number of samples of the
            polynomials grows until the estimated error is small enough. If more samples do not suffice, and all
            parameters have distributions, up to 1,000 runs near the limit give probabilities down to 1e-9
        """
        given = answers.given_once("Bounds.probability", laws, distributions)
        return self._answered(
            "Bounds.probability",
            runs,
            lambda own: answers.probability_of(own, output, above, below, given, correlation, error),
        )

    def statistical(
        self, limits: "answers.Limits", laws: Mapping[str, Any] | None = None, *, runs: int | None = None
    ) -> "answers.Statistics":
        """Rejects, Cp, Cpk and root sum squares of outputs with limits, beside the worst case.

        A mechanism is a reject if it violates any limit at any output time. Rejects follow from the polynomials. If
        they are rare, up to 1,000 runs near the limit follow for each limit, as in `probability`. Cp and Cpk do not
        tell the rejects if the output has no normal distribution, for example near a stop.

        Parameters
        ----------
        limits : mapping
            limits as in `check`
        laws : mapping
            distributions as in `quantiles`. The default distribution of a parameter is normal, with its mean in the
            middle of the interval and three standard deviations equal to the half width, cut to the interval
        runs : int
            largest number of further runs, as in `contributions`

        Raises
        ------
        DeclarationError
            If an output or a parameter is unknown, or a distribution is invalid.
        PropagationError
            If runs fail.

        Examples
        --------
        >>> import symmb as mb
        >>> f = lambda a, b: [[a + b]]
        >>> stack = mb.FunctionSimulator(f, {"a": 10.0, "b": 20.0}, [0.0], ["gap"])
        >>> bounds = mb.propagate(stack, mb.PolynomialChaos(), mb.Box(a=(9.7, 10.3), b=(19.6, 20.4)))
        >>> found = bounds.statistical({"gap": (29.4, 30.6)})
        >>> found.rss.round(3), found.worst.round(3), found.cpk.round(2)
        (array([0.5]), array([0.7]), array([1.22]))
        """
        pairs = answers.limit_pairs("Bounds.statistical", limits, self.names, self.units)
        for name in pairs:
            if not np.isfinite([ends[:, self._column(name)] for ends in (self.lower, self.upper)]).all():
                raise DeclarationError(f"Bounds.statistical: the bounds of {name} are infinite. Use finite outputs.")
        return self._answered("Bounds.statistical", runs, lambda own: answers.statistics_of(own, pairs, laws))

    def samples(
        self,
        n: int,
        laws: Mapping[str, Any] | None = None,
        correlation: "answers.Correlation | None" = None,
        seed: int = 0,
        *,
        outputs: Sequence[str] | None = None,
        distributions: Mapping[str, Any] | None = None,
        runs: int | None = None,
    ) -> "simulation.Sweep":
        """Responses for n random samples of parameters that all have distributions; see `quantiles`.

        The responses follow from the polynomials that `contributions` uses. Outputs with inaccurate polynomials need n
        runs. `outputs` are the names of the outputs that are computed, by default all. `runs` is the largest number of
        further runs, as in `contributions`.
        """
        given = answers.given_once("Bounds.samples", laws, distributions)
        names = self.names if outputs is None else require_names("Bounds.samples", "output", outputs, self.names)
        if not names:
            raise DeclarationError("Bounds.samples: outputs is empty. Omit it for all outputs.")
        columns = [self.names.index(name) for name in names]
        return self._answered(
            "Bounds.samples",
            runs,
            lambda own: answers.samples_of(own, n, columns, given, correlation, seed, self.nominal_parameters),
            has_error=False,
        )

    def _answered(
        self, owner: str, runs: int | None, answer: Callable[[Responses], Answer], has_error: bool = True
    ) -> Answer:
        """The answer from responses with at most a number of further runs.

        If this number does not suffice, the answer follows from polynomials with their errors.
        """
        most = self._leave(owner, runs)
        if self.study is None:
            return answer(self._responses(owner))
        left = most
        try:
            with self.study.allowing(most):
                try:
                    return answer(self._responses(owner))
                finally:
                    left = self.study.left
        except RunsUsedUpError:
            if not has_error:
                raise PropagationError(
                    f"{owner}: more than {most:g} further runs are needed. Allow them by runs=."
                ) from None
            with self.study.allowing(0):
                found: Any = answer(self._responses(owner, most))
            return replace(found, runs=int(most - left))

    def _leave(self, owner: str, runs: int | None) -> float:
        """The number of further runs that an answer may make."""
        if runs is not None:
            return whole(owner, "runs", runs, 0)
        return self.evaluations if self.study is not None and not self.study.has_lanes else np.inf

    def _responses(self, owner: str, most: float | None = None) -> Responses:
        """Responses that answer questions about the bounds. If `most` is given, as many runs do not suffice."""
        if self.box is None:
            raise DeclarationError(
                f"{owner}: these bounds have no box, because a .csv file has none. Save the bounds as .npz."
            )
        require_only_intervals(owner, self.box)
        study, few = (self.study, "") if most is None else (None, f"{most:g} further runs do not suffice.")
        known = self if self.study is None else vars(self.study).get("adaptive", self)
        adaptive: Any = self if self.range_of else known if study is None else study.adaptive
        surrogate = adaptive.surrogate
        is_good = adaptive.have_good_surrogate()
        remarks = [f"The bounds have a warning: {doubt}" for doubt in self.doubts[:1]]
        if study is None and not is_good.all():
            if surrogate is None and few:
                raise PropagationError(f"{owner}: {self.method} made no polynomials, and {few} Allow more by runs=.")
            if surrogate is None:
                raise DeclarationError(
                    f"{owner}: {self.method} has no polynomials, and bounds from a file or a pickle cannot make runs. "
                    "Use the bounds that propagate has returned."
                )
            is_good[:] = True
            more = f"{few} More are allowed by runs=." if few else "No further runs can be made."
            remarks.append(f"The polynomials used here are inaccurate. {more}")
        values = [self.nominal_parameters.get(n, m) for n, m in zip(self.box.names, self.box.center, strict=True)]
        point = self.box.to_unit(np.array(values))
        if self._left_out:
            listed = ", ".join(self._left_out)
            text = f"Nominal values are outside of the intervals: {listed}."
            remarks.append(f"{text} The closest ends are used instead.")
        estimate = adaptive.estimate if adaptive.estimate is not None else adaptive.surrogate.error
        own = self.t, self.names, self.units, self.box, np.clip(point, -1.0, 1.0)
        runs = 0 if adaptive is self else adaptive.evaluations
        scale = self.scale
        floor = SAME * scale if adaptive.noise is None else adaptive.noise
        ranges = adaptive.lower, adaptive.upper, estimate, floor, surrogate, is_good, study
        return Responses(*own, *ranges, adaptive.method, runs, tuple(remarks))

    def good_surrogate(self, outputs: Sequence[int] | None = None) -> Piecewise | None:
        """The surrogate; None if its error is unknown or too large for one of the outputs (numbers)."""
        asked = slice(None) if outputs is None else [*outputs]
        return self.surrogate if self.have_good_surrogate()[asked].all() else None

    def have_good_surrogate(self) -> Mask:
        """Mask (n_y,) of the outputs with a surrogate and a known error that is small compared with the width."""
        if self.surrogate is None or self.estimate is None:
            return np.zeros(len(self.names), dtype=bool)
        return ~np.any(is_doubtful(*self._scaled(self.surrogate.error), GOOD), axis=0)
