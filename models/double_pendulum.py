"""Planar double pendulum of two homogeneous rods of 1 kg/m. Their lengths are known to 5 %.

      ===o=====----> x        angles from the vertical, theta = -rod.theta
         |\\
       y v \\ rod1             released at rest at theta1 = 45 deg, theta2 = 60 deg
            \\                 g = 9.81 m/s^2 along y
             o
               ` . rod2
                   ` .

Source: Wang and Yang (2021), Nonlinear Dynamics, section 4.2, eqs. (37) to (39).
"""

import numpy as np

import symmb as mb


def scene() -> mb.Scene:
    """The double pendulum of the paper over ten seconds. Outputs are its twelve states."""
    p = mb.Parameters(l1=1.0, l2=1.0)
    ground = mb.Ground()
    rod1 = mb.Body("rod1", mass=p.l1, inertia=p.l1**3 / 12)
    rod2 = mb.Body("rod2", mass=p.l2, inertia=p.l2**3 / 12)
    system = mb.System(
        rod1,
        rod2,
        mb.Revolute("shoulder", ground.point(0, 0), rod1.point(0, -p.l1 / 2)),
        mb.Revolute("elbow", rod1.point(0, p.l1 / 2), rod2.point(0, -p.l2 / 2)),
        mb.Gravity(0, 9.81),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"rod1.theta": -np.pi / 4, "rod2.theta": -np.pi / 3},
        times=np.linspace(0.0, 10.0, 1001),
        outputs={
            "x1": rod1.x,
            "y1": rod1.y,
            "theta1": -rod1.theta,
            "x2": rod2.x,
            "y2": rod2.y,
            "theta2": -rod2.theta,
            "x1_dot": rod1.vx,
            "y1_dot": rod1.vy,
            "theta1_dot": -rod1.omega,
            "x2_dot": rod2.vx,
            "y2_dot": rod2.vy,
            "theta2_dot": -rod2.omega,
        },
        box=mb.Box.around(p, 0.05),
        name="double pendulum",
    )
