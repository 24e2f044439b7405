"""Numbers with bounds of rounding, and discs, against mpmath in 40 digits."""

import itertools

import casadi as ca
import mpmath
import numpy as np
import pytest
from enclosure_samples import EXACT

from symmb.prove import discs, points, taylor_models
from symmb.prove.errors import ProofError

mpmath.mp.dps = 40
N = 2000
RANGES = {
    **{name: [(0.05, 6.0)] for name in ("OP_INV", "OP_SQRT", "OP_LOG")},
    **{name: [(-0.9, 0.9)] for name in ("OP_ASIN", "OP_ACOS", "OP_ATANH")},
    "OP_ACOSH": [(1.3, 5.0)],
    "OP_LOG1P": [(-0.9, 4.0)],
    "OP_TAN": [(-1.2, 1.2)],
    "OP_DIV": [(-5.0, 5.0), (-4.0, -0.1)],
    "OP_POW": [(0.2, 4.0), (-3.0, 3.0)],
    "OP_HYPOT": [(0.5, 4.0), (-0.4, 0.4)],
}


def _ranges(name, default):
    arity = 2 if name in ("OP_ADD", "OP_SUB", "OP_MUL", "OP_DIV", "OP_POW", "OP_ATAN2", "OP_HYPOT") else 1
    return RANGES.get(name, [default] * arity)


def _quadrant(name, rng):
    """Arguments of an angle, in a half plane without the negative axis."""
    return [rng.uniform(-3, 3, N), rng.uniform(0.5, 3, N)] if name == "OP_ATAN2" else None


@pytest.mark.parametrize("name", EXACT)
def test_exact_values_are_within_the_errors_of_values(name):
    rng = np.random.default_rng(1)
    x = _quadrant(name, rng) or [rng.uniform(low, high, N) for low, high in _ranges(name, (-5.0, 5.0))]
    off = [rng.uniform(-1, 1, N) * 1e-9 for _ in x]
    values, error, low, high = points.OPERATIONS[getattr(ca, name)](*(points.point(a, 1e-9) for a in x))
    assert low == values.min() and high == values.max()
    worst = 0.0
    for value, *arguments in zip(values, *x, *off, strict=True):
        half = len(arguments) // 2
        exact = EXACT[name](
            *(mpmath.mpf(a) + mpmath.mpf(b) for a, b in zip(arguments[:half], arguments[half:], strict=True))
        )
        worst = max(worst, float(abs(exact - mpmath.mpf(float(value)))))
    assert 0.0 < worst <= error
    assert error < 3e3 * worst + 1e-14  # not absurdly large either


@pytest.mark.parametrize("name", EXACT)
def test_rounding_alone_is_within_the_errors(name):
    rng = np.random.default_rng(2)
    x = _quadrant(name, rng) or [rng.uniform(low, high, N) for low, high in _ranges(name, (-5.0, 5.0))]
    values, error, *_ = points.OPERATIONS[getattr(ca, name)](*map(points.point, x))
    for value, *arguments in zip(values, *x, strict=True):
        assert abs(EXACT[name](*map(mpmath.mpf, arguments)) - mpmath.mpf(float(value))) <= error


@pytest.mark.parametrize("name", EXACT)
def test_discs_hold_all_values_of_their_arguments(name):
    """At each place in a patch, the values of arguments in their discs are in the disc of the result there."""
    rng = np.random.default_rng(3)
    x = _quadrant(name, rng) or [rng.uniform(low, high, N) for low, high in _ranges(name, (-2.0, 2.0))]
    x = [a + 1j * rng.uniform(-0.02, 0.02, N) for a in x]
    radii = [rng.choice([0.0, 0.001, 0.02], N) * rng.random(N) for _ in x]
    slopes = [rng.choice([0.0, 0.02], N)[:, None] * _in_circle(rng, (N, 2)) / 2 for _ in x]
    arguments = [discs.Disc(a, b, r) for a, b, r in zip(x, slopes, radii, strict=True)]
    with np.errstate(all="ignore"):
        found = discs.OPERATIONS[getattr(ca, name)](*arguments)
    assert np.isfinite(discs.reach(found)).all()
    places = _on_circle(rng, (N, 2))
    inside = [a + (b * places).sum(axis=1) + r * _on_circle(rng, N) for a, b, r in zip(x, slopes, radii, strict=True)]
    centres = np.broadcast_to(found.centre + (found.slopes * places).sum(axis=1), N)
    complex_exact = EXACT | {
        "OP_ATAN2": lambda y, x: (mpmath.log(x + 1j * y) - mpmath.log(x - 1j * y)) / 2j,
        "OP_HYPOT": lambda a, b: mpmath.sqrt(a * a + b * b),
    }
    for k in range(N):
        exact = complex_exact[name](*(mpmath.mpc(complex(a[k])) for a in inside))
        off = abs(exact - mpmath.mpc(complex(centres[k])))
        assert off <= np.broadcast_to(found.radius, N)[k] * (1 + 1e-12) + 1e-15 * abs(exact)


