"""Boxes with choices, sets of values and constraints, against scans of all combinations and of allowed points."""

from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
import pytest
from black_boxes import errors_of, reloaded
from faults import refused, warned
from machines import spring_mass

import symmb as mb

T = np.linspace(0.0, 2.0, 5)
NOMINAL = {"a": 1.0, "k": 100.0, "c": 2.0, "n": 17.0}
SPRING = {"soft": {"k": 100.0, "c": 2.0}, "very hard": {"k": 200.0, "c": 3.0}}
WHOLE = mb.Box(a=(0.5, 2.0), n={17, 18, 19}, spring=SPRING)


def responses(a, k, c, n):
    return np.stack([k * a * np.sin(3 * T + c) + (n - 17.6) ** 2 * T, a * T + 0.01 * k])


def study(box=WHOLE, method=None):
    return mb.propagate(mb.FunctionSimulator(lambda **p: responses(**p).T, NOMINAL, T, ["x", "y"]), method, box)


def ends(f, box, **nominal):
    """Bounds of a function of one output at one time, and their study."""
    bounds = mb.propagate(mb.FunctionSimulator(lambda **p: [f(**p)], nominal, [0.0], ["y"]), None, box)
    return (bounds.lower[0, 0], bounds.upper[0, 0]), bounds


def scanned(box, points=401):
    """Extremes (n_y, n_t) over allowed points of a grid, and the parameters of the highest x."""
    values = [np.linspace(low, high, points if low < high else 1) for low, high in box.bounds]
    X = np.array([*product(*values)])
    own = [NOMINAL | dict(zip(box.names, x, strict=True)) for x in X[box.allowed(X)]]
    Y = np.array([responses(**p) for p in own])
    return Y.min(axis=0), Y.max(axis=0), own[int(Y[:, 0].max(axis=1).argmax())]


def test_bounds_over_all_combinations():
    bounds = study()
    low, high, worst = zip(*map(scanned, WHOLE.combinations()), strict=True)
    np.testing.assert_allclose(bounds.lower.T, np.min(low, axis=0), atol=1e-3)
    np.testing.assert_allclose(bounds.upper.T, np.max(high, axis=0), atol=1e-3)
    case = bounds.worst("x").upper
    own = max(zip(high, worst, strict=True), key=lambda pair: pair[0][0].max())[1]
    assert case.parameters == pytest.approx(own)
    assert case.choices == (f"spring: {'soft' if own['k'] == 100 else 'very hard'}",)
    assert len(bounds.parts) == 6
    assert bounds.evaluations == sum(study(part.box).evaluations for part in bounds.parts)


def test_limits_are_decided_by_the_worst_combination():
    bounds = study()
    top = max(scanned(own)[1][0].max() for own in WHOLE.combinations())
    assert bounds.check({"x": (None, 1.01 * top)}).kept is True
    check = bounds.check({"x": (None, 0.99 * top)})
    assert check.kept is False
    assert check.worst.choices == bounds.worst("x").upper.choices


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_files_keep_choices(tmp_path, suffix):
    bounds = study()
    loaded = reloaded(bounds, tmp_path / f"b{suffix}")
    assert loaded.box == WHOLE
    assert str(loaded.worst("x").upper) == str(bounds.worst("x").upper)


def test_answers_that_need_intervals_are_refused():
    bounds = study()
    for answer in (bounds.contributions, lambda: bounds.quantiles("x", [0.5]), lambda: bounds.samples(9)):
        refused(r"Use box\.hull, .* or one of box\.combinations", answer)


def test_words_of_a_list_are_numbered():
    """The function has the number of the word as its parameter."""
    stiffness = (300.0, 100.0, 200.0)
    box = mb.Box(a=(0.9, 1.1), spring=["M10 hard", "soft", "usual"])
    both, bounds = ends(lambda a, spring: a * stiffness[int(spring)], box, a=1, spring=0)
    worst = bounds.worst("y")
    assert both == pytest.approx((90, 330))
    assert (worst.lower.choices, worst.upper.choices) == (("spring: soft",), ("spring: M10 hard",))
    assert mb.Box(a=["1 mm", "2 mm"]) == mb.Box(a=(1, 2, "mm"))


