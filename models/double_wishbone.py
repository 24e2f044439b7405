r"""Double wishbone suspension of a quarter of a car, seen from behind.

         chassis, which slides up and down
        ____________
                 \  mount
            o=====\==========o       upper arm
                   \ spring   \
                    \ damper   \     knuckle and wheel (o): it stands on the road by a tyre spring
                     \         (o)                               y
           o==========o=========o    lower arm                   |
                     seat       Z tyre                           +--- x
        ========================Z=========== road

The axes of the arms are parallel to the driving direction, so that the wheel moves in a plane. Chassis, arms and
knuckle form two closed loops. The chassis carries a quarter of the car. The start is in equilibrium.

Source: textbook mechanism, e.g. Reimpell, Stoll & Betzler, The Automotive Chassis (2001), sec. 1.2; own values.
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene() -> mb.Scene:
    """One second at rest. Hard points [m] are given as drawn, from the middle of the car at the height of the road."""
    p = mb.Parameters(
        lower_x=0.30,  # inner hinges of the arms [m]
        lower_y=0.22,
        upper_x=0.38,
        upper_y=0.45,
        knuckle_x=0.70,  # lower end of the knuckle
        knuckle_y=0.20,
        top_x=0.66,  # upper end of the knuckle
        top_y=0.46,
        seat=0.28,  # place of the spring along the lower arm, from its hinge
        mount_x=0.42,
        mount_y=0.62,
        length=0.58,  # free length of the spring
        stiffness=42e3,
        damping=2.4e3,
        tyre=210e3,
        radius=0.33,  # free radius of the tyre
        sprung=380.0,  # masses [kg]
        unsprung=38.0,
    )
    lower_in, upper_in = (p.lower_x, p.lower_y), (p.upper_x, p.upper_y)
    lower_out, upper_out = (p.knuckle_x, p.knuckle_y), (p.top_x, p.top_y)
    center = 0.75, 0.31  # centre of the wheel
    ground = mb.Ground()
    chassis = mb.Body("chassis", p.sprung, 100.0)
    lower, upper = mb.Body("lower", 6.0, 0.08), mb.Body("upper", 3.0, 0.02)
    knuckle = mb.Body("knuckle", p.unsprung, 0.9)
    low, high = _length(lower_in, lower_out), _length(upper_in, upper_out)
    system = mb.System(
        chassis,
        lower,
        upper,
        knuckle,
        mb.Prismatic("slide", ground.point(0, 0), chassis.point(0, 0), axis=(0, 1, 0)),
        mb.Revolute("lower_hinge", chassis.point(*lower_in), lower.point(-low / 2, 0)),
        mb.Revolute("upper_hinge", chassis.point(*upper_in), upper.point(-high / 2, 0)),
        mb.Revolute("lower_ball", lower.point(low / 2, 0), knuckle.point(*_from(center, lower_out))),
        mb.Revolute("upper_ball", upper.point(high / 2, 0), knuckle.point(*_from(center, upper_out))),
        mb.SpringDamper(
            "strut",
            lower.point(p.seat - low / 2, 0),
            chassis.point(p.mount_x, p.mount_y),
            p.stiffness,
            p.damping,
            p.length,
        ),
        mb.Force("tyre", knuckle.point(0, 0), (0, p.tyre * (p.radius - knuckle.y))),
        mb.Gravity(0, -9.81),
        parameters=p,
    )
    return mb.Scene(
        system,
        guess={
            "knuckle.x": center[0],
            "knuckle.y": center[1],
            "lower.x": 0.5,
            "lower.y": 0.21,
            "upper.x": 0.52,
            "upper.y": 0.455,
        },
        equilibrium=True,
        times=np.linspace(0.0, 1.0, 101),
        outputs={"body": chassis.y, "wheel": knuckle.y, "camber": knuckle.theta},
        box=mb.Box.around(p, 0.02, ("lower_y", "upper_y", "seat", "stiffness", "tyre")),
        name="double_wishbone",
    )


def _length(a: tuple[ca.SX, ca.SX], b: tuple[ca.SX, ca.SX]) -> ca.SX:
    return ca.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)


def _from(a: tuple[float, float], b: tuple[ca.SX, ca.SX]) -> tuple[ca.SX, ca.SX]:
    return b[0] - a[0], b[1] - a[1]
