"""Heavy symmetric top about a fixed point (Lagrange's top).

            z   / body's axis e3, mass centre at distance l
            |  /
       theta| /  . e1               zxz Euler angles: R = Rz(phi) Rx(theta) Rz(psi)
            |/ '
       =====o=====                  g = 9.81 m/s^2 along -z

A, C: moments of inertia about the fixed point across and along the axis. omega3 = psi' + phi' cos(theta) and
A phi' sin(theta)^2 + C omega3 cos(theta) are constant. Steady precession W:

    A cos(theta) W^2 - C omega3 W + m g l = 0

Source: Goldstein, Classical Mechanics, chapter 5 (the heavy symmetrical top with one point fixed).
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene(*, theta: float = 0.6, phi_dot: float = -2.0, omega3: float = 100.0) -> mb.Scene:
    """A top with phi = psi = 0 and theta' = 0 at the start. By default the path of the axis has loops.

    Parameters
    ----------
    theta : float        angle of the axis from the vertical at the start [rad]
    phi_dot : float      precession at the start [rad/s]
    omega3 : float       angular velocity along the axis [rad/s]
    """
    p = mb.Parameters(A=0.5, C=0.1, m=1.0, l=0.5, omega3=omega3)
    across = p.A - p.m * p.l**2
    top = mb.Body("top", mass=p.m, inertia=(across, across, p.C), pose=mb.Spatial(), com=(0, 0, p.l))
    system = mb.System(
        top, mb.Spherical("tip", mb.Ground().point(0, 0, 0), top.point(0, 0, 0)), mb.Gravity(0, 0, -9.81), parameters=p
    )
    R = top.rotation
    axes = {"e1": R[:, 0], "e3": R[:, 2]}
    return mb.Scene(
        system,
        start={
            "top.rotation": mb.rotation(axis=(1, 0, 0), angle=theta),
            "top.omega": (0.0, phi_dot * np.sin(theta), p.omega3),
        },
        times=np.linspace(0.0, 5.0, 201),
        outputs={
            **{f"{name}_{c}": e[i] for name, e in axes.items() for i, c in enumerate("xyz")},
            "theta": ca.arccos(R[2, 2]),
            "omega3": top.omega[2],
        },
        box=mb.Box.around(p, 0.02, names=["omega3", "l"]),
        name="heavy top",
    )
