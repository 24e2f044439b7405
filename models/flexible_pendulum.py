"""Elastic rod with a bob at its end. The rod swings under gravity in the plane.

      ////
       (o)
        \\
         `.
           `-.          bends
              `-.
                 `o     bob            g along -y

The rod's frame is clamped at the hinge. The rod has modes for loads at the bob. These loads also stiffen the rod.

Source: textbook mechanism, e.g. Shabana, Dynamics of Multibody Systems, ch. 5 (flexible pendulum).
"""

import numpy as np

import symmb as mb

LENGTH, RADIUS, BOB = 1.0, 0.004, 0.3
STEEL = mb.Material(E=2.1e11, nu=0.3, density=7850.0)


def scene(*, count: int = 2, angle: float = np.pi / 2) -> mb.Scene:
    """Two seconds of swinging from rest.

    Parameters
    ----------
    count : int            number of modes of the rod
    angle : float          angle of the rod from the downward vertical at the start [rad]
    """
    p = mb.Parameters(bob=BOB, stiffness=2.0)
    ground = mb.Ground()
    mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (0, -LENGTH, 0)], mb.Section.circle(RADIUS), STEEL, elements=16))
    modes = mesh.modes(clamped=0, interfaces=[16], count=count, planar=True, damping=0.002, stiffening=True)
    rod = mb.FlexibleBody("rod", modes, mb.Planar())
    bob = mb.Body("bob", mass=p.bob, inertia=p.bob * 0.03**2 / 2)
    hinge = rod.point(0, 0)
    system = mb.System(
        rod,
        bob,
        mb.Revolute("hinge", ground.point(0, 0), hinge),
        mb.Weld("end", rod.point(0, -LENGTH), bob.point(0, 0)),
        mb.TorsionSpring("spring", ground, hinge.body, stiffness=p.stiffness),
        mb.Gravity(0, -9.81),
        parameters=p,
    )
    along = rod.rotation.T @ (bob.point(0, 0).r - hinge.r)
    return mb.Scene(
        system,
        start={"rod.theta": angle},
        guess={"bob.x": LENGTH * np.sin(angle), "bob.y": -LENGTH * np.cos(angle), "bob.theta": angle},
        times=np.linspace(0.0, 2.0, 201),
        outputs={"x": bob.x, "y": bob.y, "bend": along[0], "hinge_angle": hinge.body.theta},
        box=mb.Box.around(p, 0.1),
        name="flexible_pendulum",
    )
