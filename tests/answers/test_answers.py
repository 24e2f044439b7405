"""One table of functions whose ranges and other answers are known, and every answer of a study of each of them."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.stats as st
from black_boxes import black_box, quietly

import symmb as mb

T = np.array([0.0, 1.0, 2.0])
LATE = np.linspace(0.0, 2.8, 8)
FINE = np.linspace(0.0, 2.0, 21)
RISING = np.linspace(0.1, 1.0, 10)
UNIT = (-1.0, 1.0)
PI4 = 0.1 * np.pi**4
VARIANCES = 0.5 * (1 + PI4 / 5) ** 2, 7**2 / 8, 8 * PI4**2 / 225
"""Of the parts sin x, sin^2 y, and of x and z together, of Ishigami and Homma's function (Sobol' and Levitan 1999)."""


@dataclass(frozen=True)
class Row:
    """A function of parameters, and what is true over its box. None is not asked for."""

    f: Any  # (parameters) -> n_t n_y values
    box: dict
    low: Any  # true bounds, broadcast to (n_y, n_t)
    high: Any
    times: Any = (0.0,)
    outputs: str = "y"
    nominal: dict | None = None
    worst: Any = None  # side -> parameters of the worst case of the first output, if there is but one
    alone: Any = None  # contributions, broadcast to (n_y, n_t, d)
    saved: Any = None
    first: Any = None  # Sobol indices, as well
    total: Any = None
    share_error: float = 0.05  # largest estimated error of the indices
    takes_runs: bool | None = None  # whether contributions make further runs
    methods: tuple = (mb.PolynomialChaos(),)  # of the contributions
    chances: tuple | None = None  # (above, below, probabilities at all times, probability at any time or None), ...
    quantiles: dict | None = None  # level -> quantiles at all times
    tolerance: tuple | None = None  # limits of the first output, the factor, and the side that binds
    estimate: float = 0.011  # largest estimate of bounds, divided by the width
    overrun: float = 1.0  # largest error of bounds, divided by its estimate
    is_doubtful: bool = False  # whether studies warn of their errors
    closest: float = 0.003  # least distance of limits that are decided, divided by the width


def indices(*variances, whole=None):
    return np.array(variances) / (whole or sum(variances))


HALF, WEIGHTS = np.array([0.1, 0.02, 0.05]), np.arange(1.0, 6.0)
PARABOLA = 4 / 45 + np.array([0.36, 0.16]) / 3
"""Variances of (a - 0.3)^2 and (b + 0.2)^2."""
SINES = np.stack([0.2 * np.sin(FINE), 0.25 * FINE], axis=1)
"""Widths of a sin t and b^2 t."""
SUM = np.stack([1 + 0 * T, 9 * T**2], axis=1) / (1 + 9 * T[:, None] ** 2)
CREASES = np.array([1.0, 2.0, 9.0])
PARTS = 1 / 3 / (1 + CREASES) ** 2
WHOLE = np.prod(1 + PARTS) - 1

ROWS = {
    "linear": Row(
        lambda a, b, c: a + b - c, {"a": (0.9, 1.1), "b": (1.98, 2.02), "c": (2.85, 2.95)}, -0.07, 0.27,
        worst={"lower": {"a": 0.9, "b": 1.98, "c": 2.95}, "upper": {"a": 1.1, "b": 2.02, "c": 2.85}},
        alone=2 * HALF, saved=2 * HALF, first=indices(*HALF**2), total=indices(*HALF**2),
        chances=((0.1, None, 0.5, 0.5),), quantiles={0.5: 0.1}, tolerance=((None, 0.25), 0.15 / 0.17, "upper"),
    ),
    "sum over time": Row(
        lambda a, b: a + b * T, {"a": (0, 1), "b": (0, 1)}, 0, 1 + T, T,
        worst={"upper": {"a": 1, "b": 1}}, quantiles={0.5: 0.5 + T / 2},
        chances=((1.0, None, [0, 0.5, 0.75], 0.75), (1.5, 0.5, [0.5, 0.25, 0.5625], 0.8125)),
    ),
    "sum and product over time": Row(
        lambda a, b: np.stack([1 + a + 3 * b * T, -a * b * T], axis=1), {"a": (0.0, 2.0), "b": UNIT},
        [1 - 3 * T, -2 * T], [3 + 3 * T, 2 * T], T, "y product", {"a": 0.5},
        worst={"lower": {"a": 0, "b": -1}, "upper": {"a": 2, "b": 1}},
        alone=[[[2, 0], [2, 6], [2, 12]], [[0, 0], [0, 1], [0, 2]]],
        saved=[[[2, 0], [2, 6], [2, 12]], [[0, 0], [3, 4], [6, 8]]],
        first=[SUM, [[np.nan] * 2, [0, 0.75], [0, 0.75]]], total=[SUM, [[np.nan] * 2, [0.25, 1], [0.25, 1]]],
        share_error=1e-3, tolerance=((None, 6), 4.5 / 7.5, "upper"),
        methods=(
            mb.PolynomialChaos(), mb.PolynomialChaos(order=2), mb.PolynomialChaos.paper(2), mb.Vertex(),
            mb.MonteCarlo(50), mb.Scanning(3), mb.Swarm(50),
        ),
    ),
    "one parameter with its extreme inside": Row(
        lambda x: 1 - (x - 0.3) ** 2, {"x": UNIT}, -0.69, 1, worst={"lower": {"x": -1}, "upper": {"x": 0.3}},
        alone=1.69, saved=1.69, first=1, total=1,
        chances=((0.75, None, 0.5, 0.5),), quantiles={0.5: 0.75}, tolerance=((0.0, 1.001), 0.7, "lower"),
    ),
    "hill": Row(
        lambda a, b: -((a - 0.3) ** 2) - (b + 0.2) ** 2, {"a": UNIT, "b": UNIT}, -3.13, 0,
        worst={"lower": {"a": -1, "b": 1}, "upper": {"a": 0.3, "b": -0.2}}, alone=[1.69, 1.44], saved=[1.69, 1.44],
        first=indices(*PARABOLA), total=indices(*PARABOLA),
        tolerance=((-2, None), (np.sqrt(1 + 8 * 1.87) - 1) / 4, "lower"),
    ),
    "sine of one of three": Row(
        lambda a, b, c: np.sin(np.pi * a), dict.fromkeys("abc", UNIT), -1, 1,
        worst={"lower": {"a": -0.5}, "upper": {"a": 0.5}},
        alone=[2, 0, 0], saved=[2, 0, 0], first=[1, 0, 0], total=[1, 0, 0],
        chances=((0.5, None, 1 / 3, 1 / 3),), quantiles={0.5: 0, 2 / 3: 0.5}, tolerance=((None, 0.5), 1 / 6, "upper"),
    ),
    "product of two of four": Row(  # nothing along the axes
        lambda a, b, c, d: a * b, dict.fromkeys("abcd", UNIT), -1, 1,
        alone=0, saved=[2, 2, 0, 0], first=0, total=[1, 1, 0, 0],
        chances=((0.5, None, (1 - 0.5 * (1 + np.log(2))) / 2, None),), quantiles={0.5: 0},
        tolerance=((None, 0.25), 0.5, "upper"),
    ),
    "product beside a line": Row(
        lambda a, b, c, d, e, g: a + 5 * b * c * d, dict.fromkeys("abcdeg", UNIT), -6, 6,
        alone=[2, 0, 0, 0, 0, 0], saved=[2, 10, 10, 10, 0, 0],
        first=indices(1 / 3, 0, 0, 0, 0, 0, whole=34 / 27), total=indices(1 / 3, *[25 / 27] * 3, 0, 0, whole=34 / 27),
        tolerance=((None, 1.125), 0.5, "upper"),
    ),
    "cosine of a difference": Row(  # the same at all of the first nodes
        lambda a, b: 1 + np.cos(np.pi * (a - b)), {"a": UNIT, "b": UNIT}, 0, 2, alone=2, saved=0, first=0, total=1,
        chances=((1, None, 0.5, 0.5),), quantiles={0.5: 1}, tolerance=((1, None), 0.25, "lower"),
    ),
    "five parameters": Row(
        lambda **p: WEIGHTS @ [*p.values()], dict.fromkeys("abcde", UNIT), -15, 15,
        worst={"lower": dict.fromkeys("abcde", -1), "upper": dict.fromkeys("abcde", 1)},
        alone=2 * WEIGHTS, saved=2 * WEIGHTS, first=indices(*WEIGHTS**2), total=indices(*WEIGHTS**2),
        chances=((0, None, 0.5, 0.5),), tolerance=((None, 6), 0.4, "upper"),
    ),
    "Ishigami and Homma": Row(  # all but z alone, as sin x is 0 at its nominal value
        lambda x, y, z: np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x),
        dict.fromkeys("xyz", (-np.pi, np.pi)), -1 - PI4, 8 + PI4,
        alone=[2, 7, 0], saved=[2 + 2 * PI4, 7, 2 * PI4], takes_runs=False,
        first=indices(*VARIANCES[:2], 0, whole=sum(VARIANCES)),
        total=indices(VARIANCES[0] + VARIANCES[2], *VARIANCES[1:], whole=sum(VARIANCES)),
        methods=(mb.PolynomialChaos(tolerance=1e-3, seconds=600.0),),
    ),
    "waves": Row(
        lambda a, b: np.stack([a * np.sin(FINE) + b**2 * FINE, -a * np.sin(FINE) - b**2 * FINE], axis=1),
        {"a": (0.9, 1.1), "b": (-0.5, 0.5)}, [0.9 * np.sin(FINE), -1.1 * np.sin(FINE) - 0.25 * FINE],
        [1.1 * np.sin(FINE) + 0.25 * FINE, -0.9 * np.sin(FINE)], FINE, "y z", {"a": 1.0, "b": 0.1},
        alone=SINES, saved=SINES,
    ),
    "oscillation": Row(
        lambda w: np.cos(w * LATE), {"w": (0.9, 1.1)}, np.cos(1.1 * LATE), np.cos(0.9 * LATE), LATE,
        worst={"lower": {"w": 1.1}}, alone=(np.cos(0.9 * LATE) - np.cos(1.1 * LATE))[:, None],
        saved=(np.cos(0.9 * LATE) - np.cos(1.1 * LATE))[:, None], first=[[np.nan]] + [[1]] * 7,
        quantiles={p: np.cos((1.1 - 0.2 * p) * LATE) for p in (0.1, 0.5, 0.9)},
        tolerance=((np.cos(1.05 * 2.8), None), 0.5, "lower"),
    ),
    "crease off the centre": Row(
        lambda a, b, c, d, e: RISING * (abs(a - 0.3 * b) + c * d + 0.2 * e * a), dict.fromkeys("abcde", UNIT),
        -1.06 * RISING, 2.5 * RISING, RISING, overrun=4.0, is_doubtful=True,
        alone=np.outer(RISING, [1, 0.3, 0, 0, 0]),
        saved=np.outer(RISING, [1.26, 0.36, 2, 2, 0.26]),
        tolerance=((None, 2.0), (np.sqrt(1.3**2 + 4.8 * 2.0) - 1.3) / 2.4, "upper"),
    ),
    "crease of one parameter": Row(
        lambda x: abs(x - 0.123), {"x": UNIT}, 0, 1.123, worst={"lower": {"x": 0.123}, "upper": {"x": -1}},
        alone=1.123, first=1, total=1, chances=((0.5, None, 0.5, 0.5),), tolerance=((None, 0.623), 0.5, "upper"),
    ),
    "product of creases": Row(  # of Sobol', whose indices come from least squares: no polynomial is good
        lambda **p: np.prod((2 * np.abs([*p.values()]) + CREASES) / (1 + CREASES)), dict.fromkeys("abc", UNIT),
        np.prod(CREASES / (1 + CREASES)), np.prod((2 + CREASES) / (1 + CREASES)),
        alone=np.prod(CREASES / (1 + CREASES)) * 2 / CREASES, first=PARTS / WHOLE,
        total=PARTS / (1 + PARTS) * (1 + WHOLE) / WHOLE, methods=(mb.PolynomialChaos(budget=27),), estimate=0.05,
    ),
    "jump": Row(
        lambda a, b, c: (a > 0.3) + 0.1 * b, {"a": UNIT, "b": UNIT, "c": (1, 1)}, -0.1, 1.1,
        alone=[1, 0.2, 0], saved=[1, 0.2, 0], share_error=0.1, takes_runs=True,
        first=indices(0.2275, 0.01 / 3, 0), total=indices(0.2275, 0.01 / 3, 0),
        chances=((0.5, None, 0.35, 0.35),), quantiles={0.325: 0},
    ),
    "constant": Row(
        lambda a: np.full_like(T, 3.0), {"a": (0, 2)}, 3, 3, T, alone=0, saved=0, first=np.nan, total=np.nan,
        chances=((2.5, None, 1, 1), (3.5, None, 0, 0)), quantiles={0.5: 3},
    ),
}  # fmt: skip


def rows(*fields):
    """Tests of the rows in which these fields are known."""
    known = [name for name, row in ROWS.items() if all(getattr(row, field) is not None for field in fields)]
    return pytest.mark.parametrize("name", known)


def called(name, call, *arguments):
    return quietly(call, *arguments) if ROWS[name].is_doubtful else call(*arguments)


def made(name):
    row = ROWS[name]
    return black_box(row.f, row.times, row.outputs, nominal=row.nominal, **row.box)


@cache
def bounds_of(name, method=mb.PolynomialChaos()):  # noqa: B008
    simulator, box = made(name)
    return called(name, mb.propagate, simulator, method, box)


def true(name):
    """True bounds (2, n_t, n_y), and the width of each output over all times."""
    row = ROWS[name]
    shape = len(row.outputs.split()), len(row.times)
    both = np.array([np.broadcast_to(np.array(end, dtype=float), shape).T for end in (row.low, row.high)])
    return both, both[1].max(axis=0) - both[0].min(axis=0)


@rows()
def test_bounds_are_the_true_ones(name):
    bounds, (ends, width) = bounds_of(name), true(name)
    errors = np.abs([bounds.lower, bounds.upper] - ends).max(axis=0)
    assert (errors <= ROWS[name].overrun * bounds.estimate + 1e-9).all()
    assert (errors <= 0.011 * width + 1e-12).all()
    assert (bounds.estimate.max(axis=0) <= ROWS[name].estimate * width + 1e-12).all()


@rows()
def test_limits_are_satisfied_outside_of_the_bounds_and_violated_inside(name):
    bounds, (ends, widths) = bounds_of(name), true(name)
    for k, output in enumerate(bounds.names):
        low, high, width = ends[0, :, k].min(), ends[1, :, k].max(), widths[k] or 1.0
        for share in (-0.03, -ROWS[name].closest, 0.0, ROWS[name].closest, 0.03):
            for pair in ((low - share * width, None), (None, high + share * width)):
                check = bounds.check({output: pair})
                kept = check[output].kept
                assert kept is not False if share == 0 else kept is (share > 0), str(check)
                assert {True: "satisfied", False: "violated", None: "undecided"}[kept] in str(check)
                margin = bounds[output][0] - pair[0] if pair[1] is None else pair[1] - bounds[output][1]
                searched = check[output].further is not None
                np.testing.assert_allclose(check[output].margin, margin, rtol=0, atol=0.011 * width * searched)
                case, side, bound = check.worst, *(("lower", low) if pair[1] is None else ("upper", high))
                assert case.attained == pytest.approx(bound, rel=0.02, abs=1e-6)
                at = np.abs(bounds.t - case.time).argmin()
                assert case.run()[at, k] == pytest.approx(case.attained, abs=1e-12)
                check_parameters(name, k, side, case)


def check_parameters(name, k, side, case):
    parameters = (ROWS[name].worst or {}).get(side, {}) if k == 0 else {}
    assert {key: case.parameters[key] for key in parameters} == pytest.approx(parameters, abs=1e-3)


@rows()
def test_worst_cases_are_those_of_the_closed_form(name):
    bounds, (ends, widths) = bounds_of(name), true(name)
    for k, output in enumerate(bounds.names):
        for side, end in (("lower", ends[0, :, k].min()), ("upper", ends[1, :, k].max())):
            case = getattr(bounds.worst(output), side)
            at = int(np.abs(bounds.t - case.time).argmin())
            assert [case.value, case.attained] == pytest.approx([end, end], abs=0.011 * widths[k] + 1e-12)
            assert case.value == pytest.approx(bounds[output][side == "upper"][at], rel=1e-12, abs=1e-12)
            assert case.run()[at, k] == pytest.approx(case.attained, abs=1e-12)
            assert -1e-9 <= case.shortfall <= 0.1 * case.width + 1e-9
            check_parameters(name, k, side, case)


CONTRIBUTING = [(name, own) for name, row in ROWS.items() if row.alone is not None for own in row.methods]


@pytest.mark.parametrize(("name", "method"), CONTRIBUTING, ids=repr)
def test_contributions_are_those_of_the_closed_form(name, method):
    row, found = ROWS[name], bounds_of(name, method).contributions(runs=100_000)
    assert row.takes_runs in (None, found.runs > 0)
    shape = len(row.outputs.split()), len(row.times), len(row.box)

    def exact_of(kind):
        return np.broadcast_to(getattr(row, kind), shape).transpose(1, 0, 2)

    for kind, error in {"alone": found.estimate, "saved": found.saved_estimate}.items():
        if getattr(row, kind) is not None:
            assert (np.abs(getattr(found, kind) - exact_of(kind)) <= error[..., None] + 1e-9).all(), kind
            assert (error <= 0.1 * found.width + 1e-9).all()
    for kind in ("first", "total"):
        if getattr(row, kind) is not None:
            error = np.abs(getattr(found, kind) - exact_of(kind))
            assert (np.isnan(exact_of(kind)) == np.isnan(error)).all()
            assert (np.isnan(error) | (error <= found.share_estimate[..., None] + 1e-9)).all(), kind
            assert np.nanmax(found.share_estimate, initial=0) <= row.share_error


def even(name):
    return {key: st.uniform(low, high - low) for key, (low, high) in ROWS[name].box.items() if low < high}


@rows("chances")
def test_probabilities_are_those_of_the_closed_form(name):
    bounds, row = bounds_of(name), ROWS[name]
    for above, below, exact, ever in row.chances:
        found = bounds.probability(bounds.names[0], above=above, below=below, laws=even(name), runs=10_000)
        assert (np.abs(found.lower - exact) <= found.estimate + 1e-9).all() and (found.estimate < 0.02).all()
        parts = [f"{word} {level:g}" for word, level in (("below", below), ("above", above)) if level is not None]
        assert found.event == f"{bounds.names[0]} {' or '.join(parts)}"
        assert ever is None or abs(found.ever[0] - ever) <= found.ever[2] < 0.02


@rows("quantiles")
def test_quantiles_are_those_of_the_closed_form(name):
    row, levels = ROWS[name], [*ROWS[name].quantiles]
    found = bounds_of(name).quantiles(row.outputs.split()[0], levels, laws=even(name), runs=10_000)
    exact = np.array([np.broadcast_to(row.quantiles[level], len(row.times)) for level in levels])
    assert (np.abs(found.lower - exact) <= found.estimate + 1e-9).all() and (found.lower == found.upper).all()
    assert (found.estimate <= 0.05 * true(name)[1][0] + 1e-9).all()


TOLERANCES = [(name, *row.tolerance) for name, row in ROWS.items() if row.tolerance is not None]
TOLERANCES += [("linear", (0.02, None), 0.08 / 0.17, "lower"), ("linear", (-1.0, 0.6), 0.5 / 0.17, "upper")]


@pytest.mark.parametrize(("name", "limits", "factor", "side"), TOLERANCES)
def test_tolerances_end_at_the_limit(name, limits, factor, side):
    (simulator, box), k = made(name), ("lower", "upper").index(side)
    found = called(name, mb.tolerances, simulator, {simulator.outputs[0]: limits}, box)
    assert (1 - 2e-3) * factor <= found.factor <= factor * (1 + 1e-9)
    middle = np.array([simulator.parameters[key] for key in box.names])
    for own, given in ((found.box.lower, box.lower), (found.box.upper, box.upper)):
        np.testing.assert_allclose(own - middle, found.factor * (given - middle), atol=1e-12)
    assert found.check.kept and (found.binding.output, found.binding.side) == (simulator.outputs[0], side)
    reached = (np.min, np.max)[k](simulator.run([[*found.binding.parameters.values()]]).Y[0, :, 0])
    assert reached == pytest.approx(limits[k], rel=5e-3, abs=5e-3 * (limits[k] == 0))
