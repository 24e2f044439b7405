"""Spherical pendulum: a point mass on a massless rod.

        z
        |  ground
        o - - y                theta from the downward vertical, phi about z
      x  \\
          \\ length
           o m                 g = 9.81 m/s^2 along -z

    theta'' = phi'^2 sin(theta) cos(theta) - g/l sin(theta),   phi' sin(theta)^2 = const

Source: Landau and Lifshitz, Mechanics, section 14, problem 1.
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene(*, theta: float = 1.0, phi_dot: float = 2.0) -> mb.Scene:
    """The pendulum with an initial speed to the side.

    Parameters
    ----------
    theta : float        angle from the downward vertical at the start [rad]
    phi_dot : float      angular velocity about the vertical at the start [rad/s]
    """
    p = mb.Parameters(length=1.0, mass=1.0, phi_dot=phi_dot)
    ball = mb.Body("ball", mass=p.mass, pose=mb.Particle())
    system = mb.System(
        ball,
        mb.Distance("rod", mb.Ground().point(0, 0, 0), ball.point(0, 0, 0), p.length),
        mb.Gravity(0, 0, -9.81),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"ball.x": p.length * np.sin(theta), "ball.y": 0.0, "ball.vy": p.phi_dot * p.length * np.sin(theta)},
        guess={"ball.z": -p.length * np.cos(theta)},
        times=np.linspace(0.0, 5.0, 251),
        outputs={
            "x": ball.x,
            "y": ball.y,
            "z": ball.z,
            "theta": ca.atan2(ca.sqrt(ball.x**2 + ball.y**2), -ball.z),
            "pull": system.lam("rod"),
        },
        box=mb.Box.around(p, 0.05, names=["length", "phi_dot"]),
        name="spherical pendulum",
    )
