"""The SymPy border: numbers on both sides must agree, exact constants stay exact, faults are told."""

import math
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from faults import refused

import symmb as mb
from symmb.declare.symbolic import given
from symmb.declare.symbolic.printing import plain, printer, set_names, typeset
from symmb.declare.symbolic.sympy_in import from_sympy, is_sympy
from symmb.declare.symbolic.sympy_out import to_sympy

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
NAMES = ["rod1.theta", "l1"]
SYMBOLS = {"rod1.theta": X, "l1": Y}
A, B = sp.symbols("rod1.theta l1", real=True)

SMOOTH = [(0.31, 0.74), (0.87, 0.22), (0.05, 0.93)]
CORNERS = [(0.0, 1.0), (1.0, 0.5), (-0.5, 1.0), (1.5, -1.0), (2.5, 1.0), (-2.3, -0.7), (1.0, 1.0), (-1.5, 1.0)]

OUT_SMOOTH = {
    "polynomial": X**2 * Y - 3 * X / Y + 2 * X - 1 / X,
    "powers": X**1.5 + Y**X + ca.sqrt(X) + X**-3 + X**0.3,
    "exponential": ca.exp(-X) + ca.expm1(Y) + ca.log(X) + ca.log1p(Y),
    "trigonometric": ca.sin(X) * ca.cos(Y) + ca.tan(X) + ca.asin(X) + ca.acos(Y) + ca.atan(X) + ca.atan2(X, Y),
    "hyperbolic": ca.sinh(X) + ca.cosh(Y) + ca.tanh(X) + ca.asinh(X) + ca.acosh(1 + X) + ca.atanh(Y),
    "error function": ca.erf(X) + ca.erfinv(Y),
    "hypot": ca.hypot(X, Y),
    "constants": 0.1 * X + Y / 12 + ca.pi / 6 + 9.81 + 2**0.5 * X,
}
OUT_CORNERS = {
    "absolute": ca.fabs(X) + 2 * ca.sign(Y),
    "extremes": ca.fmin(X, Y) - 3 * ca.fmax(X, 2 * Y),
    "rounding": ca.floor(X) + 10 * ca.ceil(Y),
    "fmod": ca.fmod(X, Y),
    "remainder": ca.remainder(X, Y),
    "copysign": ca.copysign(X, Y),
    "relations": (Y > X) + 2 * (X <= Y) + 4 * (X == Y) + 8 * (X != Y),
    "logic": ca.logic_and(X > 0, Y < 1) + 2 * ca.logic_or(X, Y - 1) + 4 * ca.logic_not(X - 1),
    "branches": ca.if_else(X > 0, X**2 + Y, ca.if_else(Y > 0.8, 3, -Y)) * 2 + ca.if_else(X == Y, 1, 5),
}
IN_SMOOTH = {
    "powers": B ** sp.Rational(3, 2) / sp.sqrt(A) + A**-2 + sp.cbrt(B) + 2**A + B**A,
    "trigonometric": sp.sec(A) + sp.csc(B) + sp.cot(A) + sp.tan(B) + sp.acos(A) + sp.atan2(A, -B) + sp.asin(A),
    "constants": sp.pi * A + sp.E * B + sp.Rational(1, 12) + sp.Float("0.1") + sp.GoldenRatio,
    "error functions": sp.erfc(A) + sp.erf(B),
    "exponential": sp.exp(A) * sp.log(B, 10) + sp.sinh(A) - sp.acosh(1 + B),
}
IN_CORNERS = {
    "piecewise": sp.Piecewise((A**2, A < 0), (B, sp.And(A < 2, B > 0)), (3, True)),
    "covered piecewise": sp.Piecewise((A, A < 1), (B, A >= 1)),
    "extremes": sp.Max(A, B, 1) + sp.Min(A, B**2),
    "steps": sp.Heaviside(A) + 10 * sp.Heaviside(B - 1, 0) + 100 * sp.Heaviside(A - B, 1),
    "absolute": sp.Abs(A) + sp.sign(B) + sp.floor(A) + sp.ceiling(B) + sp.Mod(A, B),
    "logic": sp.Piecewise((1, sp.Or(sp.Not(sp.Eq(A, B)), A >= 1)), (0, True)),
}


def _casadi(expr, point):
    return float(ca.Function("f", [X, Y], [expr])(*point))


