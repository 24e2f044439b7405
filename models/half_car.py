"""Half of a car, seen from the side, over a bump.

                     body
          ___________________________
         |     rear        front     |
         |______o____________o_______|       y
                Z            Z   bushings    |
                O            O   wheels      +-- x, forward
        ========================/\\====
                                bump

A bushing, stiff along x and soft along y, attaches each wheel to the body. The tyre of the wheel cannot pull, so the
wheel lifts off at a steep bump. The coordinates move with the car, so that the road moves towards the car.

Source: textbook ride model, e.g. Gillespie, Fundamentals of Vehicle Dynamics (1992), chapter 5; own values.
"""

import casadi as ca
import numpy as np

import symmb as mb

WHEELBASE = 2.6
RADIUS = 0.3


def scene(*, speed: float = 10.0, height: float = 0.08, length: float = 0.6) -> mb.Scene:
    """A car in equilibrium. At the start its front wheel is at the foot of the bump.

    Parameters
    ----------
    speed : float      speed of the car [m/s]
    height : float     height of the bump [m]
    length : float     length of the bump [m]
    """
    p = mb.Parameters(speed=speed, height=height, suspension=22e3, tyre=190e3)
    mass, axle, g = 690.0, 40.0, 9.81
    ground = mb.Ground()
    body = mb.Body("body", mass=mass, inertia=1200.0)
    shape = mb.Table(length * np.linspace(0, 1, 9), np.sin(np.pi * np.linspace(0, 1, 9)) ** 2)
    elements, start, outputs = [], {}, {}
    for name, x, distance in (("front", WHEELBASE / 2, 0.0), ("rear", -WHEELBASE / 2, WHEELBASE)):
        wheel = mb.Body(name, mass=axle, inertia=0.9)
        road = ground.point(0, p.height * shape(p.speed * mb.t - distance))
        elements += [
            wheel,
            mb.Bushing(
                f"{name}_bushing",
                body.point(x, -0.3),
                wheel.point(0, 0),
                stiffness=(300e3, p.suspension, 0),
                damping=(3e3, 1.6e3, 0),
            ),
            mb.Contact(
                f"{name}_tyre", wheel.point(0, 0), road, (0, 1), mb.KelvinVoigt(p.tyre, damping=100.0), radius=RADIUS
            ),
        ]
        start |= {f"{name}.x": x, f"{name}.y": RADIUS - (mass / 2 + axle) * g / p.tyre}
        outputs[f"{name}_lift"] = ca.fmax(wheel.y - RADIUS - road.y, 0)
    down = mass / 2 * g / p.suspension
    start |= {"body.x": 0.0, "body.y": 0.3 + start["front.y"] - down, "body.theta": 0.0}
    return mb.Scene(
        mb.System(body, *elements, mb.Gravity(0, -g), parameters=p),
        start=start,
        times=np.linspace(0.0, 1.5, 301),
        outputs={"bounce": body.y - start["body.y"], "pitch": body.theta, **outputs},
        box=mb.Box(height=(0.95 * height, 1.05 * height), suspension=(21e3, 23e3)),
        name="half-car over a bump",
    )
