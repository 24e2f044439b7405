"""Thin disc rolling without slip on a horizontal plane.

              n  disc's axis, tilted by alpha from the vertical
            . '\\
           |    \\ u  steepest direction in the disc's plane
            \\  r o
             \\  /             contact c = r - R u
    ==========c/============  g = 9.81 m/s^2 along -z

One holonomic constraint: height of the contact = 0. Two velocity constraints: no slip of the disc at the contact.
The disc can roll steadily on a circle, with precession W and angular velocity w along n. The moments of inertia across
and along n are A and C. The balance of angular momentum about the centre is then:

    (C + m R^2) w W sin(alpha) - A W^2 sin(alpha) cos(alpha) + m g R cos(alpha) = 0

Source: Routh (1905), The Advanced Part of a Treatise on the Dynamics of a System of Rigid Bodies.
"""

import casadi as ca
import numpy as np

import symmb as mb


def steady_spin(alpha: float, precession: float, radius: float = 0.5, g: float = 9.81) -> float:
    """Angular velocity along the axis [rad/s] for steady rolling of a uniform disc on a circle.

    Parameters
    ----------
    alpha : float          tilt of the axis from the vertical, pi/2 for an upright disc [rad]
    precession : float     angular velocity about the vertical [rad/s]
    radius, g : float      radius of the disc [m], acceleration of gravity [m/s^2]
    """
    A, C = radius**2 / 4, radius**2 / 2  # for 1 kg
    return (A * precession**2 * np.sin(alpha) - g * radius) / ((C + radius**2) * precession * np.tan(alpha))


def scene(*, alpha: float = 1.2, precession: float = 2.0, spin: float | None = None) -> mb.Scene:
    """A uniform disc that starts to roll.

    Parameters
    ----------
    alpha : float          tilt of the axis from the vertical at the start [rad]
    precession : float     angular velocity about the vertical at the start [rad/s]
    spin : float           angular velocity along the axis at the start [rad/s]; steady rolling if left out
    """
    if spin is None:
        spin = steady_spin(alpha, precession)
    p = mb.Parameters(radius=0.5, mass=1.0)
    A = p.mass * p.radius**2 / 4
    disc = mb.Body("disc", mass=p.mass, inertia=(A, A, 2 * A), pose=mb.Spatial())
    n = disc.rotation[:, 2]
    level = ca.sqrt(n[0] ** 2 + n[1] ** 2)
    arm = -p.radius * ca.vertcat(-n[0] * n[2], -n[1] * n[2], level**2) / level  # from the centre to the contact
    slip = ca.vertcat(disc.vx, disc.vy, disc.vz) + ca.cross(disc.rotation @ disc.omega, arm)
    system = mb.System(
        disc,
        mb.Motion("contact", disc.z + arm[2], 0),
        mb.VelocityConstraint("rolling", (slip[0], slip[1])),
        mb.Gravity(0, 0, -9.81),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={
            "disc.x": 0.0,
            "disc.y": 0.0,
            "disc.rotation": mb.rotation(axis=(1, 0, 0), angle=alpha),
            "disc.omega": (0.0, precession * np.sin(alpha), spin),
        },
        guess={"disc.z": p.radius * np.sin(alpha)},
        times=np.linspace(0.0, 5.0, 251),
        outputs={
            "x": disc.x,
            "y": disc.y,
            "z": disc.z,
            "contact_x": disc.x + arm[0],
            "contact_y": disc.y + arm[1],
            "alpha": ca.arccos(n[2]),
            "spin": disc.omega[2],
            "load": -system.lam("contact"),
        },
        box=mb.Box.around(p, 0.02, names=["radius"]),
        name="rolling disc",
    )
