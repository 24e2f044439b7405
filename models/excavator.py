r"""An excavator with three hydraulic cylinders moves an unknown load.

                     boom
                  ___----o elbow
              _.-' \      \ \           y
           .-'   stick     \ \ stick    |
          /    cylinder     \ \         +-- x      g = 9.81 m/s^2 along -y
     foot o__                \ o wrist
         /   ``--o boom       \|_
     ===o===    cylinder       \_/ bucket with load

Each cylinder is a barrel and a rod that slides in it, with a pin at both ends: three closed loops. The pressure is a
first-order state: oil flows in from a valve, the piston displaces oil, some oil leaks, the remainder is compressed,

    p' = E / V (flow - A x' - leak p),      force = A p.

The control of each valve uses the length error of the cylinder. The bucket's linkage is neglected.

Source: own design, as large as a machine of 20 t. Hydraulics: Merritt (1967), Hydraulic Control Systems, chapter 6.
"""

import casadi as ca
import numpy as np

import symmb as mb

BOOM, STICK, PERIOD = 5.0, 2.6, 8.0
"""Lengths [m], and period of the motion [s]."""
MASSES = {"boom": 1900.0, "stick": 1100.0, "bucket": 700.0}
"""Masses of the parts [kg]."""
AREA, VOLUME, LEAK = 0.03, 0.02, 1e-10
"""Area of a piston [m^2], volume of compressed oil [m^3], and leakage [m^3/s/Pa]."""
GAIN = 2.0
"""Speed of a piston per error of the length [1/s]. Leakage damps the control if GAIN is below E LEAK / V."""


def scene(*, load: float = 1000.0) -> mb.Scene:
    """The machine lifts its load, moves its stick out and its bucket in, and returns.

    Parameters
    ----------
    load : float           nominal mass in the bucket [kg]
    """
    p = mb.Parameters(load=load, oil=1.2e9)  # [kg], bulk modulus of the oil [Pa]
    ground = mb.Ground()
    boom, stick = (
        mb.Body(name, MASSES[name], MASSES[name] * length**2 / 12)
        for name, length in (("boom", BOOM), ("stick", STICK))
    )
    bucket = mb.Body("bucket", MASSES["bucket"] + p.load, 300.0 + 0.2 * p.load)
    elements: list = [
        boom,
        stick,
        bucket,
        mb.Revolute("foot", ground.point(0, 0), boom.point(-BOOM / 2, 0)),
        mb.Revolute("elbow", boom.point(BOOM / 2, 0), stick.point(-STICK / 2, 0)),
        mb.Revolute("wrist", stick.point(STICK / 2, 0), bucket.point(-0.6, 0)),
        mb.Gravity(0, -9.81),
    ]
    lift = (1 - ca.cos(2 * np.pi / PERIOD * mb.t)) / 2  # from 0 to 1 and back
    # Ends; lengths of barrel and rod; lengths of the cylinder at the start and at the reversal of the motion [m]; and
    # pressure at the start, which approximately holds the machine [Pa].
    cylinders = {
        "boom": (ground.point(0.9, -0.6), boom.point(-0.5, 0.6), 1.4, 2.0, 2.55, 6.5e6),
        "stick": (boom.point(0.3, 0.9), stick.point(-1.9, 0.3), 1.6, 2.52, 2.4, -1.0e6),
        "bucket": (stick.point(-0.8, 0.5), bucket.point(-0.9, 0.4), 1.3, 2.04, 1.78, 0.1e6),
    }
    start, outputs = {}, {"height": bucket.y, "reach": bucket.x}
    for name, (a, b, length, begin, end, first_pressure) in cylinders.items():
        barrel, rod = (mb.Body(f"{name}_{part}", 80.0, 80.0 * length**2 / 12) for part in ("barrel", "rod"))
        slide = mb.Prismatic(f"{name}_cylinder", barrel.point(length / 2, 0), rod.point(-length / 2, 0), (1, 0))
        stroke = begin + (end - begin) * lift - 2 * length

        def rate(pressure: ca.SX, slide: mb.Prismatic = slide, stroke: ca.SX = stroke) -> ca.SX:
            flow = AREA * (GAIN * (stroke - slide.displacement) + ca.jacobian(stroke, mb.t))
            return p.oil / VOLUME * (flow - AREA * slide.displacement_rate - LEAK * pressure)

        pressure = mb.State(f"{name}_pressure", rate)
        elements += [
            barrel,
            rod,
            mb.Revolute(f"{name}_barrel_pin", a, barrel.point(-length / 2, 0)),
            slide,
            mb.Revolute(f"{name}_rod_pin", rod.point(length / 2, 0), b),
            pressure,
            mb.Actuator(f"{name}_oil", slide, AREA * pressure.value),
        ]
        start |= {slide.name + ".displacement": begin - 2 * length, pressure.name: first_pressure}
        outputs[f"{name}_force"] = AREA * pressure.value
    return mb.Scene(
        mb.System(*elements, parameters=p),
        start=start,
        guess={"boom.theta": 0.35, "stick.theta": -1.2, "bucket.theta": -1.7},
        times=np.linspace(0.0, PERIOD, 161),
        outputs=outputs,
        box=mb.Box(load=(0.6 * load, 1.4 * load), oil=(1.0e9, 1.4e9)),
        name="excavator",
    )
