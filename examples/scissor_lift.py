"""A scissor lift needs the largest force at the bottom. Which force must its cylinder give if the load is uncertain?

Two crossed bars carry a table. A cylinder pulls the lower end of one bar along the floor at constant speed. If the bars
are light, the work of the cylinder is equal to the work that lifts the load. So the force is the weight divided by the
tangent of the bars' angle.
`python examples/scissor_lift.py FOLDER` draws the lift into FOLDER.

Source: textbook mechanism; own values.
"""

import sys
from pathlib import Path

import numpy as np

import symmb as mb

L, BEGIN, END, TIME, G = 2.0, 1.95, 1.2, 20.0, 9.81

p = mb.Parameters(load=300.0, length=L)
ground = mb.Ground()
rising, falling = (mb.Body(name, 1.0, 1.0 * L**2 / 12) for name in ("rising", "falling"))
table = mb.Body("table", p.load, 10.0)
half = p.length / 2
system = mb.System(
    rising,
    falling,
    table,
    mb.Revolute("foot", ground.point(0, 0), rising.point(-half, 0)),
    mb.Revolute("crossing", rising.point(0, 0), falling.point(0, 0)),
    mb.PointOnLine("floor", ground.point(0, 0), falling.point(half, 0), axis=(1, 0, 0)),
    mb.Revolute("hinge", table.point(-0.8, 0), falling.point(-half, 0)),
    mb.PointOnLine("rail", table.point(0.8, 0), rising.point(half, 0), axis=(1, 0, 0)),
    mb.Motion("cylinder", falling.point(half, 0).x, BEGIN + (END - BEGIN) * mb.t / TIME),
    mb.Gravity(0, -G),
    parameters=p,
)
scene = mb.Scene(
    system,
    guess={
        "rising.theta": 0.2,
        "falling.theta": -0.2,
        "rising.x": 1.0,
        "falling.x": 1.0,
        "table.x": 0.8,
        "table.y": 0.45,
    },
    times=np.linspace(0.0, TIME, 101),
    outputs={"height": table.y, "force": system.lam("cylinder")[0]},
    box=mb.Box(load=(280.0, 330.0), length=(1.995, 2.005)),
    name="scissor lift",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())

# Each bar has 1 kg, and rises half as fast as the table. At constant speed along the floor, the load decelerates.
height = np.sqrt(L**2 - (BEGIN + (END - BEGIN) * scene.times / TIME) ** 2)
slowed = ((END - BEGIN) / TIME) ** 2 * L**2 / height**3
angle = np.arcsin(height / L)
assert np.abs(run["height"] - height).max() < 1e-6
assert np.abs(run["force"] * np.tan(angle) / ((G - slowed) * 301.0) - 1).max() < 1e-4
low, high = bounds["force"]
assert (low < run["force"]).all() and (run["force"] < high).all() and not bounds.warnings
assert abs(high[-1] / low[-1] - 331 / 281) < 0.02  # the length has little effect when the lift is high

if __name__ == "__main__":
    print(f"The cylinder gives {low[0]:.0f} to {high[0]:.0f} N at the bottom,")
    print(f"and {low[-1]:.0f} to {high[-1]:.0f} N at the top.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "scissor_lift.html")
        mb.view(run, Path(sys.argv[1]) / "scissor_lift.png", time=12.0)
