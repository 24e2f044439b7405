"""Every operation of the arithmetics of enclosures against Arb (python-flint) at many arguments, ordinary and extreme.

    PYTHONPATH=.:tests python tests/benchmarks/enclosure_arithmetic.py [--count 100000] [--bits 400]

Values at points: the exact value of an argument within its error is within the error of the result. Discs: the exact
value of an argument in its disc is in the disc of the result. Arguments are at the scales 1e-300 to 1e300, near 0, near
branch points and poles, and ordinary. A refusal, or an infinite radius, proves nothing and is counted apart.
"""

import argparse

import casadi as ca
import flint
import numpy as np

from symmb.prove import discs, points
from symmb.prove.errors import ProofError

GROUP = 50
"""Arguments that are treated together: they share a bound of errors, or must all be where the operation is analytic."""
MORE = 4000
"""Bits that hold the sum of 1e300 and 1e-300."""
SPECIAL = (0.0, 1.0, -1.0, 0.5 * np.pi, -0.5 * np.pi, np.pi)
"""Branch points and poles."""
UNARY = {
    "OP_NEG": lambda a: -a, "OP_SQ": lambda a: a * a, "OP_TWICE": lambda a: 2 * a, "OP_INV": lambda a: 1 / a,
    "OP_ASSIGN": lambda a: a, **{f"OP_{name.upper()}": lambda a, name=name: getattr(a, name)() for name in (
        "sqrt", "sin", "cos", "tan", "exp", "log", "sinh", "cosh", "tanh", "asin", "acos", "atan", "asinh", "acosh",
        "atanh", "log1p", "expm1", "erf")},
}  # fmt: skip
BINARY = {
    "OP_ADD": lambda a, b: a + b, "OP_SUB": lambda a, b: a - b, "OP_MUL": lambda a, b: a * b,
    "OP_DIV": lambda a, b: a / b, "OP_POW": lambda a, b: a**b, "OP_HYPOT": lambda a, b: (a * a + b * b).sqrt(),
    "OP_ATAN2": lambda y, x: flint.arb.atan2(y, x),
}  # fmt: skip
REAL = {
    "OP_FABS": abs, "OP_SIGN": lambda a: a.sgn(), "OP_FMIN": lambda a, b: a.min(b), "OP_FMAX": lambda a, b: a.max(b),
}  # fmt: skip


def _numbers(rng: np.random.Generator) -> np.ndarray:
    """A group of real arguments of one kind."""
    kind = rng.integers(5)
    if kind == 0:
        return rng.uniform(-5, 5) + rng.uniform(0, 3) * rng.uniform(-1, 1, GROUP)
    if kind == 1:
        return rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(-300, 300) * rng.uniform(0.5, 2, GROUP)
    if kind == 2:
        return rng.choice(SPECIAL) + rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(-16, -1) * rng.uniform(0.5, 2, GROUP)
    if kind == 3:
        return rng.choice([-1.0, 1.0], GROUP) * 10 ** rng.uniform(-300, 2, GROUP)
    return np.where(rng.random(GROUP) < 0.1, rng.choice(SPECIAL), rng.uniform(0, 1, GROUP))


def _radius(rng: np.random.Generator, x: np.ndarray) -> float:
    return float(rng.choice([0.0, np.abs(x).min(), np.abs(x).max()]) * 10 ** rng.uniform(-17, 1))


def _exponent(rng: np.random.Generator) -> np.ndarray:
    return np.array(float(rng.choice([rng.integers(-6, 7), rng.integers(-40, 40) / 4, rng.uniform(-3, 3)])))


def _arguments(name: str, rng: np.random.Generator) -> list[np.ndarray]:
    if name == "OP_POW":
        return [_numbers(rng), _exponent(rng) if rng.random() < 0.6 else rng.uniform(-3, 3, GROUP)]
    if name in BINARY or name in ("OP_FMIN", "OP_FMAX"):
        return [_numbers(rng), _numbers(rng)]
    return [_numbers(rng)]


def _within(exact, arguments, computed, bound: float) -> bool:
    """Whether exact(arguments) is as near as a bound to a computed sum: in more digits where it is not clear."""
    for bits in (flint.ctx.prec, MORE):
        with flint.ctx.workprec(bits):
            if abs(exact(*map(sum, arguments)) - sum(computed)) <= flint.arb(bound):
                return True
    return False