@pytest.mark.parametrize("name", ["OP_MUL", "OP_DIV", "OP_SQ", "OP_INV", "OP_SIN", "OP_EXP", "OP_SQRT", "OP_ATAN2"])
def test_radii_fall_with_the_square_of_slopes(name):
    radii = []
    for size in (1e-2, 1e-3):
        arguments = [discs.Disc(np.array([a]), size * np.array([[1.0, 0.5j]]), np.zeros(1)) for a in (0.7, 1.3)]
        operands = len(_ranges(name, (0.0, 1.0)))
        radii.append(float(discs.OPERATIONS[getattr(ca, name)](*arguments[:operands]).radius[0]))
    assert radii[1] < 0.011 * radii[0] + 1e-14


def _on_circle(rng, shape):
    """Numbers of modulus 1, and some of modulus 0."""
    return rng.choice([0.0, 1.0, 1.0], shape) * np.exp(2j * np.pi * rng.random(shape))


def _in_circle(rng, shape):
    return rng.random(shape) * np.exp(2j * np.pi * rng.random(shape))


@pytest.mark.parametrize("exponent", [0.0, 2.0, 3.0, -1.0, -2.0, 0.5, -1.5, 2.5])
def test_constant_powers(exponent):
    rng, sign = np.random.default_rng(4), -1.0 if exponent == int(exponent) else 1.0
    x, radius = sign * rng.uniform(0.5, 3.0, 200) + 0.1j, 0.05
    found = discs.OPERATIONS[ca.OP_CONSTPOW](discs.disc(x, radius), discs.disc(exponent))
    centres, reach = found.centre, found.radius
    values, error, *_ = points.OPERATIONS[ca.OP_CONSTPOW](points.point(x.real, 1e-9), points.point(exponent))
    for k, angle in enumerate(2 * np.pi * rng.random(200)):
        exact = mpmath.power(mpmath.mpc(x[k] + radius * np.exp(1j * angle)), exponent)
        assert abs(exact - mpmath.mpc(complex(np.broadcast_to(centres, 200)[k]))) <= np.broadcast_to(reach, 200)[k]
        at = mpmath.power(mpmath.mpf(x.real[k]) + mpmath.mpf(1e-9), exponent)
        assert abs(at - mpmath.mpf(float(np.broadcast_to(values, 200)[k]))) <= error


@pytest.mark.parametrize("name", ["OP_INV", "OP_SQRT", "OP_LOG", "OP_FABS", "OP_SIGN", "OP_ACOS", "OP_ATANH"])
def test_where_a_function_is_not_analytic_nothing_is_proved(name):
    outside = {"OP_ACOS": 1.0, "OP_ATANH": 1.0}.get(name, 0.0)
    with np.errstate(all="ignore"):
        found = discs.OPERATIONS[getattr(ca, name)](discs.disc(np.array([outside, outside + 0.02]), 0.1))
    assert not np.isfinite(discs.reach(found)).any()
    with pytest.raises(ProofError):
        points.OPERATIONS[getattr(ca, name)](points.point(np.array([outside - 0.1, outside + 0.1]), 1e-9))


def test_discs_on_both_sides_of_a_pole_prove_nothing():
    assert np.isinf(discs.OPERATIONS[ca.OP_INV](discs.disc(np.array([-1.0, 1.0]), 0.1)).radius).all()


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("OP_FABS", (-2.0,), 2.0), ("OP_SIGN", (-2.0,), -1.0), ("OP_FMIN", (1.0, 3.0), 1.0),
        ("OP_FMAX", (1.0, 3.0), 3.0), ("OP_LT", (1.0, 3.0), 1.0), ("OP_LE", (3.0, 1.0), 0.0),
        ("OP_EQ", (1.0, 3.0), 0.0), ("OP_NE", (1.0, 3.0), 1.0), ("OP_NOT", (0.0,), 1.0),
        ("OP_AND", (1.0, 0.0), 0.0), ("OP_OR", (0.0, 1.0), 1.0), ("OP_IF_ELSE_ZERO", (1.0, 5.0), 5.0),
        ("OP_IF_ELSE_ZERO", (0.0, 5.0), 0.0), ("OP_NOT", (-2.0,), 0.0), ("OP_AND", (2.0, -3.0), 1.0),
        ("OP_OR", (-2.0, 0.0), 1.0), ("OP_IF_ELSE_ZERO", (-2.0, 5.0), 5.0),
    ],
)  # fmt: skip
def test_decided_comparisons(name, arguments, expected):
    code = getattr(ca, name)
    found = discs.OPERATIONS[code](*map(discs.disc, arguments))
    assert complex(found.centre) == expected and found.radius < 1e-12
    value, error, *_ = points.OPERATIONS[code](*map(points.point, arguments))
    assert float(value) == expected and error < 1e-12
    assert float(points.PLAIN[code](*arguments)) == expected


