"""A rod hangs on a hinge and a spring. Does its tip stay below 180 mm for all lengths and springs within tolerances?

This is the first example of README. The runs at all corners of the box lie inside the bounds. One corner attains the
largest height. `python examples/rod_on_a_spring.py FOLDER` draws the rod and these runs into FOLDER.

Source: own values.
"""

import sys
from pathlib import Path

import numpy as np

import symmb as mb

p = mb.Parameters(length=(1000, "mm"), stiffness=(40, "N/m"))  # nominal values
ground = mb.Ground()
rod = mb.Body("rod", mass=p.length, inertia=p.length**3 / 12)  # 1 kg/m
tip = rod.point(p.length / 2, 0)
hinge = mb.Revolute("hinge", ground.point(0, 0), rod.point(-p.length / 2, 0))
spring = mb.Spring("spring", ground.point(1, 1), tip, p.stiffness, length=0.8)
system = mb.System(rod, hinge, spring, mb.Gravity(0, -9.81), parameters=p)
print(system.joint_space().equations(), end="\n\n")
scene = mb.Scene(
    system,
    start={"rod.theta": 0.0},  # the joints determine the other coordinates
    times=np.linspace(0, 2, 201),
    outputs={"tip_y": (tip.y, "mm")},
    box=mb.Box.plus_minus(p, length="20 mm", stiffness="10%"),
    name="rod on a spring",
)
run = mb.simulate(scene)  # one run: run["tip_y"] is an array over time
bounds = mb.propagate(scene, mb.PolynomialChaos())  # bounds["tip_y"] is lower and upper
limits = {"tip_y": (None, "180 mm")}
print(bounds.check(limits))  # does the tip stay below 180 mm?
factor = mb.tolerances(scene, limits).factor  # the largest factor that satisfies the limit
print(f"With {factor:.2f} times these tolerances the limit is satisfied.")

corners = mb.propagate(scene, mb.Vertex())
lower, upper = bounds["tip_y"]
assert (lower <= corners.lower[:, 0] + 0.1).all() and (corners.upper[:, 0] <= upper + 0.1).all()
assert abs(corners.upper.max() - upper.max()) < 0.1

if len(sys.argv) > 1:
    folder = Path(sys.argv[1])
    mb.view(bounds, folder / "rod_on_a_spring.html", output="tip_y", time=1.9, point=tip)
    bounds.plot(folder / "rod_on_a_spring.png")
