"""Equations as they are read: those of textbooks, written here by hand, and those of all models."""

# ruff: noqa: E741  (l is a length in textbooks)

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from conftest import ALL_MODELS, but_long
from numpy.testing import assert_allclose
from sympy import cos, sin
from sympy.printing.pretty.pretty_symbology import pretty_use_unicode

import symmb as mb

GROUND = mb.Ground()


def symbols(names):
    return [sp.Symbol(name, real=True) for name in names.split()]


@dataclass
class Book:
    """A system, and its equations in a textbook's form, by hand."""

    system: mb.System
    parts: dict


def point_pendulum():
    """Goldstein, Classical Mechanics, chapter 1: m l^2 q'' = -m g l sin q."""
    p = mb.Parameters(m=1.3, l=0.8, g=9.81)
    bob = mb.Body("bob", p.m, 0.0)
    pin = mb.Revolute("pin", GROUND.point(0, 0), bob.point(0, p.l))
    m, l, g, a = symbols("m l g pin.angle")
    system = mb.System(bob, pin, mb.Gravity(0, -p.g), parameters=p)
    return Book(system.joint_space(), {"M": [[m * l**2]], "Q": [-m * g * l * sin(a)]})


def compound_pendulum():
    """A uniform rod: m l^2 / 3 q'' = -m g l / 2 sin q, with g = 9.81."""
    p = mb.Parameters(m=1.3, l=0.8)
    rod = mb.Body("rod", p.m, p.m * p.l**2 / 12)
    pin = mb.Revolute("pin", GROUND.point(0, 0), rod.point(0, p.l / 2))
    m, l, a = symbols("m l pin.angle")
    system = mb.System(rod, pin, mb.Gravity(0, -9.81), parameters=p)
    return Book(system.joint_space(), {"M": [[m * l**2 / 3]], "Q": [-m * sp.Rational("9.81") * l / 2 * sin(a)]})


def double_pendulum():
    """Two point masses, by the angle of the first and the relative one: Craig, Introduction to Robotics, 6.7."""
    p = mb.Parameters(m1=1.0, m2=1.3, l1=0.9, l2=0.7, g=9.81)
    first, second = mb.Body("first", p.m1, 0.0), mb.Body("second", p.m2, 0.0)
    one = mb.Revolute("one", GROUND.point(0, 0), first.point(0, p.l1))
    two = mb.Revolute("two", first.point(0, 0), second.point(0, p.l2))
    m1, m2, l1, l2, g, a, b, da, db = symbols("m1 m2 l1 l2 g one.angle two.angle one.angle_rate two.angle_rate")
    m12 = l2**2 * m2 + l1 * l2 * m2 * cos(b)
    return Book(
        mb.System(first, second, one, two, mb.Gravity(0, -p.g), parameters=p).joint_space(),
        {
            "M": [[l2**2 * m2 + 2 * l1 * l2 * m2 * cos(b) + l1**2 * m1 + l1**2 * m2, m12], [m12, l2**2 * m2]],
            "Q": [
                m2 * l1 * l2 * sin(b) * db**2
                + 2 * m2 * l1 * l2 * sin(b) * da * db
                - m2 * l2 * g * sin(a + b)
                - (m1 + m2) * l1 * g * sin(a),
                -m2 * l1 * l2 * sin(b) * da**2 - m2 * l2 * g * sin(a + b),
            ],
        },
    )


