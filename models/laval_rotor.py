r"""Laval (Jeffcott) rotor: a disc on an elastic shaft with internal damping, at a constant speed.

              share of the length
        |<---------->|
        ^           _                 ^
        |          | |                |       y
       ///  =======| |===========    ///      |
     bearing       |_|            bearing     +--- x      z to the viewer
                   disc

The shaft is massless, of circular section, and simply supported at its ends. If the disc is not in the middle, it tilts
when the shaft bends. Gyroscopic moments then split the whirl into a forward and a backward whirl. Air damps the disc
(external damping). The internal damping of the shaft acts in axes that turn with the shaft. Above a certain speed, this
damping makes the forward whirl unstable. Two massless slides and two massless hinges carry the disc, so that the shaft
bends in fixed axes.

Source: Genta, Dynamics of Rotating Systems (2005), sec. 3.2 to 3.5; own values. Reference for a disc in the middle:
whirl grows above the speed omega (1 + external damping / internal damping). Here omega is the bending frequency.
"""

import numpy as np

import symmb as mb

DENSITY = 7850.0
"""Density of the disc [kg/m^3]."""


def scene(*, speed: float = 300.0, share: float = 0.3) -> mb.Scene:
    """A tenth of a second of straight running, or of whirl if a push is given.

    Parameters
    ----------
    speed : float      speed of the shaft [rad/s]
    share : float      distance of the disc from the left bearing, relative to the shaft's length
    """
    p = mb.Parameters(
        speed=speed,
        length=0.6,
        diameter=0.02,
        modulus=2.1e11,
        radius=0.15,
        thickness=0.02,
        external=60.0,
        internal=1e-4,
        share=share,
        push=0.0,
    )
    mass = DENSITY * np.pi * p.radius**2 * p.thickness
    polar = mass * p.radius**2 / 2
    across = polar / 2 + mass * p.thickness**2 / 12
    ground = mb.Ground()
    sled, hub, cradle, bearing = (
        mb.Body(name, 0.0, (0.0, 0.0, 0.0), mb.Spatial()) for name in ("sled", "hub", "cradle", "bearing")
    )
    disc = mb.Body("disc", mass, (polar, across, across), mb.Spatial())
    to_y = mb.Prismatic("to_y", ground.point(0, 0, 0), sled.point(0, 0, 0), axis=(0, 1, 0))
    to_z = mb.Prismatic("to_z", sled.point(0, 0, 0), hub.point(0, 0, 0), axis=(0, 0, 1))
    about_z = mb.Revolute("about_z", hub.point(0, 0, 0), cradle.point(0, 0, 0), axis=(0, 0, 1))
    about_y = mb.Revolute("about_y", cradle.point(0, 0, 0), bearing.point(0, 0, 0), axis=(0, -1, 0))  # dz/dx
    spin = mb.Revolute("spin", bearing.point(0, 0, 0), disc.point(0, 0, 0), axis=(1, 0, 0))
    K = _stiffness(p)
    y, z = (to_y.displacement, about_z.angle), (to_z.displacement, about_y.angle)
    y_rate, z_rate = (to_y.displacement_rate, about_z.angle_rate), (to_z.displacement_rate, about_y.angle_rate)
    forces = []
    for i, joints in enumerate(((to_y, to_z), (about_z, about_y))):
        for joint, own, rate, turned in zip(joints, (y, z), (y_rate, z_rate), (z, y), strict=True):
            sign = 1 if own is y else -1
            seen = [rate[k] + sign * p.speed * turned[k] for k in (0, 1)]  # rates in axes that turn with the shaft
            law = sum(-K[i][k] * (own[k] + p.internal * seen[k]) for k in (0, 1)) - (
                p.external * rate[0] if i == 0 else 0
            )
            forces.append(mb.Actuator(f"shaft_{joint.name}", joint, law))
    drive = mb.Motion("drive", spin.angle, p.speed * mb.t)
    bodies = (sled, hub, cradle, bearing, disc)
    return mb.Scene(
        mb.System(*bodies, to_y, to_z, about_z, about_y, spin, *forces, drive, parameters=p),
        start={
            "to_y.displacement": 0.0,
            "to_z.displacement": 0.0,
            "about_z.angle": 0.0,
            "about_y.angle": 0.0,
            "to_y.displacement_rate": p.push,
            "to_z.displacement_rate": 0.0,
            "about_z.angle_rate": 0.0,
            "about_y.angle_rate": 0.0,
        },
        times=np.linspace(0.0, 0.1, 201),
        outputs={"y": disc.y, "z": disc.z},
        box=mb.Box.around(p, 0.05, ("length", "diameter", "modulus", "external", "internal")),
        name="laval_rotor",
    )


def _stiffness(p: mb.Parameters) -> list[list]:
    """Stiffness matrix (2, 2) for deflection [m] and slope [rad] of the disc on a simply supported beam."""
    a, b = p.share * p.length, (1 - p.share) * p.length
    scale = 3 * p.modulus * (np.pi * p.diameter**4 / 64) * p.length
    ww, wt, tt = a**2 * b**2, a * b * (b - a), a**2 - a * b + b**2
    factor = scale / (ww * tt - wt**2)
    return [[factor * tt, -factor * wt], [-factor * wt, factor * ww]]
