"""LaTeX of SX matrices and of declared names."""

import casadi as ca
import pytest

from symmb.symbolic.latex import latex, typeset


@pytest.mark.parametrize(
    "name, expected",
    [
        ("t", "t"),
        ("l1", "l_{1}"),
        ("m_12", "m_{12}"),
        ("mu_s", r"\mu_{s}"),
        ("theta", r"\theta"),
        ("stiffness", r"\mathrm{stiffness}"),
        ("left_arm.omega", r"\omega_{\mathrm{left\_arm}}"),
        ("top.wz", r"\omega_{z,\mathrm{top}}"),
        ("top.e0", r"e_{0,\mathrm{top}}"),
        ("rod1.x", r"x_{\mathrm{rod1}}"),
        ("elbow.lam[0]", r"\lambda_{\mathrm{elbow},0}"),
        ("crane.hook.vy", r"v_{y,\mathrm{crane.hook}}"),
        ("2nd", r"\mathrm{2nd}"),
    ],
)
def test_names(name, expected):
    assert typeset(name) == expected


def test_matrix():
    l1, theta = ca.SX.sym("l1"), ca.SX.sym("theta")
    matrix = ca.SX(2, 2)
    matrix[0, 0], matrix[1, 1] = l1**3 / 12, -l1 * ca.cos(theta) / 2
    text = latex(matrix, [l1, theta], ["l1", "rod1.theta"])
    assert text == (
        r"\left[\begin{matrix}\frac{l_{1}^{3}}{12} & 0\\"
        r"0 & - \frac{l_{1} \cos{\left(\theta_{\mathrm{rod1}} \right)}}{2}\end{matrix}\right]"
    )