def spherical_pendulum():
    """A point mass by azimuth and polar angle from below, with a shaft of inertia J: Goldstein, chapter 1."""
    p = mb.Parameters(m=1.3, l=0.8, g=9.81, J=0.1)
    shaft = mb.Body("shaft", 1.0, (1.0, 1.0, p.J), mb.Spatial())
    bob = mb.Body("bob", p.m, (0.0, 0.0, 0.0), mb.Spatial())
    azimuth = mb.Revolute("azimuth", GROUND.point(0, 0, 0), shaft.point(0, 0, 0), axis=(0, 0, 1))
    polar = mb.Revolute("polar", shaft.point(0, 0, 0), bob.point(0, 0, p.l), axis=(0, -1, 0))
    m, l, g, J, a, df, da = symbols("m l g J polar.angle azimuth.angle_rate polar.angle_rate")
    return Book(
        mb.System(shaft, bob, azimuth, polar, mb.Gravity(0, 0, -p.g), parameters=p).joint_space(),
        {
            "M": [[J + m * l**2 * sin(a) ** 2, 0], [0, m * l**2]],
            "Q": [-2 * m * l**2 * sin(a) * cos(a) * df * da, m * l**2 * sin(a) * cos(a) * df**2 - m * g * l * sin(a)],
        },
    )


def cart_pole():
    """A uniform pole of mass m and length 2 l that hangs on a cart of mass M: Barto, Sutton and Anderson (1983)."""
    p = mb.Parameters(M=2.0, m=1.3, l=0.9, g=9.81)
    cart, pole = mb.Body("cart", p.M, 1.0), mb.Body("pole", p.m, p.m * p.l**2 / 3)
    rail = mb.Prismatic("rail", GROUND.point(0, 0), cart.point(0, 0), axis=(1, 0, 0))
    pin = mb.Revolute("pin", cart.point(0, 0), pole.point(0, p.l))
    M, m, l, g, a, da = symbols("M m l g pin.angle pin.angle_rate")
    return Book(
        mb.System(cart, pole, rail, pin, mb.Gravity(0, -p.g), parameters=p).joint_space(),
        {
            "M": [[M + m, m * l * cos(a)], [m * l * cos(a), sp.Rational(4, 3) * m * l**2]],
            "Q": [m * l * da**2 * sin(a), -m * g * l * sin(a)],
        },
    )


LINKS, PIVOTS = ("crank", "coupler", "rocker"), ("A", "B", "D", "C")


def _four_bar():
    """Uniform links of masses m1, m2, m3 and lengths a, b, c on a ground of length d."""
    p = mb.Parameters(m1=1.0, m2=3.0, m3=2.5, a=1.0, b=3.0, c=2.5, d=3.0, g=9.81)
    sizes = zip(LINKS, (p.m1, p.m2, p.m3), (p.a, p.b, p.c), strict=True)
    crank, coupler, rocker = links = [mb.Body(name, m, m * l**2 / 12) for name, m, l in sizes]
    return mb.System(
        *links,
        mb.Revolute("A", GROUND.point(0, 0), crank.point(-p.a / 2, 0)),
        mb.Revolute("B", crank.point(p.a / 2, 0), coupler.point(-p.b / 2, 0)),
        mb.Revolute("D", GROUND.point(p.d, 0), rocker.point(-p.c / 2, 0)),
        mb.Revolute("C", coupler.point(p.b / 2, 0), rocker.point(p.c / 2, 0)),
        mb.Gravity(0, -p.g),
        parameters=p,
    )


def four_bar_of_bodies():
    """In x, y and angle of each link: Nikravesh, Planar Multibody Dynamics, chapter 4."""
    m, (a, b, c, d, g) = symbols("m1 m2 m3"), symbols("a b c d g")
    x, y, f, w = ([sp.Symbol(f"{link}.{of}", real=True) for link in LINKS] for of in ("x", "y", "theta", "omega"))
    halves = [length / 2 for length in (a, b, c)]
    C, S = ([h * wave(angle) for h, angle in zip(halves, f, strict=True)] for wave in (cos, sin))
    ends = [  # of each pivot: point on the second body minus point on the first one
        [x[0] - C[0], y[0] - S[0]],
        [x[1] - C[1] - x[0] - C[0], y[1] - S[1] - y[0] - S[0]],
        [x[2] - C[2] - d, y[2] - S[2]],
        [x[2] + C[2] - x[1] - C[1], y[2] + S[2] - y[1] - S[1]],
    ]
    Phi = sp.Matrix([row for pair in ends for row in pair])
    inertia = [of for k, l in enumerate((a, b, c)) for of in (m[k], m[k], m[k] * l**2 / 12)]
    return Book(
        _four_bar(),
        {
            "M": sp.diag(*inertia),
            "Q": [force for k in range(3) for force in (0, -m[k] * g, 0)],
            "Phi": Phi,
            "Phi_q": Phi.jacobian([of for link in zip(x, y, f, strict=True) for of in link]),
            "gamma": -(Phi.jacobian(f) * sp.Matrix(w)).jacobian(f) * sp.Matrix(w),
        },
    )