def _sympy(expr, point):
    # exact rationals, so that SymPy decides ties and corners exactly
    return float(expr.subs({A: sp.Rational(str(point[0])), B: sp.Rational(str(point[1]))}).evalf(30))


def _cases(smooth, corners):
    groups = (smooth, SMOOTH), (corners, CORNERS)
    return [pytest.param(expr, points, id=name) for group, points in groups for name, expr in group.items()]


@pytest.mark.parametrize("expr, points", _cases(OUT_SMOOTH, OUT_CORNERS))
def test_out_and_back(expr, points):
    [out] = to_sympy(expr, [X, Y], NAMES)
    back = from_sympy(out, SYMBOLS)
    for point in points:
        value = _casadi(expr, point)
        assert _sympy(out, point) == pytest.approx(value, rel=1e-14, abs=1e-14), (out, point)
        assert _casadi(back, point) == pytest.approx(value, rel=1e-13, abs=1e-13), (out, point)


@pytest.mark.parametrize("expr, points", _cases(IN_SMOOTH, IN_CORNERS))
def test_in(expr, points):
    for point in points:
        expected = _sympy(expr, point)
        assert _casadi(from_sympy(expr, SYMBOLS), point) == pytest.approx(expected, rel=1e-14, abs=1e-14), point


def test_every_scalar_operation_of_casadi_has_a_counterpart_but_printing():
    # operations of matrices give a plain 0 when asked for scalars
    names = [name.removeprefix("OP_") for name in dir(ca) if name.startswith("OP_")]
    binary = "ADD SUB MUL DIV POW CONSTPOW LT LE EQ NE AND OR FMOD COPYSIGN IF_ELSE_ZERO FMIN FMAX ATAN2 LIFT HYPOT"
    binary = [*binary.split(), "REMAINDER", "PRINTME"]
    made = {n: ca.SX.unary(getattr(ca, "OP_" + n), X) for n in names if n not in binary}
    made |= {n: ca.SX.binary(getattr(ca, "OP_" + n), X, Y) for n in binary}
    scalar = {name: expr for name, expr in made.items() if not expr.is_constant()}
    assert len(scalar) >= 47
    refused("printme has no SymPy counterpart", to_sympy, scalar.pop("PRINTME"), [X, Y], NAMES)
    for expr in scalar.values():
        to_sympy(expr, [X, Y], NAMES)


@pytest.mark.parametrize(
    "value, expected",
    [
        (0.5, sp.Rational(1, 2)), (1 / 12, sp.Rational(1, 12)), (9.81, sp.Rational(981, 100)),
        (-7.0, sp.Integer(-7)), (math.pi, sp.pi), (-math.pi / 6, -sp.pi / 6), (math.radians(2.5), sp.pi / 72),
        (math.inf, sp.oo), (math.sqrt(2), sp.Float(math.sqrt(2))), (1e-20, sp.Float(1e-20)),
    ],
)  # fmt: skip
def test_constants(value, expected):
    assert to_sympy(ca.SX(value), [], []) == sp.Matrix([expected])


@pytest.mark.parametrize(
    "value", [np.nextafter(1 / 3, 1), np.nextafter(0.5, 0), math.pi * (1 + 1e-15), 3.14159265358979]
)
def test_floats_near_a_fraction_are_not_rounded(value):
    assert float(*to_sympy(ca.SX(value), [], [])) == value


def test_matrices_keep_shape_and_structural_zeros_and_branches_read_as_one_piecewise():
    sparse = ca.SX(3, 2)
    sparse[2, 0], sparse[0, 1] = X * Y, ca.sin(X)
    matrix = to_sympy(sparse, [X, Y], NAMES)
    assert matrix == sp.Matrix([[0, sp.sin(A)], [0, 0], [A * B, 0]])
    assert from_sympy(matrix, SYMBOLS).sparsity() == sparse.sparsity()
    assert to_sympy(ca.SX(2, 3), [], []) == sp.zeros(2, 3)
    [expr] = to_sympy(ca.if_else(X < 0, Y, ca.if_else(X < 1, X, 3)), [X, Y], NAMES)
    assert expr == sp.Piecewise((B, A < 0), (A, A < 1), (3, True))