@pytest.mark.parametrize("method", [None, mb.MonteCarlo(2000), mb.Scanning(81)])
def test_constraints(method):
    box = mb.Box(a=(0.5, 2.0), c=(0.0, 2.0), constraints=[lambda p: p.a**2 + p.c**2 - 2, lambda p: p.c < p.a])
    bounds = study(box, method)
    low, high, _ = scanned(box)
    width = high.max() - low.min()
    slack = 3e-3 if method is None else 5e-2
    assert errors_of(bounds, low.T, high.T).max() < slack * width
    worst = bounds.worst("x").upper.parameters
    assert box.allowed(np.array([[worst["a"], worst["c"]]])).all()


def test_constraints_exclude_combinations():
    bounds = study(mb.Box(n={17, 18}, a=(1, 2), constraints=[lambda p: p.n > 17.5]))
    assert len(bounds.parts) == 1
    assert any("left out: n" in remark and "17" in remark for remark in bounds.remarks)
    refused("no combination", study, mb.Box(n={17, 18}, constraints=[lambda p: False]), error=mb.PropagationError)


def test_very_thin_sets_of_allowed_points_have_a_warning():
    thin = mb.Box(a=(-1, 1), c=(-1, 1), constraints=[lambda p: abs(p.a - p.c) - 1e-4])
    warned("satisfy the constraints, so the bounds may be too narrow", ends, lambda a, c: a + c, thin, a=0.0, c=0.0)


def test_the_nominal_run_counts_only_if_it_is_allowed():
    """y = a t + 0.01 k is 3 at the nominal a = 1, which the constraint excludes."""
    bounds = study(mb.Box(a=(0.5, 2.0), constraints=[lambda p: p.a < 0.9]))
    check = bounds.check({"y": (None, 2.9)})
    assert check.kept is True
    assert "does not include the nominal run" in str(check)


def test_forty_combinations_without_intervals_take_one_run_each():
    springs = {f"spring {i}": {"k": 100.0 + 31 * i % 90, "c": 2.0 + 17 * i % 9} for i in range(8)}
    bounds = study(mb.Box(n=set(range(15, 20)), spring=springs))
    Y = {(n, word): responses(1.0, n=n, **own) for n in range(15, 20) for word, own in springs.items()}
    assert bounds.evaluations == len(bounds.parts) == len(Y) == 40
    np.testing.assert_allclose(bounds.lower.T, np.min([*Y.values()], axis=0))
    np.testing.assert_allclose(bounds.upper.T, np.max([*Y.values()], axis=0))
    for side, sign in (("lower", -1), ("upper", 1)):
        case = getattr(bounds.worst("x"), side)
        n, word = max(Y, key=lambda own: (sign * Y[own][0]).max())
        assert (case.parameters["n"], *case.choices) == (n, f"spring: {word}")


def test_combinations_without_bounds_are_named():
    """The nut 19 breaks: the bounds of y = a n are those of 17 and 18, and no limit is satisfied."""

    def torque(a, n):
        if n > 18.5:
            raise ValueError("the nut breaks")
        return a * n

    told, own = "found for 1 of 3 combinations of choices.* With n: 19: .*the nut breaks", {"a": 1.0, "n": 17.0}
    both, bounds = warned(told, ends, torque, mb.Box(a=(1, 2), n={17, 18, 19}), **own)
    assert both == pytest.approx((17, 36))
    assert not any("left out" in remark for remark in bounds.remarks)
    assert (bounds.check({"y": (None, 50)}).kept, bounds.check({"y": (None, 30)}).kept) == (None, False)
    none, box = r"has bounds\. With n: 19: .*the nut breaks", mb.Box(a=(1, 2), n={19, 20})
    refused(none, ends, torque, box, error=mb.PropagationError, **own)


def test_recorded_runs_count_once_for_all_combinations():
    X = np.column_stack([np.linspace(0, 2, 90), np.arange(90) % 3])
    Y = X[:, 0] + X[:, 1]
    Y[[4, 70]] = np.nan
    runs, box = mb.RecordedRuns(X, Y, ["a", "n"]), mb.Box(a=(0, 2), n={0, 1, 2})
    bounds = warned("2 of 90 runs failed", mb.propagate, runs, None, box)
    assert (bounds.evaluations, len(bounds.failed), len(bounds.parts)) == (90, 2, 3)