def four_bar_of_joints():
    """In the angles of crank, coupler on crank, and rocker, with the loop closed at C: Wittenburg, section 5.6."""
    m1, m2, m3, a, b, c, d, g = symbols("m1 m2 m3 a b c d g")
    f, h, r, df, dh, dr = symbols("A.angle B.angle D.angle A.angle_rate B.angle_rate D.angle_rate")
    m12 = m2 * b**2 / 3 + m2 * a * b / 2 * cos(h)
    Phi = [d + c * cos(r) - a * cos(f) - b * cos(f + h), c * sin(r) - a * sin(f) - b * sin(f + h)]
    return Book(
        _four_bar().joint_space(),
        {
            "M": [
                [m1 * a**2 / 3 + m2 * a**2 + m2 * a * b * cos(h) + m2 * b**2 / 3, m12, 0],
                [m12, m2 * b**2 / 3, 0],
                [0, 0, m3 * c**2 / 3],
            ],
            "Q": [
                m2 * a * b / 2 * sin(h) * (2 * df * dh + dh**2)
                - (m1 / 2 + m2) * g * a * cos(f)
                - m2 * g * b / 2 * cos(f + h),
                -m2 * a * b / 2 * sin(h) * df**2 - m2 * g * b / 2 * cos(f + h),
                -m3 * g * c / 2 * cos(r),
            ],
            "Phi": Phi,
            "Phi_q": sp.Matrix(Phi).jacobian([f, h, r]),
            "gamma": [
                c * cos(r) * dr**2 - a * cos(f) * df**2 - b * cos(f + h) * (df + dh) ** 2,
                c * sin(r) * dr**2 - a * sin(f) * df**2 - b * sin(f + h) * (df + dh) ** 2,
            ],
        },
    )


BOOKS = [
    point_pendulum, compound_pendulum, double_pendulum, spherical_pendulum, cart_pole, four_bar_of_bodies,
    four_bar_of_joints,
]  # fmt: skip


def terms(expression):
    return set(sp.Add.make_args(sp.expand(sp.expand_trig(expression))))


@pytest.mark.parametrize("make", BOOKS, ids=lambda make: make.__name__)
def test_the_equations_are_those_of_textbooks(make):
    """Term by term, with no more operations, and in numbers at random points."""
    book = make()
    ours, names = book.system.to_sympy(), book.system.names
    assert set(ours) == set(book.parts)
    of = [sp.Symbol(name, real=True) for name in names]
    rng = np.random.default_rng(8)
    for name, part in book.parts.items():
        theirs = sp.Matrix(part)
        assert ours[name].shape == theirs.shape
        for mine, entry in zip(ours[name].flat(), theirs.flat(), strict=True):
            assert terms(mine) == terms(entry), (name, mine, entry)
            assert mine.count_ops() <= entry.count_ops(), (name, mine, entry)
        value, expected = ca.Function("value", [*names.values()], [getattr(book.system, name)]), sp.lambdify(of, theirs)
        for _ in range(3):
            at = rng.uniform(-2, 2, len(of))
            assert_allclose(value(*at).full(), expected(*at), rtol=1e-12, atol=1e-12)


def driven():
    """A rod whose angle a motor gives: Phi_t is there."""
    p = mb.Parameters(m=1.0, l=0.7, w=2.0)
    rod = mb.Body("rod", p.m, p.m * p.l**2 / 12)
    pin = mb.Revolute("pin", GROUND.point(0, 0), rod.point(-p.l / 2, 0))
    return mb.System(rod, pin, mb.Motion("motor", pin.angle, ca.sin(p.w * mb.t)), parameters=p)


