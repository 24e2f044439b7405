"""What a report says first: whether limits are kept, and what to do next, in sentences."""

from collections.abc import Sequence

import numpy as np

from symmb._errors import SymmbError
from symmb._table import is_timeless
from symmb.bounds import ROUNDING, SIDES, Bounds, Contributions, KeptLimit, LimitCheck
from symmb.report.narrowing import Narrowing

_STATES: dict[bool | None, str] = {False: "violated", None: "undecided", True: "kept"}
"""Names of results of limits, the most urgent first."""
_SAID = {False: ("may be violated",) * 2, None: ("is not decided", "are not decided"), True: ("is kept", "are kept")}
_MANY, _FEW = 10, 3
"""Limits or ranges that have a sentence, and parameters that one sentence names."""
_FAR, _SMALL = 0.5, 0.05
"""Distance from the middle, over the half width, from which a value is high or low; the share of the largest
contribution below which a parameter is not named, and the factor of a tolerance below which it is not narrowed."""
_CERTAIN = {
    "enclosure": "The bounds behind these sentences are proved.",
    "sampled": "Only the {} cases that were run are known: others may lie farther out.",
    "estimate": "These are estimates from {} runs, not proofs. The annex tells their errors.",
}
_SEARCH = "`mb.tolerances(...)` searches, with further runs, for tolerances that keep the limits."
_AGAIN = "These tolerances are estimates: repeat the study with them before a drawing changes."


def by_urgency(check: LimitCheck) -> list[KeptLimit]:
    """Violated limits first, then those that are not decided."""
    return sorted(check.limits, key=lambda limit: [*_STATES].index(limit.kept))


def verdict(bounds: Bounds, check: LimitCheck | None, shares: Contributions | None) -> list[tuple[str, str]]:
    """Sentences about all limits, about each limit or range, and about certainty, each with a result or ""."""
    if check is None:
        head, some = ("", "No limits were given. These are the ranges within the tolerances."), _ranges(bounds)
    else:
        head = _STATES[check.kept], _headline([limit.kept for limit in check.limits])
        some = [(_STATES[limit.kept], _sentence(bounds, limit, shares)) for limit in by_urgency(check)]
    left = [("", f"The annex tells the other {len(some) - _MANY}.")] * (len(some) > _MANY)
    certain = [_CERTAIN[bounds.kind].format(bounds.evaluations)]
    if bounds.failed:
        certain.append(f"{len(bounds.failed)} of {bounds.evaluations} runs failed: these cases are not known.")
    if n := len(bounds.doubts):
        certain.append(f"{'A warning tells' if n == 1 else f'{n} warnings tell'} what cannot be trusted: see the annex.")
    return [head, *some[:_MANY], *left, *(("", text) for text in certain)]


def _headline(results: Sequence[bool | None]) -> str:
    n, counts = len(results), {state: results.count(state) for state in _STATES if state in results}
    words = [f"{count} {_SAID[state][count > 1]}" for state, count in counts.items()]
    if len(words) > 1:
        return f"Of {n} limits, {_listed(words)}."
    subject, (state,) = ("The limit" if n == 1 else f"All {n} limits"), counts
    return f"{subject} {_SAID[state][n > 1]}{' in all cases within the tolerances' if state else ''}."


def next_steps(bounds: Bounds, check: LimitCheck | None, shares: Contributions | None) -> list[str]:
    """What decides limits, which tolerances to tighten and by how much, and which parameters matter most."""
    if check is None:
        return ["Give limits of outputs: the report then tells whether they are kept.", *_spread(bounds, {}, shares)]
    texts = [f"{limit.output}: {limit.why}" for limit in check.limits if limit.kept is None][:_MANY]
    beyond = [limit for limit in by_urgency(check) if not limit.kept and limit.margin[limit.row] < 0]
    lost = {limit.output: excess for limit in beyond if (excess := _nominal_excess(bounds, limit)) > 0}
    texts += [
        f"{limit.output} misses its limit by {_amount(lost[limit.output], limit.unit)} at the nominal values, which no "
        "tolerance cures: change the nominal values or the limit."
        for limit in beyond
        if limit.output in lost
    ][:_MANY]
    texts += _tighten(bounds, [limit for limit in beyond if limit.output not in lost], shares)
    rows = {bounds.names.index(limit.output): limit.row for limit in by_urgency(check)}
    return [*(texts or ["No tolerance has to be tightened."]), *_spread(bounds, rows, shares)]


def _amount(value: float, unit: str, digits: int = 3) -> str:
    return f"{value + 0.0:.{digits}g}{' ' * bool(unit)}{unit}"


def _inside(limit: KeptLimit) -> str:
    """The limits as they stand behind "is"."""
    low, high = _amount(limit.low, "", 6), _amount(limit.high, limit.unit, 6)
    if np.isfinite(limit.low) and np.isfinite(limit.high):
        return f"between {low} and {high}"
    return f"at most {high}" if np.isfinite(limit.high) else f"at least {_amount(limit.low, limit.unit, 6)}"


def _nominal_excess(bounds: Bounds, limit: KeptLimit) -> float:
    """How far the nominal run is beyond the limit, below 0 inside, or where it is not known."""
    if bounds.nominal is None:
        return -np.inf
    values = bounds.nominal[:, bounds.names.index(limit.output)]
    return float(max((limit.low - values).max(), (values - limit.high).max()))