def test_constraints_that_cannot_be_pickled_stay_in_this_process():
    """x = a cos(2 t) is at most 1 for a <= 1."""
    machine, box = spring_mass(a=0.9), mb.Box(a=(0.5, 1.5), constraints=[lambda p: p.a - 1])
    scene = machine.scene("x", [0.0, 1.0], {"ball.x": machine.p.a}, box=box)
    with ProcessPoolExecutor(1) as pool:
        bounds = mb.propagate(scene, executor=pool)
    assert bounds.upper[0, 0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"spring": {"soft", "hard"}}, "no order. Use a list of words"),
        ({"n": set()}, "at least one value"),
        ({"s": {"soft": {"k": 1}, "hard": {"c": 1}}}, "same parameters"),
        ({"k": (1, 2), "s": {"soft": {"k": 1}}}, "two intervals or choices"),
        ({"n": {1, float("nan")}}, "not a finite number"),
        ({"n": (1, 2), "constraints": lambda p: True}, "list of functions"),
    ],
)
def test_wrong_choices(given, message):
    refused(message, mb.Box, **given)


@pytest.mark.parametrize(
    ("constraint", "message"),
    [
        (lambda p: p.z > 1, r"uses 'z', which has no interval in the box\. Known are: a\."),
        (lambda p: p.a / 0 > 1, r"raises ZeroDivisionError at a = [\d.]+: "),
        (lambda p: "yes", r"True, False or a number, got 'yes' at a = [\d.]+\."),
    ],
)
def test_wrong_constraints(constraint, message):
    refused(message, study, mb.Box(a=(1, 2), constraints=[constraint]))
    refused("Vertex", study, mb.Box(a=(1, 2), constraints=[constraint]), mb.Vertex(), error=mb.PropagationError)


def test_units_of_choices():
    box = mb.Box(k={"soft": (1.0, "N/mm"), "hard": "2 N/mm"}, n={1, 2})
    assert box.with_units({"k": "N/m"}).bounds == ((1000.0, 2000.0), (1.0, 2.0))
    assert eval(repr(box), {"Box": mb.Box}) == box


def test_words_of_a_list_are_no_values_of_quantities():
    """Without values, the words of a spring would give the stiffnesses 0 and 1."""
    with pytest.raises(mb.DeclarationError, match=r"numbers 0 to 1, but its nominal value is 100.*k=\{'soft': 100"):
        ends(lambda k: k, mb.Box(k=["soft", "hard"]), k=100.0)
    assert ends(lambda k: k, mb.Box(k={"soft": 80, "hard": 120}), k=100.0)[0][1] == pytest.approx(120)


@pytest.mark.parametrize("width", [0.03, 0.001])
def test_thin_sets_of_allowed_points(width):
    """The sum is largest at the end of the long axis of an ellipse."""
    thin = [lambda p: ((p.a - p.b) / width) ** 2 + ((p.a + p.b) / 1.8) ** 2 - 1]
    both, bounds = ends(lambda a, b: a + b, mb.Box(a=(-1, 1), b=(-1, 1), constraints=thin), a=0.0, b=0.0)
    assert both == pytest.approx((-1.8, 1.8), abs=2e-3) and not bounds.warnings


def test_small_sets_of_allowed_points_are_found():
    """With n = 3, the allowed points are a ball of radius 0.01 around 0.7."""
    ball = [lambda p: (p.a - 0.7) ** 2 + (p.b - 0.7) ** 2 + (p.c - 0.7) ** 2 - (1 if p.n == 1 else 1e-4)]
    box = mb.Box(n={1, 3}, a=(0, 1), b=(0, 1), c=(0, 1), constraints=ball)
    both, _ = ends(lambda n, a, b, c: n * (a + b + c), box, n=1.0, a=0.5, b=0.5, c=0.5)
    assert both[1] == pytest.approx(3 * (2.1 + 0.01 * 3**0.5), abs=2e-3)
