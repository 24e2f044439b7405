"""Each operation that laws may contain, its value and its derivative, beside mpmath."""

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from faults import refused

import symmb as mb

POINTS = [-2.7, -1.5, -1.0, -0.7, -0.3, -1e-3, 0.0, 1e-3, 0.2, 0.4, 0.7, 1.0, 1.2, 2.3]
"""Arguments at the switching points of operations, and beside them."""
OTHERS = [-1.9, -0.45, 0.45, 1.9]
"""Second arguments."""


def _sign(x):
    return mp.mpf((x > 0) - (x < 0))


def _remainder(a, b):
    return a - b * mp.nint(a / b)


def _fmod(a, b):
    return a - b * (mp.floor(a / b) if a / b > 0 else mp.ceil(a / b))


ONE = {
    "neg": (lambda x: -x, lambda x: -x),
    "exp": (ca.exp, mp.exp),
    "log": (ca.log, mp.log),
    "sqrt": (ca.sqrt, mp.sqrt),
    "sq": (lambda x: x**2, lambda x: x * x),
    "cube": (lambda x: x**3, lambda x: x**3),
    "constant power": (lambda x: x**2.5, lambda x: x ** mp.mpf(2.5)),
    "negative power": (lambda x: x**-2, lambda x: x**-2),
    "power of a constant": (lambda x: 2.0**x, lambda x: mp.mpf(2) ** x),
    "inverse": (lambda x: 1 / x, lambda x: 1 / x),
    "twice": (lambda x: 2 * x, lambda x: 2 * x),
    "sin": (ca.sin, mp.sin),
    "cos": (ca.cos, mp.cos),
    "tan": (ca.tan, mp.tan),
    "asin": (ca.asin, mp.asin),
    "acos": (ca.acos, mp.acos),
    "atan": (ca.atan, mp.atan),
    "sinh": (ca.sinh, mp.sinh),
    "cosh": (ca.cosh, mp.cosh),
    "tanh": (ca.tanh, mp.tanh),
    "asinh": (ca.asinh, mp.asinh),
    "acosh": (ca.acosh, mp.acosh),
    "atanh": (ca.atanh, mp.atanh),
    "log1p": (ca.log1p, mp.log1p),
    "expm1": (ca.expm1, mp.expm1),
    "erf": (ca.erf, mp.erf),
    "floor": (ca.floor, mp.floor),
    "ceil": (ca.ceil, mp.ceil),
    "fabs": (ca.fabs, abs),
    "sign": (ca.sign, _sign),
    "not": (ca.logic_not, lambda x: mp.mpf(x == 0)),
    "branch": (lambda x: ca.if_else(x > 0.4, x**2, 3 * x), lambda x: x * x if x > mp.mpf(0.4) else 3 * x),
    "part": (lambda x: ca.if_else(x >= 0, ca.sin(x), 0), lambda x: mp.sin(x) if x >= 0 else mp.mpf(0)),
}
TWO = {
    "add": (lambda a, b: a + b,) * 2,
    "subtract": (lambda a, b: a - b,) * 2,
    "multiply": (lambda a, b: a * b,) * 2,
    "divide": (lambda a, b: a / b,) * 2,
    "power": (lambda a, b: a**b,) * 2,
    "fmod": (ca.fmod, _fmod),
    "remainder": (ca.remainder, _remainder),
    "atan2": (ca.atan2, mp.atan2),
    "hypot": (ca.hypot, mp.hypot),
    "copysign": (ca.copysign, lambda a, b: abs(a) if b >= 0 else -abs(a)),
    "fmin": (ca.fmin, min),
    "fmax": (ca.fmax, max),
    "less": (lambda a, b: a < b, lambda a, b: mp.mpf(a < b)),
    "at most": (lambda a, b: a <= b, lambda a, b: mp.mpf(a <= b)),
    "equal": (lambda a, b: a == b, lambda a, b: mp.mpf(a == b)),
    "unequal": (lambda a, b: a != b, lambda a, b: mp.mpf(a != b)),
    "and": (lambda a, b: ca.logic_and(a > 0, b > 0), lambda a, b: mp.mpf(a > 0 and b > 0)),
    "or": (lambda a, b: ca.logic_or(a > 0, b > 0), lambda a, b: mp.mpf(a > 0 or b > 0)),
}
CASES = {
    **{name: (law, exact) for name, (law, exact) in ONE.items()},
    **{f"{name} {b}": (lambda x, f=law, b=b: f(x, b), lambda x, f=exact, b=b: f(x, mp.mpf(b)))
       for name, (law, exact) in TWO.items() for b in OTHERS},
    **{f"{name} of {a}": (lambda x, f=law, a=a: f(a, x), lambda x, f=exact, a=a: f(mp.mpf(a), x))
       for name, (law, exact) in TWO.items() for a in OTHERS},
}  # fmt: skip


def _exact(f, x):
    """Value of a function at x, and the derivatives on both sides; None if it is no real number there."""
    step = mp.mpf("1e-20")
    try:
        below, value, above = (f(mp.mpf(x) + k * step) for k in (-1, 0, 1))
        further = f(mp.mpf(x) - 2 * step), f(mp.mpf(x) + 2 * step)
    except (ValueError, ZeroDivisionError):
        return None
    if any(isinstance(each, mp.mpc) or not mp.isfinite(each) for each in (below, value, above, *further)):
        return None
    return value, [(below - further[0]) / step, (further[1] - above) / step]


def _known(f):
    """The points at which a law has a value, with its exact value and its derivatives on both sides."""
    with mp.workdps(60):
        exact = {x: _exact(f, x) for x in POINTS}
    return {x: known for x, known in exact.items() if known is not None}


KNOWN = {name: known for name, (_, f) in CASES.items() if (known := _known(f))}


@pytest.fixture(scope="module")
def compiled():
    """Values and derivatives of all laws at their points (N, n_y), from compiled outputs of a scene.

    Each law has its own parameter, because a run fails if a value is not finite.
    """
    p = mb.Parameters(**{f"x{k}": 0.5 for k in range(len(KNOWN))})
    outputs = {}
    for x, name in zip(p, KNOWN, strict=True):
        y = CASES[name][0](getattr(p, x))
        outputs[name], outputs[f"d {name}"] = y, ca.jacobian(y, getattr(p, x))
    samples = [[*known] for known in KNOWN.values()]
    P = np.array([each + each[:1] * (len(POINTS) - len(each)) for each in samples]).T
    simulator = mb.prepare(mb.Scene(mb.System(parameters=p), outputs=outputs))
    ensemble = simulator.run(P)
    assert ensemble.ok.all(), ensemble.messages[:3]
    return dict(zip(simulator.outputs, ensemble.Y[:, 0].T, strict=True))


@pytest.mark.parametrize("name", KNOWN)
def test_values_and_derivatives_of_laws(compiled, name):
    known = KNOWN[name].items()
    for (x, (exact, sides)), value, slope in zip(known, compiled[name], compiled[f"d {name}"], strict=False):
        assert value == pytest.approx(float(exact), rel=1e-13, abs=1e-15), x
        low, high = sorted(float(each) for each in sides)
        if high - low < 1e15:  # no jump
            margin = 1e-12 * max(1.0, abs(low), abs(high))
            assert low - margin <= slope <= high + margin, x


def test_operations_without_exact_values_are_refused():
    p = mb.Parameters(x=0.5)
    refused("erfinv", lambda: mb.Scene(mb.System(parameters=p), outputs={"y": ca.erfinv(p.x)}))