def at_points(name: str, exact, count: int) -> tuple[int, int, int]:
    """Arguments, those that are refused, and those whose exact values are outside of the error."""
    rng, total, refused, wrong = np.random.default_rng(0), 0, 0, 0
    while total < count:
        x = _arguments(name, rng)
        errors = [0.0 if name == "OP_POW" and a.ndim == 0 else _radius(rng, a) for a in x]
        total += GROUP
        with np.errstate(all="ignore"):
            try:
                numbers = [points.point(a if a.ndim else float(a), e) for a, e in zip(x, errors, strict=True)]
                value, error, low, high = points.OPERATIONS[getattr(ca, name)](*numbers)
            except ProofError:
                refused += GROUP
                continue
        off = [rng.choice([-1.0, 1.0, rng.uniform(-1, 1)], GROUP) * e for e in errors]
        for k in range(GROUP):
            computed = float(np.broadcast_to(value, GROUP)[k])
            arguments = [(flint.arb(float(np.broadcast_to(a, GROUP)[k])), flint.arb(float(o[k])))
                         for a, o in zip(x, off, strict=True)]  # fmt: skip
            if not (_within(exact, arguments, [flint.arb(computed)], error) and low <= computed <= high):
                wrong += 1
                print("  outside:", name, arguments, computed, error)
    return total, refused, wrong


def _in_circle(rng: np.random.Generator) -> np.ndarray:
    return rng.choice([0.0, 0.7, 1.0], GROUP) * np.exp(2j * np.pi * rng.random(GROUP)) * (1 - 1e-15)


def _with_slopes(centres: np.ndarray, reach: np.ndarray, rng: np.random.Generator) -> discs.Disc:
    """Discs that reach so far, a random part of it by their slopes."""
    part = rng.random() if rng.random() < 0.7 and centres.ndim else 0.0
    part = np.where(reach > 1e-280, part, 0.0)  # Arb has no denormal numbers
    slopes = (part * reach * np.exp(1j * rng.uniform(0, 6)))[..., None]
    return discs.wider(discs.Disc(centres, slopes, (1 - part) * reach), 0.0)


def _parts(a: discs.Disc) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return a.centre, a.slopes[..., 0], a.radius


def on_discs(name: str, exact, count: int) -> tuple[int, int, int]:
    """The same of points of discs."""
    rng, total, refused, wrong = np.random.default_rng(1), 0, 0, 0
    while total < count:
        x = _arguments(name, rng)
        radii = [
            np.zeros(a.shape) if name == "OP_POW" and a.ndim == 0 else np.full(a.shape, _radius(rng, a)) for a in x
        ]
        if rng.random() < 0.7:
            x = [a if a.ndim == 0 else a * np.exp(1j * rng.uniform(-1, 1) * rng.uniform(0, 1, GROUP)) for a in x]
        total += GROUP
        with np.errstate(all="ignore"):
            own = [_with_slopes(a, r, rng) for a, r in zip(x, radii, strict=True)]
            found = discs.OPERATIONS[getattr(ca, name)](*own)
        places, *turned = rng.choice([-1.0, 1.0, rng.uniform(-1, 1)], GROUP), *(_in_circle(rng) for _ in x)
        for k in range(GROUP):
            centre, slope, radius = (np.broadcast_to(a, GROUP)[k] for a in _parts(found))
            if not (np.isfinite(radius) and np.isfinite(centre)):  # not a proof
                refused += 1
                continue
            arguments = []
            for one, u in zip(own, turned, strict=True):
                a, b, r = (_acb(np.broadcast_to(part, GROUP)[k]) for part in _parts(one))
                arguments.append([a, b * _acb(places[k]), r * _acb(u[k])])
            computed = [_acb(centre), _acb(slope) * _acb(places[k])]
            if not _within(exact, arguments, computed, float(radius)):
                wrong += 1
                print("  outside:", name, arguments, centre, slope, radius)
    return total, refused, wrong


def _acb(z) -> flint.acb:
    return flint.acb(float(np.real(z)), float(np.imag(z)))


def _complex_angle(y: flint.acb, x: flint.acb) -> flint.acb:
    """The angle's continuation from the right half plane, the upper one or the lower one."""
    i = flint.acb(0, 1)
    if (x + i * y).real > 0 and (x - i * y).real > 0:
        return (y / x).atan()
    return flint.acb.pi() / 2 * (1 if y.real > 0 else -1) - (x / y).atan()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="arguments of each operation")
    parser.add_argument("--bits", type=int, default=400, help="precision of Arb")
    parser.add_argument("--only", default="", help="operations whose names contain this")
    options = parser.parse_args()
    flint.ctx.prec = options.bits
    analytic = UNARY | BINARY
    faults = 0
    for name, exact in {**analytic, **REAL}.items():
        if options.only in name:
            total, refused, wrong = at_points(name, exact, options.count)
            faults += wrong
            print(f"{name:12} points {total:7} refused {refused:7} outside {wrong}", flush=True)
    for name, exact in {**analytic, "OP_ATAN2": _complex_angle}.items():
        if options.only in name:
            total, refused, wrong = on_discs(name, exact, options.count)
            faults += wrong
            print(f"{name:12} discs  {total:7} refused {refused:7} outside {wrong}", flush=True)
    print(f"{faults} outside in all")
