"""Declared names, numbers and matrices in text and in LaTeX."""

import casadi as ca
import pytest

from symmb.declare.symbolic.printing import plain, printer, set_names, typeset
from symmb.declare.symbolic.sympy_out import to_sympy


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
