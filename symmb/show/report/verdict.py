"""The first page of a report: sentences about whether limits are satisfied, and what to do next."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symmb._errors import SymmbError, SymmbWarning
from symmb._magnitudes import SAME, SLIGHT
from symmb._table import is_timeless
from symmb._types import Array, Mask
from symmb._units import typeset
from symmb.bound.answers import WARNED, Bounds, Contributions, KeptLimit, LimitCheck, other_side
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.propagation import Study
from symmb.bound.responses import SIDES
from symmb.equations.model import Box
from symmb.study import tolerances

STATES = {False: "violated", None: "undecided", True: "satisfied"}
"""Words for the results of limits, with the most urgent result first."""
_SAID = {
    False: ("is violated in {} cases", "are violated in {} cases"),
    None: ("is not decided", "are not decided"),
    True: ("is satisfied", "are satisfied"),
}
_MOST_LISTED, _MOST_PARAMETERS = 6, 3
"""Largest number of limits or ranges with a sentence, and of parameters that one sentence names."""
_LEAST_PART = 0.05
"""Smallest effect of a named parameter, relative to the largest effect, and smallest proposed tolerance factor."""
_CERTAIN = {
    "enclosure": "The bounds for these sentences are proved.",
    "sampled": "Only the {} cases that were run are known. Other cases may have more extreme values.",
    "estimate": "These are estimates from {} runs, not proofs.",
}
_WARNED = "A warning prevents a decision: see the annex. Remove its cause, or use another method."
_ROUNDED = 0.99
"""Factor of the proposed tolerances, which are rounded when they are printed."""
_BY_RUNS = "Further runs verify these tolerances."
_SEARCH = "`mb.tolerances(...)` makes further runs, and finds tolerances that satisfy the limits."
_AGAIN = (
    "These tolerances and factors are estimates from the runs of this study. They are reduced by the estimated error, "
    "so larger tolerances may also satisfy the limits. `mb.tolerances(...)` makes further runs, and finds the largest "
    "common factor of all tolerances."
)


def by_urgency(check: LimitCheck) -> list[KeptLimit]:
    """The limits, with violated limits first and undecided limits next."""
    return sorted(check.limits, key=lambda limit: [*STATES].index(limit.kept))


def verdict(bounds: Bounds, check: LimitCheck | None) -> list[tuple[str, str]]:
    """Sentences about all limits, about each limit or range, and about certainty. Each has a result, or ""."""
    if check is None:
        head = "No limits were given. These are the ranges within the tolerances."
        ends = zip(bounds.names, bounds.lower.min(axis=0), bounds.upper.max(axis=0), _units(bounds), strict=True)
        some = [
            ("", f"{_quoted(name)} is between {_text(a, '', 4)} and {_text(b, unit, 4)}.") for name, a, b, unit in ends
        ]
    else:
        everywhere = [_least_excess(bounds, limit)[0] > 0 for limit in check.limits if limit.kept is False]
        head = _headline([limit.kept for limit in check.limits], _cases(everywhere))
        sides = [(limit, other_side(bounds, limit, bounds._side(limit))) for limit in by_urgency(check)]
        some = [(STATES[limit.kept], f"{_sentence(bounds, limit)} {also}".rstrip()) for limit, also in sides]
    more = [f"The annex contains the other {len(some) - _MOST_LISTED} sentences."] * (len(some) > _MOST_LISTED)
    errors = " Their errors are not known." if bounds.estimate is None else " The annex states their errors."
    more.append(_CERTAIN[bounds.kind].format(bounds.evaluations) + errors * (bounds.kind == "estimate"))
    if bounds.failed:
        more.append(f"{len(bounds.failed)} of {bounds.evaluations} runs failed: these cases are not known.")
    if n := len(bounds.doubts):
        more.append(f"{'A warning says' if n == 1 else f'{n} warnings say'} what is uncertain: see the annex.")
    more += bounds._about_nominal()
    told = " ".join((*more, *(text for _, text in some)))
    more += [remark for remark in (check.remarks if check else ()) if remark not in told]
    return [("" if check is None else STATES[check.kept], head), *some[:_MOST_LISTED], *(("", text) for text in more)]


def _cases(everywhere: Sequence[bool]) -> str:
    """In which cases limits are violated, from a truth value for each violated limit: whether it is in all cases."""
    return "all" if all(everywhere) else "some or all" if any(everywhere) else "some"


def _headline(results: Sequence[bool | None], cases: str) -> str:
    """A sentence with the numbers of violated, undecided and satisfied limits. `cases` is the result of `_cases`."""
    n, counts = len(results), {state: results.count(state) for state in STATES if state in results}
    words = [f"{count} {_SAID[state][count > 1].format(cases)}" for state, count in counts.items()]
    if len(words) > 1:
        return f"Of {n} limits, {_listed(words)}."
    subject, (state,) = ["", "The limit", "Both limits"][n] if n < 3 else f"All {n} limits", counts
    return f"{subject} {_SAID[state][n > 1].format(cases)}{' in all cases within the tolerances' if state else ''}."


def next_steps(bounds: Bounds, check: LimitCheck | None, shares: Contributions | None) -> list[str]:
    """Sentences: how to decide limits, which tolerances to tighten, by how much, and the most important parameters."""
    limits = [] if check is None else by_urgency(check)
    texts = _undecided(limits)
    ends = {limit: _end(bounds, limit) for limit in limits if not limit.kept}
    beyond = [limit for limit, end in ends.items() if limit.margin[limit.row] < -SAME * abs(end)]
    excess = {limit: max(_nominal_excess(bounds, limit), _least_excess(bounds, limit)[0]) for limit in beyond}
    lost = {limit: excess[limit] for limit in beyond if excess[limit] > 0}
    at_limit = [limit for limit in beyond if limit not in lost and excess[limit] >= -SAME * abs(ends[limit])]
    if at_limit:
        names = _listed([_named(limit) for limit in at_limit])
        texts.append(
            f"The nominal values reach the limit of {names}. Change these values or the limit, not the tolerances."
        )
    if lost:
        texts.append(_lost(bounds, lost))
    texts += _tighten(bounds, [limit for limit in beyond if limit not in (*lost, *at_limit)])
    idle = "No tolerance needs to be tightened." if limits else "Give limits of outputs, so that this page checks them."
    return [*(texts or [idle]), *_spread(bounds, {_column(bounds, limit): limit.row for limit in limits}, shares)]


def _undecided(limits: Sequence[KeptLimit]) -> list[str]:
    """The reasons why limits are undecided."""
    some = [limit for limit in limits if limit.kept is None][:_MOST_LISTED]
    return [f"{_named(own)}: {_WARNED if own.why.startswith(WARNED) else own.why}" for own in some]


def _lost(bounds: Bounds, excess: Mapping[KeptLimit, float]) -> str:
    """A sentence about limits that no tolerance satisfies, with the excess of the nominal values or of all cases."""
    words = [f"{_named(limit)} by {_text(value, limit.unit)}" for limit, value in excess.items()][:_MOST_LISTED]
    more = [f"{len(excess) - _MOST_LISTED} other outputs"] * (len(excess) > _MOST_LISTED)
    is_nominal = np.isfinite(_nominal_excess(bounds, next(iter(excess))))
    who, change = ("The nominal values", "them") if is_nominal else ("All cases", "the intervals")
    return f"{who} violate the limit of {_listed([*words, *more])}: change {change}, or the limit."


def _text(value: float, unit: str, digits: int = 3) -> str:
    return f"{value + 0.0:.{digits}g}{' ' * bool(unit)}{typeset(unit)}"


def _listed(words: Sequence[str], last: str = "and") -> str:
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)


def _units(owner: Bounds | Box) -> Sequence[str]:
    return getattr(owner, "units", ()) or ("",) * len(owner.names)


def _named(limit: KeptLimit) -> str:
    return _quoted(limit.output)


def _quoted(output: str) -> str:
    """An output in quotation marks, because names such as 'open' may read as words of the sentence."""
    return f"'{output}'"


def _column(bounds: Bounds, limit: KeptLimit) -> int:
    return bounds.names.index(limit.output)


def _end(bounds: Bounds, limit: KeptLimit) -> float:
    """The end of the limit that is closest to the bounds."""
    return limit.high if bounds._side(limit) == "upper" else limit.low


def _inside(limit: KeptLimit) -> str:
    """The limits as words that follow "is"."""
    low, high = _text(limit.low, limit.unit, 6), _text(limit.high, limit.unit, 6)
    if np.isfinite(limit.low) and np.isfinite(limit.high):
        return f"between {_text(limit.low, '', 6)} and {high}"
    return f"at most {high}" if np.isfinite(limit.high) else f"at least {low}"


def _nominal_excess(bounds: Bounds, limit: KeptLimit) -> float:
    """Excess of the nominal run over the limit, negative inside; -inf if the run is not known, or not in the box."""
    if bounds.nominal is None or bounds._left_out:
        return -np.inf
    values = bounds.nominal[:, _column(bounds, limit)]
    return float(max((limit.low - values).max(), (values - limit.high).max()))


def _least_excess(bounds: Bounds, limit: KeptLimit) -> tuple[float, int]:
    """The smallest excess of all cases over the limit, at the time at which this excess is largest, and the index of
    the time. The excess is -inf if it is not known."""
    if bounds.failed or (bounds.estimate is None and bounds.kind != "enclosure"):
        return -np.inf, 0
    lower, upper = (end[:, _column(bounds, limit)] for end in bounds.outer)
    excess = lower - limit.high if bounds._side(limit) == "upper" else limit.low - upper
    return float(excess.max()), int(excess.argmax())


def _sentence(bounds: Bounds, limit: KeptLimit) -> str:
    def at(time: float) -> str:
        return "" if limit.output in bounds.figures or is_timeless(bounds.t) else f", at {time:.4g} s"

    name, margin = _named(limit), float(limit.margin[limit.row])
    where = at(limit.time(bounds.t)) + _when(bounds, limit)
    least = f"The smallest margin is {_text(margin, limit.unit)}{where}."
    end = _end(bounds, limit)
    if abs(margin) <= SAME * abs(end):
        return f"{name} reaches its limit of {_text(end, limit.unit, 6)}{where}, within rounding."
    if limit.kept:
        return f"{name} is {_inside(limit)} in all cases within the tolerances. {least}"
    may, does = ("exceed", "exceeds") if bounds._side(limit) == "upper" else ("fall below", "falls below")
    most, nominal, (every, row) = -margin, _nominal_excess(bounds, limit), _least_excess(bounds, limit)
    limit_of, up_to = f"its limit of {_text(end, limit.unit, 6)}", f"{_text(most, limit.unit)}{where}"
    beyond = f"{name} may {may} {limit_of} by {up_to}."
    if limit.kept is None:
        return f"It is not decided whether {name} is {_inside(limit)}. {least if margin >= 0 else beyond}"
    if every > 0:
        least = _text(every, limit.unit)
        other = f"{at(bounds.t[row])}," if row != limit.row and at(bounds.t[row]) else ""
        by = "" if least == _text(most, limit.unit) else f"at least {least}{other} and up to "
        return f"{name} {does} {limit_of} in all cases, by {by}{up_to}."
    if nominal > 0:
        return f"{name} {does} {limit_of} by {_text(nominal, limit.unit)} at the nominal values, and by up to {up_to}."
    return beyond


def _when(bounds: Bounds, limit: KeptLimit) -> str:
    """Words for the parameters that are high or low in the run closest to the limit."""
    try:
        case, box = bounds._closest_to([limit]), bounds.box
        if case is None or box is None or case.is_short or case.width <= SAME * abs(case.value):
            return ""
        point = box.to_unit(np.array([case.parameters[name] for name in box.names]))
        names = _acting(bounds, _column(bounds, limit), limit.row, point)
    except SymmbError:  # the run cannot be repeated
        return ""
    place, units = dict(zip(box.names, point, strict=True)), dict(zip(box.names, _units(box), strict=True))
    names = [n for n in names if abs(place[n]) >= 0.5]  # the others are neither high nor low
    some = names[:_MOST_LISTED]
    words = [f"{n} is {'high' if place[n] > 0 else 'low'} ({_text(case.parameters[n], units[n], 4)})" for n in some]
    if (n := len(names) - _MOST_LISTED) > 0:
        words.append(f"{n} other parameter{'s are' if n > 1 else ' is'} near the ends of the intervals")
    return f", when {_listed(words)}" if words else ""


def _acting(bounds: Bounds, k: int, i: int, place: Array) -> list[str]:
    """Parameters, sorted by their effects on the output k at the time i (indices). The effect of a parameter is the
    change of the output if only this parameter moves from `place` (d,) in the unit box to the middle of its interval.

    Effects follow from accurate polynomials, or from one run for each parameter. These runs are not made if they are
    expensive and the study made fewer runs.
    """
    box, study = bounds.box, bounds.study
    assert box is not None
    points = np.vstack([place, np.where(np.eye(len(box), dtype=bool), 0.0, place)])
    if bounds.surrogate is not None and bounds.have_good_surrogate()[k]:
        values = bounds.surrogate.part([i], [k]).values(points)[:, 0, 0]
    elif isinstance(study, Study) and (study.has_lanes or len(box) < bounds.evaluations):
        values = study.of_output(k, points)[0][:, i]
    else:
        return []
    effects = np.nan_to_num(np.abs(values[1:] - values[0]))
    noise = 0.0 if bounds.noise is None else bounds.noise[k]
    least = max(_LEAST_PART * effects.max(), SAME * np.abs(values[0]), noise)
    return [box.names[n] for n in np.argsort(-effects, kind="stable") if effects[n] > least]


def _spread(bounds: Bounds, rows: Mapping[int, int], shares: Contributions | None) -> list[str]:
    """The largest contributions to widths, at the given times of outputs, or at the times of their widest bounds."""
    texts = list[str]()
    for k in list(rows or range(len(bounds.names)))[: _MOST_PARAMETERS if shares else 0]:
        assert shares is not None
        i, unit = rows.get(k, int(shares.width[:, k].argmax())), _units(bounds)[k]
        alone = dict(zip(shares.parameters, shares.alone[i, k].tolist(), strict=True))
        names = [n for n in sorted(alone, key=lambda n: -alone[n]) if alone[n] > _LEAST_PART * max(alone.values())]
        words = [f"{n} ({_text(alone[n], unit)} alone)" for n in names[:_MOST_PARAMETERS]]
        width = _text(shares.width[i, k], unit)
        texts += [f"The spread of {_quoted(bounds.names[k])}, {width}, comes from {_listed(words)}."] if words else []
    return texts


def _tighten(bounds: Bounds, limits: Sequence[KeptLimit]) -> list[str]:
    """Sentences about tolerances that satisfy limits, from the polynomials of the study. Nominal values must satisfy
    these limits."""
    columns, box = [_column(bounds, limit) for limit in limits], bounds.box
    if limits and bounds._left_out:
        return ["Give intervals that contain the nominal values, to find tolerances that satisfy the limits."]
    if not limits or box is None:
        return [_SEARCH] * bool(limits)
    nominal = [bounds.nominal_parameters.get(name, middle) for name, middle in zip(box.names, box.center, strict=True)]
    reduced, names = _Reduced(box, np.clip(box.to_unit(np.array(nominal)), -1.0, 1.0), []), dict[str, None]()
    surrogate = bounds.good_surrogate(columns)
    if surrogate is None or any(np.isfinite(limit.between) for limit in limits):  # polynomials are for output times
        return _searched(bounds, reduced, limits)
    for limit, k in zip(limits, columns, strict=True):
        part, one = surrogate.part(slice(None), [k]), np.ones(len(box))
        extremes = part.part([limit.row], [0]).range(-one, one)[2][:, 0, 0]
        names |= dict.fromkeys(_acting(bounds, k, limit.row, extremes[SIDES.index(bounds._side(limit))]))
        rows = np.flatnonzero(reduced.violated(limit, part, 1.0, ()))  # at other times, smaller boxes satisfy it too
        reduced.parts.extend([(limit, part.part(rows, [0]))] if len(rows) else [])
    if not reduced.parts:  # runs violate limits that the polynomials satisfy
        return _searched(bounds, reduced, limits)
    return _proposed(reduced, limits, [*names][:_MOST_LISTED]) or _searched(bounds, reduced, limits)


def _searched(bounds: Bounds, reduced: "_Reduced", limits: Sequence[KeptLimit]) -> list[str]:
    """The common factor of all tolerances that satisfies limits, from further runs of a scene, which cost little."""
    study = bounds.study
    if not isinstance(study, Study) or not study.has_lanes:
        return [_SEARCH]
    ends = {own.output: (own.low, own.high) for own in limits}
    try:
        with warnings.catch_warnings(action="ignore", category=SymmbWarning):
            found = tolerances(study.simulator, ends, bounds.box)
    except SymmbError:
        return [_SEARCH]
    factor, case = _ROUNDED * found.factor, found.binding
    if case is None or not _LEAST_PART <= factor < 1:
        return [_SEARCH]
    point = reduced.box.to_unit(np.array([case.parameters[name] for name in reduced.box.names]))
    some = _acting(bounds, bounds.names.index(case.output), int(np.abs(bounds.t - case.time).argmin()), point)
    return [reduced.all_by(factor, limits, some[:_MOST_LISTED] or reduced.box.names[:_MOST_LISTED]), _BY_RUNS]


@dataclass(frozen=True)
class _Reduced:
    """Tolerances multiplied by a factor about the nominal values, which are `middle` (d,) in the unit box.

    `parts` are the limits that the whole box violates, with polynomials of the outputs at the times of violations.
    """

    box: Box
    middle: Array
    parts: list[tuple[KeptLimit, Piecewise]]

    def ends(self, factor: float, names: Sequence[str]) -> tuple[Array, Array]:
        """Ends (d,) of the unit box after the tolerances of some parameters are multiplied by a factor."""
        low, high = (self.middle + factor * (end - self.middle) for end in (-1.0, 1.0))
        is_reduced = np.isin(self.box.names, names)
        return np.where(is_reduced, low, -1.0), np.where(is_reduced, high, 1.0)

    def violated(self, limit: KeptLimit, part: Piecewise, factor: float, names: Sequence[str]) -> Mask:
        """Mask of the times at which the output may violate its limit."""
        low, high, _ = part.range(*self.ends(factor, names))
        return ((low - part.error < limit.low) | (high + part.error > limit.high))[:, 0]

    def largest(self, names: Sequence[str]) -> float:
        """The largest factor for the tolerances of some parameters that satisfies the limits; 0 if there is none."""
        low, high, factor = 0.0, 1.0, 0.0
        for _ in range(12):
            if any(self.violated(*part, factor, names).any() for part in self.parts):
                high = factor
            else:
                low = factor
            factor = 0.5 * (low + high)
        return _ROUNDED * low

    def all_by(self, factor: float, limits: Sequence[KeptLimit], some: Sequence[str]) -> str:
        """A sentence about all tolerances, multiplied by a factor, with the changes of some."""
        changes = _listed([self.change(n, factor) for n in some])
        return f"{_goal(limits)}, multiply all tolerances by {factor:.3g}, such as {changes}."

    def change(self, name: str, factor: float) -> str:
        """The change of a tolerance in words."""
        i, x = self.box.names.index(name), self.box.from_unit(self.middle)
        old, new = ([self.box.from_unit(end)[i] for end in self.ends(f, [name])] for f in (1.0, factor))
        return f"{name} from {_tolerance(x[i], *old)} to {_tolerance(x[i], *new)} {_units(self.box)[i]}".rstrip()


def _goal(limits: Sequence[KeptLimit]) -> str:
    return f"To keep {_listed([f'{_named(limit)} {_inside(limit)}' for limit in limits[:_MOST_LISTED]])}"


def _proposed(reduced: _Reduced, limits: Sequence[KeptLimit], some: Sequence[str]) -> list[str]:
    """Tolerances of single parameters, or of all together, that satisfy the limits; empty if there are none."""
    goal = _goal(limits)
    factors = {name: reduced.largest([name]) for name in some}
    if best := sorted((n for n in some if factors[n] >= _LEAST_PART), key=lambda n: -factors[n])[:_MOST_PARAMETERS]:
        changes = [reduced.change(n, factors[n]) for n in best]
        if len(best) == 1:
            return [f"{goal}, tighten this tolerance: {changes[0]}.", _AGAIN]
        shared = f"Or multiply the tolerances of {_listed(best)} by {reduced.largest(best):.3g}."
        return [f"{goal}, tighten one of these tolerances: {_listed(changes, 'or')}. {shared}", _AGAIN]
    if (factor := reduced.largest(reduced.box.names)) >= _LEAST_PART:
        return [reduced.all_by(factor, limits, some), _AGAIN]
    return []  # with the error of the polynomials, no factor is large enough


def _tolerance(nominal: float, low: float, high: float) -> str:
    """The text of an interval, as in engineering drawings."""
    above, below = high - nominal + 0.0, nominal - low + 0.0
    is_even = abs(above - below) <= SLIGHT * (high - low)
    return f"{nominal:.6g} ± {above:.3g}" if is_even else f"{nominal:.6g} +{above:.3g} −{below:.3g}"
