"""Planar slider-crank of two uniform rods and a slider. Gravity or an initial speed moves it.

            o
     l1   /   ` .   l2
        / theta   ` .
    ===o. . . . . . .[m3]. . > x        g along -y
       |                =======

Variants: lengths and masses of the rods. With nearly equal lengths the motion passes close to a dead point.

Source: textbook mechanism, e.g. Haug (1989), Computer Aided Kinematics and Dynamics of Mechanical Systems, vol. 1.
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene(
    *,
    l1: float = 1.0,
    l2: float = 2.0,
    m1: float = 1.0,
    m2: float = 2.0,
    m3: float = 3.0,
    theta: float = np.pi / 4,
    omega: float = 0.0,
) -> mb.Scene:
    """A slider-crank released with a given speed.

    Parameters
    ----------
    l1, l2 : float         lengths of crank and rod [m]
    m1, m2, m3 : float     masses of crank, rod and slider, 0 for none [kg]
    theta, omega : float   angle [rad] and speed [rad/s] of the crank at the start
    """
    p = mb.Parameters(l1=l1, l2=l2, **{name: m for name, m in {"m1": m1, "m2": m2, "m3": m3}.items() if m})
    of_crank, of_rod, of_slider = (getattr(p, name) if name in p else 0.0 for name in ("m1", "m2", "m3"))
    ground = mb.Ground()
    crank = mb.Body("crank", mass=of_crank, inertia=of_crank * p.l1**2 / 12)
    rod = mb.Body("rod", mass=of_rod, inertia=of_rod * p.l2**2 / 12)
    slider = mb.Body("slider", mass=of_slider, inertia=of_slider * p.l1**2)  # it never turns
    system = mb.System(
        crank,
        rod,
        slider,
        mb.Revolute("main", ground.point(0, 0), crank.point(-p.l1 / 2, 0)),
        mb.Revolute("pin", crank.point(p.l1 / 2, 0), rod.point(-p.l2 / 2, 0)),
        mb.Revolute("wrist", rod.point(p.l2 / 2, 0), slider.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), slider.point(0, 0), axis=(1, 0, 0)),
        mb.Gravity(0, -9.81),
        parameters=p,
    )
    phi = -ca.arcsin(p.l1 * np.sin(theta) / p.l2)
    return mb.Scene(
        system,
        start={"crank.theta": theta, "crank.omega": omega},
        guess={"rod.theta": phi, "slider.x": p.l1 * np.cos(theta) + p.l2 * ca.cos(phi)},
        times=np.linspace(0.0, 5.0, 251),
        outputs={
            "theta": crank.theta,
            "theta_dot": crank.omega,
            "phi": rod.theta,
            "phi_dot": rod.omega,
            "x_slider": slider.x,
            "x_slider_dot": slider.vx,
        },
        box=mb.Box.around(p, 0.02, names=["l1", "l2"]),
        name="slider-crank",
    )