def test_is_sympy_recognises_expressions_and_matrices():
    assert is_sympy(A + 1) and is_sympy(sp.Matrix([A])) and is_sympy(A < B)
    assert not is_sympy(1.0) and not is_sympy(X) and not is_sympy("l1")


def test_border_loads_without_sympy():
    use = "from symmb.declare.symbolic import is_sympy"
    code = f"import sys; {use}; raise SystemExit(is_sympy(1.0) or 'sympy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_unknown_names_are_told_at_once_with_near_misses():
    expr = sp.Symbol("rod1.thta") * sp.Symbol("mass_of_crane")
    fault = refused(r"Unknown symbol 'rod1\.thta'", from_sympy, expr, SYMBOLS)
    assert "Did you mean 'rod1.theta'?" in fault
    assert "Unknown symbol 'mass_of_crane' in a SymPy expression. Known names: rod1.theta, l1." in fault


@pytest.mark.parametrize(
    "expr, message",
    [
        (X * Y, "not listed: y"), (X * math.nan, "NaN constant"),
        (sp.besselj(0, A), "'besselj' in besselj.* has no CasADi counterpart"),
        (sp.Function("theta")(A), "function of time.*Symbol\\('rod1.theta'\\)"),
        (sp.Derivative(sp.Function("theta")(A), A), "function of time"),
        (A * sp.nan, "contains nan"),
        (sp.I * A, "'ImaginaryUnit'"),
        (sp.Piecewise((A, A < 0), (B, A > 1)), "is not defined for all values. Add the final branch"),
    ],
)  # fmt: skip
def test_faults_going_out_and_coming_in(expr, message):
    refused(message, *((from_sympy, expr, SYMBOLS) if is_sympy(expr) else (to_sympy, expr, [X], ["x"])))


# Declared names, numbers and matrices in text and in LaTeX.


@pytest.mark.parametrize(
    "name, tex, line",
    [
        ("t", "t", "t"), ("l1", "l_{1}", "l1"), ("m_12", "m_{12}", "m_12"), ("theta", r"\theta", "\u03b8"),
        ("stiffness", r"\mathrm{stiffness}", "stiffness"), ("2nd", r"\mathrm{2nd}", "2nd"),
        ("left_arm.omega", r"\omega_{\mathrm{left\_arm}}", "\u03c9_left_arm"), ("w", "w", "w"),
        ("top.wz", r"\omega_{z,\mathrm{top}}", "\u03c9z_top"), ("top.e0", r"e_{0,\mathrm{top}}", "e0_top"),
        ("rod1.x", r"x_{\mathrm{rod1}}", "x_rod1"), ("elbow.lam[0]", r"\lambda_{\mathrm{elbow},0}", "\u03bb_elbow[0]"),
        ("crane.hook.vy", r"v_{y,\mathrm{crane.hook}}", "vy_crane.hook"), ("mu_s", r"\mu_{s}", "\u03bc_s"),
        ("pin.angle", r"q_{\mathrm{pin}}", "q_pin"), ("pin.angle_rate", r"\dot{q}_{\mathrm{pin}}", "q\u0307_pin"),
        ("slide.displacement_rate", r"\dot{q}_{\mathrm{slide}}", "q\u0307_slide"), ("lam", r"\mathrm{lam}", "lam"),
        ("rod.theta", r"\theta_{\mathrm{rod}}", "\u03b8_rod"), ("rod.omega", r"\omega_{\mathrm{rod}}", "\u03c9_rod"),
        ("top.omega_x", r"\omega_{x,\mathrm{top}}", "\u03c9x_top"),
        ("elbow.lam[1]", r"\lambda_{\mathrm{elbow},1}", "\u03bb_elbow[1]"),
        ("angle_rate", r"\mathrm{angle}_{\mathrm{rate}}", "angle_rate"),
    ],
)  # fmt: skip
def test_names_in_text_and_latex(name, tex, line):
    assert (plain(name), typeset(name)) == (line, tex)


@pytest.mark.parametrize("set_one", [plain, typeset])
def test_names_differ_where_they_would_be_the_same(set_one):
    names = ["joint.angle", "joint.displacement", "joint2.angle", "q_joint", "m_1", "m1"]
    assert len(set(set_names(names, set_one).values())) == len(names)


