"""Numbers with bounds of rounding, and discs, against mpmath in 40 digits."""

import ctypes
import itertools
import platform

import casadi as ca
import mpmath
import numpy as np
import pytest
from enclosure_samples import EXACT
from faults import refused

import symmb as mb
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
    "OP_ATAN2": [(-3.0, 3.0), (0.5, 3.0)],
}


def _arity(name):
    return 2 if name in ("OP_ADD", "OP_SUB", "OP_MUL", "OP_DIV", "OP_POW", "OP_ATAN2", "OP_HYPOT") else 1


def _drawn(name, rng, default):
    """Arguments in their ranges; those of an angle are in a half plane without the negative axis."""
    return [rng.uniform(low, high, N) for low, high in RANGES.get(name, [default] * _arity(name))]


def _of(module, name):
    return module.OPERATIONS[getattr(ca, name)]


def _off(exact, value):
    """The distance of an exact value from a number."""
    return abs(exact - mpmath.mpmathify(complex(value) if np.iscomplexobj(value) else float(value)))


@pytest.mark.parametrize("name", EXACT)
def test_exact_values_are_within_the_errors_of_values(name):
    rng = np.random.default_rng(1)
    x = _drawn(name, rng, (-5.0, 5.0))
    off = [rng.uniform(-1, 1, N) * 1e-9 for _ in x]
    values, error, low, high = _of(points, name)(*(points.point(a, 1e-9) for a in x))
    assert low == values.min() and high == values.max()
    pairs = [[mpmath.mpf(a) + mpmath.mpf(b) for a, b in zip(*both, strict=True)] for both in zip(x, off, strict=True)]
    worst = max(float(_off(EXACT[name](*arguments), value)) for value, *arguments in zip(values, *pairs, strict=True))
    assert 0.0 < worst <= error
    assert error < 3e3 * worst + 1e-14  # not absurdly large either
    values, error, *_ = _of(points, name)(*map(points.point, x))  # rounding alone
    for value, *arguments in zip(values, *x, strict=True):
        assert _off(EXACT[name](*map(mpmath.mpf, arguments)), value) <= error


@pytest.mark.parametrize("name", EXACT)
def test_discs_hold_all_values_of_their_arguments(name):
    """At each place in a patch, the values of arguments in their discs are in the disc of the result there."""
    rng = np.random.default_rng(3)
    x = [a + 1j * rng.uniform(-0.02, 0.02, N) for a in _drawn(name, rng, (-2.0, 2.0))]
    radii = [rng.choice([0.0, 0.001, 0.02], N) * rng.random(N) for _ in x]
    slopes = [
        rng.choice([0.0, 0.02], N)[:, None] * rng.random((N, 2)) * np.exp(2j * np.pi * rng.random((N, 2))) / 2
        for _ in x
    ]
    arguments = [discs.Disc(a, b, r) for a, b, r in zip(x, slopes, radii, strict=True)]
    with np.errstate(all="ignore"):
        found = _of(discs, name)(*arguments)
    assert np.isfinite(discs.reach(found)).all()
    places = _on_circle(rng, (N, 2))
    inside = [a + (b * places).sum(axis=1) + r * _on_circle(rng, N) for a, b, r in zip(x, slopes, radii, strict=True)]
    centres = np.broadcast_to(found.centre + (found.slopes * places).sum(axis=1), N)
    complex_exact = EXACT | {
        "OP_ATAN2": lambda y, x: (mpmath.log(x + 1j * y) - mpmath.log(x - 1j * y)) / 2j,
        "OP_HYPOT": lambda a, b: mpmath.sqrt(a * a + b * b),
    }
    for centre, radius, *own in zip(centres, np.broadcast_to(found.radius, N), *inside, strict=True):
        exact = complex_exact[name](*(mpmath.mpc(complex(a)) for a in own))
        assert _off(exact, centre) <= radius * (1 + 1e-12) + 1e-15 * abs(exact)


@pytest.mark.parametrize("name", ["OP_MUL", "OP_DIV", "OP_SQ", "OP_INV", "OP_SIN", "OP_EXP", "OP_SQRT", "OP_ATAN2"])
def test_radii_fall_with_the_square_of_slopes(name):
    radii = []
    for size in (1e-2, 1e-3):
        arguments = [discs.Disc(np.array([a]), size * np.array([[1.0, 0.5j]]), np.zeros(1)) for a in (0.7, 1.3)]
        radii.append(float(_of(discs, name)(*arguments[: _arity(name)]).radius[0]))
    assert radii[1] < 0.011 * radii[0] + 1e-14


def _on_circle(rng, shape):
    """Numbers of modulus 1, and some of modulus 0."""
    return rng.choice([0.0, 1.0, 1.0], shape) * np.exp(2j * np.pi * rng.random(shape))


@pytest.mark.parametrize("exponent", [0.0, 2.0, 3.0, -1.0, -2.0, 0.5, -1.5, 2.5])
def test_constant_powers(exponent):
    rng, sign = np.random.default_rng(4), -1.0 if exponent == int(exponent) else 1.0
    x, radius = sign * rng.uniform(0.5, 3.0, 200) + 0.1j, 0.05
    found = _of(discs, "OP_CONSTPOW")(discs.disc(x, radius), discs.disc(exponent))
    values, error, *_ = _of(points, "OP_CONSTPOW")(points.point(x.real, 1e-9), points.point(exponent))
    edge = x + radius * np.exp(2j * np.pi * rng.random(200))
    for z, a, *own in zip(edge, x.real, *np.broadcast_arrays(found.centre, found.radius, values, x)[:3], strict=True):
        assert _off(mpmath.power(mpmath.mpc(z), exponent), own[0]) <= own[1]
        assert _off(mpmath.power(mpmath.mpf(a) + mpmath.mpf(1e-9), exponent), own[2]) <= error


