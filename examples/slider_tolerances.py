"""A slider must stay within 0.15 mm of its position in the drawing. How wide may the tolerances of the lengths be?

In the worst case, all lengths are at the ends of their intervals. As a check, the largest factor of the tolerances also
follows from the derivatives of the closed-form position. This is accurate because the tolerances are small.
`python examples/slider_tolerances.py FOLDER` draws limits and bounds into FOLDER.

Source: textbook mechanism; own values.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import symmb as mb

LIMIT = 1.5e-4

p = mb.Parameters(crank=0.05, rod=0.15, offset=0.01)
ground = mb.Ground()
crank, rod, slider = (mb.Body(name, 1.0, 1e-3) for name in ("crank", "rod", "slider"))
turn = 10.0 * mb.t
system = mb.System(
    crank,
    rod,
    slider,
    mb.Revolute("bearing", ground.point(0, 0), crank.point(0, 0)),
    mb.Revolute("pin", crank.point(p.crank, 0), rod.point(0, 0)),
    mb.Revolute("wrist", rod.point(p.rod, 0), slider.point(0, 0)),
    mb.Prismatic("rail", ground.point(0, p.offset), slider.point(0, 0), axis=(1, 0, 0)),
    mb.Motion("motor", crank.theta, turn),
    parameters=p,
)
drawn = 0.05 * ca.cos(turn) + ca.sqrt(0.15**2 - (0.05 * ca.sin(turn) - 0.01) ** 2)
box = mb.Box.plus_minus(p, crank="50 ISO 2768-f", rod="150 ISO 2768-f", offset=1e-4)
scene = mb.Scene(
    system,
    guess={"rod.theta": 0.0},
    times=np.linspace(0, 2 * np.pi / 10, 73),
    outputs={"error": slider.x - drawn},
    box=box,
    name="slider-crank",
)
limits = {"error": (-LIMIT, LIMIT)}
same = mb.tolerances(scene, limits)
cheap = mb.tolerances(scene, limits, costs={})
run = mb.simulate(scene)

angle = 10.0 * scene.times
root = np.sqrt(0.15**2 - (0.05 * np.sin(angle) - 0.01) ** 2)
slope = np.abs(
    [
        np.cos(angle) - (0.05 * np.sin(angle) - 0.01) * np.sin(angle) / root,
        0.15 / root,
        (0.05 * np.sin(angle) - 0.01) / root,
    ]
)
assert abs(same.factor * (box.radius @ slope).max() / LIMIT - 1) < 5e-3
assert abs((cheap.box.radius @ slope).max() / LIMIT - 1) < 5e-3
assert same.check.kept and cheap.check.kept
assert cheap.cost is not None and cheap.cost < 3 / same.factor  # cheaper than one factor for all tolerances

if __name__ == "__main__":
    print(same, cheap, sep="\n\n")
    if len(sys.argv) > 1:
        cheap.check.plot(Path(sys.argv[1]) / "slider_tolerances.png")
        mb.view(run, Path(sys.argv[1]) / "slider_tolerances.html")
