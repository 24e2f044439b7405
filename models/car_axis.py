"""Car axis: a chassis bar on two springs; the left wheel rolls on flat ground, the right one over a bumpy road.

       left o-----------------o right     bar of length L, half the mass at each end
            |                 |
            <  springs, L0    <           scaled: stiffness 1, masses M eps^2 / 2, g = 1
            |                 |
            o . . . . . . . . o           wheels: (0, 0) and (x_b, y_b), L apart
                              road        y_b = r sin(omega t), x_b = sqrt(L^2 - y_b^2)

The left spring stays perpendicular to the line between the wheels.

Source: Test Set for IVP Solvers, car axis problem (index 3), 0 <= t <= 3. In the test set, lam1 and lam2 belong to the
constraints x_l x_b + y_l y_b = 0 and (x_l - x_r)^2 + (y_l - y_r)^2 - L^2 = 0, with the opposite sign.
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene() -> mb.Scene:
    """The benchmark over three seconds. Outputs are the ten unknowns of the benchmark."""
    p = mb.Parameters(L=1.0, L0=0.5, eps=0.01, M=10.0, r=0.1, omega=10.0)
    y_b = p.r * ca.sin(p.omega * mb.t)
    x_b = ca.sqrt(p.L**2 - y_b**2)
    ground = mb.Ground()
    left, right = (mb.Body(name, mass=p.M * p.eps**2 / 2, pose=mb.Particle()) for name in ("left", "right"))
    system = mb.System(
        left,
        right,
        mb.Motion("upright", left.x * x_b + left.y * y_b, 0),
        mb.Distance("bar", left.point(0, 0), right.point(0, 0), p.L),
        mb.Spring("left_spring", ground.point(0, 0), left.point(0, 0), 1.0, p.L0),
        mb.Spring("right_spring", ground.point(x_b, y_b), right.point(0, 0), 1.0, p.L0),
        mb.Gravity(0, -1.0),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"left.y": p.L0, "right.y": p.L0, "left.vx": -p.r * p.omega * p.L0 / p.L},
        guess={"right.x": p.L},
        times=np.linspace(0.0, 3.0, 301),
        outputs={
            "x_l": left.x,
            "y_l": left.y,
            "x_r": right.x,
            "y_r": right.y,
            "x_l_dot": left.vx,
            "y_l_dot": left.vy,
            "x_r_dot": right.vx,
            "y_r_dot": right.vy,
            "lam1": -system.lam("upright"),
            "lam2": -system.lam("bar") / (2 * p.L),
        },
        box=mb.Box.around(p, 0.02, names=["M", "L0"]),
        name="car axis",
    )