def test_text_and_latex_have_the_same_parts():
    for system in (driven(), driven().joint_space(), mb.System(mb.Body("top", 1.0, (1.0, 2.0, 3.0), mb.Spatial()))):
        text, tex = system.equations(), system.latex()
        parts = {"Phi_q": ("Φ_q", r"\Phi_q"), "gamma": ("γ", r"\gamma"), "N": ("N", "N"), "Phi_t": ("Φ_t", r"\Phi_t")}
        for name, (line, latex) in parts.items():
            assert (f"{line} = " in text) == (f"{latex} = " in tex) == (name in system.parts)


def test_the_first_line_is_the_equation_of_motion():
    assert compound_pendulum().system.equations().startswith("M q̈ = Q\n\nq = (q_pin)\nq̇ = (q̇_pin)\n\n")
    assert driven().equations().startswith("[M  Φ_qᵀ; Φ_q  0] [q̈; λ] = [Q; γ]\n\nq = (x_rod, y_rod, θ_rod)\n")
    top = mb.Body("top", 1.0, (1.0, 2.0, 3.0), mb.Spatial())
    tip = mb.Spherical("tip", GROUND.point(0, 0, 0), top.point(0, 0, 1.0))
    assert mb.System(top, tip).equations().startswith("[M  Gᵀ; G  0] [v̇; λ] = [Q; γ],   G = Φ_q N,   q̇ = N v\n")
    assert mb.System(top, tip).joint_space().equations().startswith("M v̇ = Q,   q̇ = N v\n")
    assert mb.System().equations() == mb.System().latex() == ""


def test_decimals_and_fractions():
    text = compound_pendulum().system.equations()
    assert "-4.905⋅l⋅m⋅sin(q_pin)" in text and "981" not in text
    assert r"\frac{l^{2} m}{3}" in compound_pendulum().system.latex()
    before = pretty_use_unicode(False)  # what SymPy finds for itself where the standard output has no Unicode
    assert compound_pendulum().system.equations() == text and not pretty_use_unicode(before)


def test_what_long_entries_share_has_names():
    """And numbers agree, if names are replaced by what they stand for."""
    system = next(model for model in ALL_MODELS if "six_axis" in model.__name__).scene().system.joint_space()
    read = system._as_read
    assert read.wide == {"M", "Q"} and "\nwith\na1 = " in read.text and "a_{1} &= " in system.latex()
    names = system.names
    at = dict(zip(names, np.random.default_rng(4).uniform(-1, 1, len(names)), strict=True))
    values = {sp.Symbol(name, real=True): value for name, value in at.items()}
    for symbol, meaning in read.shared.items():
        values[symbol] = float(meaning.xreplace(values))
    for part in ("M", "Q"):
        expected = ca.Function("value", [*names.values()], [getattr(system, part)])(*at.values()).full()
        mine = np.array(read.matrices[part].xreplace(values).tolist(), float)
        assert_allclose(mine, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize(
    "model",
    but_long(ALL_MODELS, *(m for m in ALL_MODELS if m.__name__.endswith(("_platform", "excavator", "_axis_arm")))),
    ids=lambda module: module.__name__.rpartition(".")[2],
)
@pytest.mark.parametrize("in_joints", [False, True])
def test_equations_of_models(model, in_joints):
    """All are printed, in LaTeX too, in ten seconds of processor time."""
    system = model.scene().system
    if in_joints:
        system = system.joint_space()
    start = time.process_time()
    text, latex = system.equations(), system.latex()
    seconds = time.process_time() - start
    assert seconds < 10
    assert all(len(line) <= 110 for line in text.splitlines() if " " in line.strip() and "⎢" not in line)
    assert latex.count(r"\[ ") == latex.count(r" \]") == len(system._as_read.displays)