@pytest.mark.parametrize("kind", ["str", "latex", "pretty"])
@pytest.mark.parametrize(
    ("value", "text"),
    [(9.81, "9.81"), (0.1, "0.1"), (2.5, "2.5"), (24.525, "24.525"), (-0.0625 / 5, "-0.0125"), (0.123456, "0.123456")],
)
def test_decimals_stay_decimals(kind, value, text):
    m, a = ca.SX.sym("m"), ca.SX.sym("a")
    for of in (ca.SX(value), value * m, a + value, ca.sqrt(m) + value * a * m):
        [entry] = to_sympy(of, [m, a], ["m", "a"])
        assert text.lstrip("-") in printer({}, kind).doprint(entry)


@pytest.mark.parametrize(
    ("value", "text"), [(1 / 12, "m/12"), (0.5, "m/2"), (3 / 8, "3*m/8"), (-1 / 3, "-m/3"), (2, "2*m")]
)
def test_fractions_of_derivations_stay_fractions(value, text):
    m = ca.SX.sym("m")
    assert printer({}, "str").doprint(to_sympy(value * m, [m], ["m"])[0]) == text


def test_matrix():
    l1, theta = ca.SX.sym("l1"), ca.SX.sym("theta")
    matrix = ca.SX(2, 2)
    matrix[0, 0], matrix[1, 1] = l1**3 / 12, -l1 * ca.cos(theta) / 2
    names = ["l1", "rod1.theta"]
    text = printer(set_names(names, typeset), "latex").doprint(to_sympy(matrix, [l1, theta], names))
    assert text == (
        r"\left[\begin{matrix}\frac{l_{1}^{3}}{12} & 0\\"
        r"0 & - \frac{l_{1} \cos{\left(\theta_{\mathrm{rod1}} \right)}}{2}\end{matrix}\right]"
    )


# Values that users give become SX in one place: numbers of any type are right, and others are refused.


@pytest.mark.parametrize("kind", [int, float, np.float16, np.float32, np.longdouble, np.int8, np.uint64])
def test_numbers_of_every_type(kind):
    for value in (kind(1), np.array(kind(1)), np.array([[kind(1)]]), [kind(1)], (kind(1),)):
        assert float(given(value)) == 1.0


@pytest.mark.parametrize(
    "value",
    [None, "1", b"1", 1j, 10**400, np.clongdouble(1), np.array(["a"]), np.array([1j]), np.ones((1, 1, 1)),
     [[1], [1, 2]], np.datetime64("2020-01-01"), np.timedelta64(3, "s"), ca.MX.sym("x"), {},
     object(), float, [ca.SX.sym("a"), "b"],
     np.ma.masked_array([1.0, 2.0], [True, False]), np.ma.masked, [0.0, np.ma.masked], True, np.bool_(True),
     np.array([True]), [True, 1.0], memoryview(b"x"), bytearray(b"x"), [memoryview(b"x")]],
    ids=lambda value: type(value).__name__,
)  # fmt: skip
def test_what_is_no_number(value):
    assert given(value) is None


def test_lists_of_expressions():
    a = ca.SX.sym("a")
    assert given([a, np.longdouble(2.0), ca.DM(3)]).shape == (3, 1)


@pytest.mark.parametrize(
    "declare",
    [
        lambda v, b: mb.Body("c", v, v, com=(v, 0)),
        lambda v, b: b.point(v, 0),
        lambda v, b: mb.Spring("s", mb.Ground().point(0, v), b.point(0, 0), v, 0.5),
        lambda v, b: mb.Force("f", b.point(0, 0), (v, 0)),
        lambda v, b: mb.Torque("t", b, v),
        lambda v, b: mb.ddt(v),
        lambda v, b: mb.Table([0, 1], [0, 1])(v),
        lambda v, b: mb.rotation(axis=(0, 0, v), angle=v),
    ],
)
def test_long_doubles_in_declarations(declare):
    """They ended Python itself."""
    body = mb.Body("b", 1.0, 0.1)
    made = [declare(v, body) for v in (np.longdouble(1.0), 1.0)]
    if isinstance(made[0], ca.SX):
        assert ca.is_equal(made[0], made[1], 2)
    elif hasattr(made[0], "actions"):
        runs = [mb.simulate(mb.Scene(mb.System(body, force), times=[0, 0.1]), mb.RungeKutta(steps=5)) for force in made]
        np.testing.assert_array_equal(runs[0]["b.x"], runs[1]["b.x"])
