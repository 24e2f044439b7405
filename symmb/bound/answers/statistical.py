"""Rejects, process capability and root sum squares of outputs with limits, for parameters with distributions."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._labelled import Labelled, Result
from symmb._names import counted, normal_keys
from symmb._table import aligned, over_times
from symmb._types import Array, Mask
from symmb.bound.answers.law_samples import SAMPLES_BEFORE_RUNS, SAMPLES_ON_CARD, LawSamples
from symmb.bound.answers.laws import Laws, laws_text
from symmb.bound.answers.limits import limit_text
from symmb.bound.answers.probabilities import event_probability, values_of
from symmb.bound.nodes import Sobol
from symmb.bound.polynomials import Expansion
from symmb.bound.responses import Responses, RunsUsedUpError
from symmb.equations.model import Box
from symmb.results.files import Record, entry
from symmb.run.formulations import CardEnsemble

_SAMPLES, _LEAST_SAMPLES = 1024, 16
"""Number of samples for means and standard deviations, and the smallest number if fewer runs are allowed."""
_DEFAULT = "normal, with three standard deviations equal to the half width, cut to the interval"


@dataclass(frozen=True)
class NormalWithin:
    """The default distribution in an interval. scipy.stats.truncnorm is ten times slower."""

    centre: float
    radius: float

    def cdf(self, x: Array) -> Array:
        from scipy.special import ndtr

        return np.clip((ndtr(3 * (x - self.centre) / self.radius) - _BELOW) / (1 - 2 * _BELOW), 0.0, 1.0)

    def ppf(self, q: Array) -> Array:
        from scipy.special import ndtri

        return self.centre + self.radius / 3 * ndtri(_BELOW + q * (1 - 2 * _BELOW))


_BELOW = 0.0013498980316300933
"""Probability of a value more than three standard deviations below the mean, scipy.special.ndtr(-3)."""
_OF_LIMITS = entry(Record.with_nan, "limits")
LimitPairs = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class _Joint(Responses):
    """All outputs and times at which a limit may be violated, as one output. Each output is divided by its scale.

    Attributes
    ----------
    columns : list             numbers of the outputs with limits
    active : (n_t, n_l)        mask of the times and outputs
    scales : (n_l,)
    """

    columns: list[int]
    active: Mask
    scales: Array

    def of(self, values: Array) -> Array:
        """Values (..., n_active, 1) from values (..., n_t, n_y)."""
        return (values[..., self.columns] / self.scales)[..., self.active][..., None]

    def by_runs(self, points: Array, k: int) -> Array:
        assert self.runs is not None
        return self.of(self.runs.values(points))[:, :, k]


def _joint(responses: Responses, pairs: LimitPairs) -> tuple[_Joint, tuple[Array, Array]]:
    """One output for all limits, and the limits (n_active,) of its times."""
    columns = [responses.names.index(name) for name in pairs]
    low, high = np.array([*pairs.values()]).T
    lower, upper, estimate = (each[:, columns] for each in (responses.lower, responses.upper, responses.estimate))
    scales = (upper - lower).max(axis=0)
    scales = np.where(scales > 0, scales, 1.0)
    active = (lower - estimate < low) | (upper + estimate > high)
    own = {name: getattr(responses, name) for name in Responses.__dataclass_fields__}
    joint = _Joint(**own, columns=columns, active=active, scales=scales)

    def changed(own: Expansion) -> Expansion:
        return replace(own, coefficients=joint.of(own.coefficients))

    surrogate, is_good = responses.surrogate, responses.is_good[columns].all()
    if surrogate is not None:
        surrogate = surrogate.changed(changed, joint.of(surrogate.error)) if is_good else None
    parts = {name: joint.of(own[name]) for name in ("lower", "upper", "estimate")}
    t = np.broadcast_to(responses.t[:, None], active.shape)[active]
    floor = np.array([(responses.floor[columns] / scales).max()])
    joint = replace(joint, **parts, t=t, floor=floor, surrogate=surrogate, is_good=np.array([is_good]), names=("",))
    ends = (np.broadcast_to(end / scales, active.shape)[active] for end in (low, high))
    return joint, (next(ends), next(ends))


def laws_within(owner: str, laws: object, box: Box) -> dict[str, Any]:
    """The given distributions, and the default distributions of other parameters that are not fixed."""
    if not isinstance(laws, Mapping | None):
        Laws.of(owner, laws, None, box)  # explains what is wrong
    given = dict[str, Any](normal_keys(owner, laws) if isinstance(laws, Mapping) else {})
    parts = zip(box.names, box.center.tolist(), box.radius.tolist(), strict=True)
    own = {name: NormalWithin(centre, r) for name, centre, r in parts if r > 0 and name not in given}
    return given | own


def rejects_of(
    owner: str, responses: Responses, pairs: LimitPairs, laws: object, error: float = 0.1, least: float = 0.0
) -> tuple[float, float, int]:
    """The probability that a limit is violated at any output time, its estimated error, and the number of runs."""
    joint, ends = _joint(responses, pairs)
    if not joint.active.any():  # no response in the box violates a limit
        return 0.0, 0.0, 0
    samples = LawSamples(owner, joint, 0, laws_within(owner, laws, responses.box), None, SAMPLES_BEFORE_RUNS)
    found = event_probability(samples, ends, error, least)
    return float(found[0, -1]), float(found[2, -1]), samples.runs - responses.extra_runs


def at_most(below: Array, above: Array) -> Array:
    """The largest probability outside of an interval, for all distributions with mean 0 and standard deviation 1.

    The interval contains 0, and has the ends -below and above. This is Selberg's inequality. For one infinite end it is
    Cantelli's inequality, and for equal distances Chebyshev's.
    """
    near, far = np.minimum(below, above), np.maximum(below, above)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        one = 1 / (1 + near**2)
        two = (4 + (far - near) ** 2) / (near + far) ** 2
        both = np.where((far == np.inf) | (near * (far - near) >= 2), one, two)
    found = np.where((near > 0) & (near * far > 1), both, 1.0)
    return np.where(near == np.inf, 0.0, found)


@dataclass(frozen=True, eq=False, repr=False)
class Statistics(Result):
    """Rejects and process capability of outputs with limits. `print` shows them.

    Arrays have one entry for each limit, in the unit of its output, at the time of its smallest Cpk.

    Attributes
    ----------
    limits : names of the outputs with limits
    texts : limits as inequalities, with units
    time : (n_l,)              time of the smallest Cpk [s]
    mean, sigma : (n_l,)       mean and standard deviation
    rss : (n_l,)               root of the sum of the squares of the contributions. A contribution is half of the range
                               of the output at the ends and in the middle of one interval, with other parameters in
                               the middle
    worst : (n_l,)             half width of the bounds, which is the worst case
    cp, cpk : (n_l,)           process capability; cp is nan for limits with one end
    rejects, error : (n_l,)    probability that the limit is violated at any output time, and its estimated error
    any_law : (n_l,)           largest probability of a violation at this time, for all distributions of the output with
                               this mean and standard deviation
    total : (float, float)     probability that any limit is violated at any output time, and its estimated error
    laws : str                 distributions of the parameters, in words
    runs : int                 further runs that were made
    remarks : sentences
    """

    limits: tuple[str, ...]
    texts: tuple[str, ...]
    time: Array = field(metadata=_OF_LIMITS)
    mean: Array = field(metadata=_OF_LIMITS)
    sigma: Array = field(metadata=_OF_LIMITS)
    rss: Array = field(metadata=_OF_LIMITS)
    worst: Array = field(metadata=_OF_LIMITS)
    cp: Array = field(metadata=_OF_LIMITS)
    cpk: Array = field(metadata=_OF_LIMITS)
    rejects: Array = field(metadata=_OF_LIMITS)
    error: Array = field(metadata=_OF_LIMITS)
    any_law: Array = field(metadata=_OF_LIMITS)
    total: tuple[float, float] = field(metadata=entry(lambda record, name: tuple(record.array(name, 2).tolist())))
    laws: str
    runs: int
    remarks: tuple[str, ...]

    @property
    def yield_(self) -> float:
        """The probability that all limits are satisfied at all output times."""
        return 1.0 - self.total[0]

    def _head(self) -> str:
        lines = [
            f"Rejects: {_ppm(self.total[0])} ppm, with an estimated error of {_ppm(self.total[1])} ppm",
            f"  distribution {self.laws}",
            f"  runs         {counted(self.runs, 'further run')}",
        ]
        return "\n".join([*lines, *(f"  remark       {remark}" for remark in self.remarks)])

    def _rows(self) -> list[list[str]]:
        heads = ["limit", "mean", "3 sigma", "RSS", "worst case", "Cp", "Cpk", "at [s]"]
        rows = [[*heads, "rejects [ppm]", "error", "any law"]]
        for k, text in enumerate(self.texts):
            halves = (f"± {each[k]:.4g}" for each in (3 * self.sigma, self.rss, self.worst))
            cp = "–" if np.isnan(self.cp[k]) else f"{self.cp[k]:.3g}"
            ppm = _ppm(self.rejects[k]), f"≤ {_ppm(self.error[k])}", f"≤ {_ppm(self.any_law[k])}"
            rows.append([text, f"{self.mean[k]:.6g}", *halves, cp, f"{self.cpk[k]:.3g}", f"{self.time[k]:.6g}", *ppm])
        return over_times(rows, np.unique(self.time))

    def __str__(self) -> str:
        return "\n".join([self._head(), *(f"  {line}" for line in aligned(self._rows()))])

    def _repr_html_(self) -> str:
        return html.page(html.text(self._head()), html.table(self._rows()))

    def _labelled(self) -> Labelled:
        names = "time", "mean", "sigma", "rss", "worst", "cp", "cpk", "rejects", "error", "any_law"
        variables: dict[str, Any] = {name: (("output",), getattr(self, name)) for name in names if name != "time"}
        variables["at"] = (("output",), self.time)
        about = {"laws": self.laws, "rejects": self.total[0], "error": self.total[1]}
        return Labelled({"output": (("output",), np.array(self.limits))}, variables, about, {"at": "s"}, ("output",))


def _ppm(share: float) -> str:
    return f"{1e6 * share:.3g}" if share < 1e-3 else f"{1e6 * share:.0f}"


def statistics_of(
    responses: Responses, pairs: LimitPairs, laws: object, error: float = 0.1, least: float = 0.0
) -> Statistics:
    """Statistics of outputs with limits; see `Bounds.statistical`."""
    owner, box, columns = "Bounds.statistical", responses.box, [responses.names.index(name) for name in pairs]
    if not (box.radius > 0).any():
        raise DeclarationError(f"{owner}: all parameters of the box are fixed.")
    full = laws_within(owner, laws, box)
    own = Laws.of(owner, full, None, box)

    def drawn(n: int) -> Array:
        points = np.zeros((n, len(box)))
        points[:, own.columns] = own.unit_points((Sobol().points(n, len(own.names), 0) + 1) / 2, box)
        return points

    n, few = _SAMPLES, tuple[str, ...]()
    if responses.runs is not None and not responses.is_good[columns].all():  # rejects need the other runs
        if (n := int(min(n, responses.runs.left / 3))) < _LEAST_SAMPLES:
            raise RunsUsedUpError("Means need more runs.")
        if n < _SAMPLES:
            parts = f"{n**-0.5:.0%} and about {(2 * n) ** -0.5:.0%} of the standard deviations"
            few = (f"Means and standard deviations follow from {n} runs. Their standard errors are {parts}.",)
    points = np.concatenate([drawn(n), np.eye(len(box)), -np.eye(len(box)), np.zeros((1, len(box)))])

    def summary(Y: Array) -> Array:
        """Means, standard deviations and root sums of squares, (3, n_t, n_l)."""
        low, high, middle = Y[n : n + len(box)], Y[n + len(box) : -1], Y[-1]
        ranges = np.fmax(np.fmax(low, high), middle) - np.fmin(np.fmin(low, high), middle)
        rss = np.sqrt(np.square(ranges / 2).sum(axis=0))
        return np.array([Y[:n].mean(axis=0), Y[:n].std(axis=0), rss])

    (mean, sigma, rss), made, remarks = values_of(responses, points, columns, summary)
    if responses.runs is not None and responses.runs.on_card and not responses.is_good[columns].all():
        found = responses.runs.reduced(drawn(SAMPLES_ON_CARD), CardEnsemble.moments)
        mean, sigma = (each[:, columns] for each in found)
    low, high = np.array([*pairs.values()]).T
    floor = responses.floor[columns]  # smaller numbers are rounding or noise
    sigma = np.where(sigma > floor, sigma, 0.0)
    below, above = (_ratio(np.where(abs(d) > floor, d, 0.0), sigma) for d in (mean - low, high - mean))
    cpk = np.minimum(below, above) / 3
    rows = cpk.argmin(axis=0), np.arange(len(columns))
    single = [rejects_of(owner, responses, {name: pair}, full, error, least) for name, pair in pairs.items()]
    total = single[0] if len(single) == 1 else rejects_of(owner, responses, pairs, full, error, least)
    cp = _ratio(np.where(np.isfinite(high - low), high - low, np.nan), sigma[rows]) / 6
    worst = (responses.upper - responses.lower)[:, columns] / 2
    units = responses.units or ("",) * len(responses.names)
    ordered = zip(pairs.items(), columns, strict=True)
    texts = tuple(limit_text(name, units[k], *pair) for (name, pair), k in ordered)
    rejects, errors, runs = (np.array(each) for each in zip(*single, strict=True))
    further_runs = made + int(runs.sum()) + (total[2] if len(single) > 1 else 0) + responses.extra_runs
    return Statistics(
        tuple(pairs), texts, responses.t[rows[0]], mean[rows], sigma[rows], rss[rows], worst[rows], cp, cpk[rows],
        rejects, errors, np.maximum(at_most(below[rows], above[rows]), rejects), total[:2],
        _laws_text(full), further_runs, (*responses.remarks, *own.remarks, *remarks, *few),
    )  # fmt: skip


def _laws_text(full: Mapping[str, Any]) -> str:
    given = {name: law for name, law in full.items() if not isinstance(law, NormalWithin)}
    others = f"others {_DEFAULT}" if given else _DEFAULT
    return ", ".join([laws_text(given)] * bool(given) + [others] * (len(given) < len(full)))


def _ratio(distance: Array, sigma: Array) -> Array:
    """Distances divided by standard deviations; infinite without deviation, also for an output exactly at its limit."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sigma > 0, distance / sigma, np.where(distance < 0, -np.inf, np.inf))