def _sentence(bounds: Bounds, limit: KeptLimit, shares: Contributions | None) -> str:
    name, k, i, margin = limit.output, bounds.names.index(limit.output), limit.row, float(limit.margin[limit.row])
    is_timeless_output = name in bounds.figures or is_timeless(bounds.t)
    where = ("" if is_timeless_output else f", at {bounds.t[i]:.4g} s") + _when(bounds, limit, shares)
    least = f"The smallest margin is {_amount(margin, limit.unit)}{where}."
    if limit.kept:
        return f"{name} is {_inside(limit)} in all cases within the tolerances. {least}"
    side = SIDES[int(bounds.lower[i, k] - limit.low >= limit.high - bounds.upper[i, k])]
    side = limit.further.side if limit.further else side
    verb, end = ("fall below", limit.low) if side == "lower" else ("exceed", limit.high)
    text = f"{name} may {verb} its limit of {_amount(end, limit.unit, 6)} by {_amount(-margin, limit.unit)}{where}"
    if limit.kept is False:
        also = " The nominal values violate it too." if _nominal_excess(bounds, limit) > 0 else ""
        return f"{text}.{also}"
    known = least if margin >= 0 else f"The bounds say: {text}."
    return f"It is not decided whether {name} is {_inside(limit)}. {known}"


def _when(bounds: Bounds, limit: KeptLimit, shares: Contributions | None) -> str:
    """Which parameters are high or low in the run that comes closest to the limit."""
    try:
        case = bounds._closest_to([limit])
    except SymmbError:  # the run does not come again
        return ""
    if case is None or bounds.box is None or case.is_short or case.width <= ROUNDING * abs(case.value):
        return ""
    place = bounds.box.to_unit(np.array([case.parameters[name] for name in bounds.box.names]))
    far = {n: x for n, x in zip(bounds.box.names, place.tolist(), strict=True) if n in case.varied and abs(x) >= _FAR}
    names = [name for name in _important(bounds, bounds.names.index(limit.output), limit.row, shares) if name in far]
    words = [f"{n} is {'high' if far[n] > 0 else 'low'} ({case.parameters[n]:.4g})" for n in names[:_FEW]]
    return f", when {_listed(words)}" if words else ""


def _important(bounds: Bounds, k: int, i: int, shares: Contributions | None) -> list[str]:
    """Parameters by what they contribute to output number k at time number i; all of them if that is not known."""
    if shares is None:
        return [] if bounds.box is None else [*bounds.box.names]
    alone = dict(zip(shares.parameters, shares.alone[i, k].tolist(), strict=True))
    return [n for n in sorted(alone, key=lambda n: -alone[n]) if alone[n] > _SMALL * max(alone.values())]


def _listed(words: Sequence[str], last: str = "and") -> str:
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)


def _ranges(bounds: Bounds) -> list[tuple[str, str]]:
    units = bounds.units or ("",) * len(bounds.names)
    ends = zip(bounds.names, bounds.lower.min(axis=0), bounds.upper.max(axis=0), units, strict=True)
    return [("", f"{name} lies between {_amount(a, '', 4)} and {_amount(b, unit, 4)}.") for name, a, b, unit in ends]


def _spread(bounds: Bounds, rows: dict[int, int], shares: Contributions | None) -> list[str]:
    """Which parameters contribute most to widths, at numbers of times by those of outputs, or where they are widest."""
    texts, units = list[str](), bounds.units or ("",) * len(bounds.names)
    for k in list(rows or range(len(bounds.names)))[: _FEW if shares else 0]:
        assert shares is not None
        i = rows.get(k, int(shares.width[:, k].argmax()))
        alone = dict(zip(shares.parameters, shares.alone[i, k].tolist(), strict=True))
        names = [f"{n} ({_amount(alone[n], units[k])} alone)" for n in _important(bounds, k, i, shares)[:_FEW]]
        width = _amount(shares.width[i, k], units[k])
        texts += [f"The spread of {bounds.names[k]}, {width}, comes from {_listed(names)}."] if names else []
    return texts


def _tighten(bounds: Bounds, limits: Sequence[KeptLimit], shares: Contributions | None) -> list[str]:
    """Which tolerances keep limits that the nominal values keep, by the polynomials of the study."""
    columns = [bounds.names.index(limit.output) for limit in limits]
    if not limits:
        return []
    if bounds.box is None or (surrogate := bounds.good_surrogate(columns)) is None:
        return [_SEARCH]
    parts = [(limit, surrogate.part(slice(None), [k])) for limit, k in zip(limits, columns, strict=True)]
    narrowing = Narrowing(bounds.box, bounds.nominal_parameters, parts)
    if narrowing.factor(bounds.box.names) == 1.0:  # runs are beyond a limit that polynomials keep
        return [_SEARCH]
    places = zip(columns, (limit.row for limit in limits), strict=True)
    names = list(dict.fromkeys(name for k, i in places for name in _important(bounds, k, i, shares)))[:_MANY]
    goal = f"To keep {_listed([f'{limit.output} {_inside(limit)}' for limit in limits[:_MANY]])}"
    factors = {name: narrowing.factor([name]) for name in names}
    if best := sorted((n for n in names if factors[n] >= _SMALL), key=lambda n: -factors[n])[:_FEW]:
        one = "tighten one of these tolerances" if len(best) > 1 else "tighten this tolerance"
        return [f"{goal}, {one}: {_listed([narrowing.change(n, factors[n]) for n in best], 'or')}.", _AGAIN]
    if (factor := narrowing.factor(bounds.box.names)) >= _SMALL:
        changes = _listed([narrowing.change(n, factor) for n in names[:_FEW]])
        return [f"{goal}, multiply all tolerances by {factor:.2f}: {changes}.", _AGAIN]
    return [f"{goal}, change the nominal values: they are so close to the limit that tolerances hardly help."]