@pytest.mark.parametrize("name", ["OP_INV", "OP_SQRT", "OP_LOG", "OP_FABS", "OP_SIGN", "OP_ACOS", "OP_ATANH"])
def test_where_a_function_is_not_analytic_nothing_is_proved(name):
    outside = {"OP_ACOS": 1.0, "OP_ATANH": 1.0}.get(name, 0.0)
    with np.errstate(all="ignore"):
        found = _of(discs, name)(discs.disc(np.array([outside, outside + 0.02]), 0.1))
    assert not np.isfinite(discs.reach(found)).any()
    refused(None, _of(points, name), points.point(np.array([outside - 0.1, outside + 0.1]), 1e-9), error=ProofError)
    poles = discs.disc(np.array([-1.0, 1.0]), 0.1)  # on both sides of one
    assert np.isinf(_of(discs, "OP_INV")(poles).radius).all()


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
    refused("may be 0", points.OPERATIONS[code], *map(points.point, arguments), error=ProofError)


def test_the_arithmetics_know_the_same_operations():
    known = points.OPERATIONS.keys()
    assert known == points.PLAIN.keys() == discs.OPERATIONS.keys() == taylor_models.OPERATIONS.keys()


EXTREME = (1e-300, -1e-300, 1e-200, 3e-155, 1e-17, -1e-17, 1e155, -1e200, 1e300, 1 + 1e-12, 1 - 1e-12, -1 + 1e-9, 700.0,
           -800.0)  # fmt: skip


@pytest.mark.parametrize("name", EXACT)
def test_extreme_arguments_are_within_the_errors_or_refused(name):
    rng = np.random.default_rng(5)
    for x in itertools.product(EXTREME, repeat=_arity(name)):
        off = [abs(a) * rng.choice([10.0 ** rng.integers(-16, -9), 0.4]) for a in x]
        with np.errstate(all="ignore"):
            found = _of(discs, name)(*map(discs.disc, x, off))
            try:
                value, error, *_ = _of(points, name)(*map(points.point, x, off))
            except ProofError:
                value, error = 0.0, np.inf
        if np.isinf(error) and not np.isfinite(found.radius):
            continue
        with mpmath.workdps(700):
            for side in (-1, 1):
                y = EXACT[name](*(mpmath.mpf(a) + side * mpmath.mpf(b) for a, b in zip(x, off, strict=True)))
                assert np.isinf(error) or _off(y, value) <= error
                assert not np.isfinite(found.radius) or _off(y, complex(found.centre)) <= float(found.radius)


def test_the_complex_error_function_is_less_exact_than_others():
    z = np.random.default_rng(6).uniform(0.001, 0.05, 300) * np.exp(0.3j)
    found = _of(discs, "OP_ERF")(discs.disc(z))
    for at, centre, radius in zip(z, found.centre, found.radius, strict=True):
        assert _off(mpmath.erf(mpmath.mpc(complex(at))), centre) <= radius


@pytest.mark.parametrize(
    ("name", "argument"),
    [
        ("OP_ACOSH", 1.0 + 7 * 2.0**-52), ("OP_ASIN", 1.0 - 2.0**-50), ("OP_ATANH", 2.0**-51 - 1.0),
        ("OP_ACOS", 2.0**-49 - 1.0),
    ],
)  # fmt: skip
def test_slopes_beside_a_branch_point(name, argument):
    """There, an error far below the last place of the argument is amplified by up to 1e15."""
    off = 0.01 * (abs(argument) - 1.0 if name == "OP_ACOSH" else 1.0 - abs(argument))
    for error in (off, -off):
        value, bound, *_ = _of(points, name)(points.point(argument, off))
        assert _off(EXACT[name](mpmath.mpf(argument) + mpmath.mpf(error)), value) <= bound


@pytest.fixture
def rounding():
    """Set the rounding mode of this thread, and restore it afterwards."""
    if platform.machine() != "x86_64" or platform.system() != "Linux":
        pytest.skip("numbers of rounding modes are those of x86-64 Linux")
    libm = ctypes.CDLL("libm.so.6")
    before = libm.fegetround()
    yield libm.fesetround
    libm.fesetround(before)


@pytest.mark.parametrize("mode", (0x400, 0x800, 0xC00), ids=("down", "up", "to zero"))
@pytest.mark.parametrize("method", (mb.TaylorModel(), mb.IntervalArithmetic()), ids=repr)
def test_proofs_refuse_arithmetic_that_does_not_round_to_nearest(rounding, method, mode):
    p = mb.Parameters(x=0.5)
    scene = mb.Scene(mb.System(parameters=p), outputs={"f": p.x**3 - 2 * p.x**2 + p.x}, box=mb.Box(x=(0.0, 1.0)))
    assert mb.propagate(scene, method).kind == "enclosure"
    assert not rounding(mode)
    try:
        refused("rounds to nearest", mb.propagate, scene, method, error=mb.PropagationError)
    finally:
        rounding(0)