EITHER = np.array([-1.0, 2.0])
"""A condition that may hold or not."""


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("OP_NOT", (EITHER,)), ("OP_AND", (1.0, EITHER)), ("OP_OR", (EITHER, 0.0)), ("OP_OR", (0.0, EITHER)),
     ("OP_IF_ELSE_ZERO", (EITHER, 5.0))],
)  # fmt: skip
def test_conditions_that_may_vanish_are_not_decided(name, arguments):
    code = getattr(ca, name)
    assert np.isinf(discs.OPERATIONS[code](*map(discs.disc, arguments)).radius).all()
    with pytest.raises(ProofError, match="may be 0"):
        points.OPERATIONS[code](*map(points.point, arguments))


def test_the_arithmetics_know_the_same_operations():
    known = points.OPERATIONS.keys()
    assert known == points.PLAIN.keys() == discs.OPERATIONS.keys() == taylor_models.OPERATIONS.keys()


EXTREME = (1e-300, -1e-300, 1e-200, 3e-155, 1e-17, -1e-17, 1e155, -1e200, 1e300, 1 + 1e-12, 1 - 1e-12, -1 + 1e-9, 700.0,
           -800.0)  # fmt: skip


@pytest.mark.parametrize("name", EXACT)
def test_extreme_arguments_are_within_the_errors_or_refused(name):
    operands = len(_ranges(name, (0.0, 1.0)))
    rng = np.random.default_rng(5)
    for x in itertools.product(EXTREME, repeat=operands):
        off = [abs(a) * rng.choice([10.0 ** rng.integers(-16, -9), 0.4]) for a in x]
        with np.errstate(all="ignore"):
            found = discs.OPERATIONS[getattr(ca, name)](*map(discs.disc, x, off))
            try:
                value, error, *_ = points.OPERATIONS[getattr(ca, name)](*map(points.point, x, off))
            except ProofError:
                value, error = 0.0, np.inf
        if np.isinf(error) and not np.isfinite(found.radius):
            continue
        with mpmath.workdps(700):
            ends = [
                EXACT[name](*arguments)
                for arguments in zip(*(_ends(a, b) for a, b in zip(x, off, strict=True)), strict=True)
            ]
            for y in ends:
                assert np.isinf(error) or abs(y - mpmath.mpf(float(value))) <= error
                off_centre = abs(y - mpmath.mpmathify(complex(found.centre)))
                assert not np.isfinite(found.radius) or off_centre <= float(found.radius)


def _ends(a, error):
    return [mpmath.mpf(a) - mpmath.mpf(error), mpmath.mpf(a) + mpmath.mpf(error)]


def test_the_complex_error_function_is_less_exact_than_others():
    z = np.random.default_rng(6).uniform(0.001, 0.05, 300) * np.exp(0.3j)
    found = discs.OPERATIONS[ca.OP_ERF](discs.disc(z))
    for at, centre, radius in zip(z, found.centre, found.radius, strict=True):
        assert abs(mpmath.erf(mpmath.mpc(complex(at))) - mpmath.mpc(complex(centre))) <= radius


@pytest.mark.parametrize(
    ("name", "argument"),
    [
        ("OP_ACOSH", 1.0 + 7 * 2.0**-52),
        ("OP_ASIN", 1.0 - 2.0**-50),
        ("OP_ATANH", 2.0**-51 - 1.0),
        ("OP_ACOS", 2.0**-49 - 1.0),
    ],
)
def test_slopes_beside_a_branch_point(name, argument):
    """There, an error far below the last place of the argument is amplified by up to 1e15."""
    off = 0.01 * (abs(argument) - 1.0 if name == "OP_ACOSH" else 1.0 - abs(argument))
    for error in (off, -off):
        value, bound, *_ = points.OPERATIONS[getattr(ca, name)](points.point(argument, off))
        exact = EXACT[name](mpmath.mpf(argument) + mpmath.mpf(error))
        assert abs(exact - mpmath.mpf(float(value))) <= bound
