"""Planar four-bar linkage of uniform rods.

                    . o C
        coupler . '     \\
            . '          \\  rocker
         o '              \\
    crank \\                \\
       =====o---------------o===== > x        g along -y
            0     ground

Grashof's rule holds (1 + 3 < 2.5 + 3): the crank makes full turns, the rocker oscillates.

Source: textbook linkage, e.g. Norton, Design of Machinery.
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene(
    *,
    crank: float = 1.0,
    coupler: float = 3.0,
    rocker: float = 2.5,
    base: float = 3.0,
    masses: tuple[float, float, float] = (1.0, 3.0, 2.5),
    theta: float = 0.5,
    omega: float = 3.0,
) -> mb.Scene:
    """A four-bar released with a turning crank. The coupler is above the ground.

    Parameters
    ----------
    crank, coupler, rocker, base : float     lengths; `base` is between the pivots on the ground [m]
    masses : (3,) floats                     masses of crank, coupler and rocker [kg]
    theta, omega : float                     angle [rad] and speed [rad/s] of the crank at the start
    """
    p = mb.Parameters(crank=crank, coupler=coupler, rocker=rocker, base=base)
    ground = mb.Ground()
    lengths = {"crank": p.crank, "coupler": p.coupler, "rocker": p.rocker}
    first, middle, last = (
        mb.Body(name, mass=mass, inertia=mass * length**2 / 12)
        for (name, length), mass in zip(lengths.items(), masses, strict=True)
    )
    system = mb.System(
        first,
        middle,
        last,
        mb.Revolute("pivot_crank", ground.point(0, 0), first.point(-p.crank / 2, 0)),
        mb.Revolute("B", first.point(p.crank / 2, 0), middle.point(-p.coupler / 2, 0)),
        mb.Revolute("C", middle.point(p.coupler / 2, 0), last.point(p.rocker / 2, 0)),
        mb.Revolute("pivot_rocker", ground.point(p.base, 0), last.point(-p.rocker / 2, 0)),
        mb.Gravity(0, -9.81),
        parameters=p,
    )
    # Law of cosines in the triangle B, C, rocker pivot: the guess is the assembly itself.
    x, y = p.base - p.crank * np.cos(theta), -p.crank * np.sin(theta)
    distance = ca.sqrt(x**2 + y**2)
    cosine = (p.coupler**2 + distance**2 - p.rocker**2) / (2 * p.coupler * distance)
    angle = ca.atan2(y, x) + ca.arccos(cosine)
    tip_x, tip_y = p.coupler * ca.cos(angle) - x, p.coupler * ca.sin(angle) - y
    C = middle.point(p.coupler / 2, 0)
    return mb.Scene(
        system,
        start={"crank.theta": theta, "crank.omega": omega},
        guess={"coupler.theta": angle, "rocker.theta": ca.atan2(tip_y, tip_x)},
        times=np.linspace(0.0, 5.0, 251),
        outputs={
            "theta_crank": first.theta,
            "omega": first.omega,
            "coupler_angle": middle.theta,
            "rocker_angle": last.theta,
            "C_x": C.x,
            "C_y": C.y,
            "C_x_dot": C.vx,
            "C_y_dot": C.vy,
        },
        box=mb.Box.around(p, 0.01),
        name="four-bar",
    )
