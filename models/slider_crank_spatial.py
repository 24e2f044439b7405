"""Spatial slider-crank: a crank about x, a rod with ball joints at both ends, a slider along x.

        z   B
        |  o' ` .              A = (0, 0.1, 0.12), crank 0.08 along z at theta = 0, turning about +x
        | /crank  ` .  rod     rod 0.3, slider on the x axis
        |o A          ` .
        |                 ` .
        +------------------[ ]---- x        g = 9.81 m/s^2 along -z

The rod is free to spin about its own axis. This spin stays 0, because nothing drives it. In the IFToMM version of this
benchmark, the slider has a universal joint, and the rod spins.

Source: Haug (1989), Computer Aided Kinematics and Dynamics of Mechanical Systems, vol. 1, spatial slider-crank;
dimensions as in the IFToMM library of computational benchmarks.
"""

import numpy as np

import symmb as mb


def scene() -> mb.Scene:
    """The mechanism starts with a crank speed of 6 rad/s."""
    p = mb.Parameters(crank=0.08, rod=0.3, m_crank=0.12, m_rod=0.5, m_slider=2.0)
    ground = mb.Ground()
    # Only the crank's inertia about x has an effect. The rod's inertia about its own axis has no effect.
    crank = mb.Body("crank", mass=p.m_crank, inertia=(1e-4, 1e-4, 1e-4), pose=mb.Spatial())
    rod = mb.Body("rod", mass=p.m_rod, inertia=(4e-4, 4e-3, 4e-3), pose=mb.Spatial())
    slider = mb.Body("slider", mass=p.m_slider, pose=mb.Particle())
    main = mb.Revolute("main", ground.point(0, 0.1, 0.12), crank.point(0, 0, -p.crank / 2), axis=(1, 0, 0))
    system = mb.System(
        crank,
        rod,
        slider,
        main,
        mb.Spherical("big_end", crank.point(0, 0, p.crank / 2), rod.point(-p.rod / 2, 0, 0)),
        mb.Spherical("small_end", rod.point(p.rod / 2, 0, 0), slider.point(0, 0, 0)),
        mb.PointOnLine("guide", ground.point(0, 0, 0), slider.point(0, 0, 0), axis=(1, 0, 0)),
        mb.Gravity(0, 0, -9.81),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"crank.rotation": mb.rotation(axis=(1, 0, 0), angle=0.0), "crank.omega": (6.0, 0.0, 0.0)},
        guess={"slider.x": 0.2, "rod.x": 0.1, "rod.y": 0.05, "rod.z": 0.1},
        times=np.linspace(0.0, 5.0, 501),
        outputs={"theta": main.angle, "theta_dot": crank.omega[0], "x_slider": slider.x, "x_slider_dot": slider.vx},
        box=mb.Box.around(p, 0.01, names=["crank", "rod"]),
        name="spatial slider-crank",
    )
