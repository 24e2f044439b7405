"""A shaping machine cuts slowly and returns fast. How much does the ratio of times depend on tolerances?

A crank turns at constant speed. Its pin slides in a slotted arm, which swings about a pivot below. The arm reverses
where it is a tangent to the pin's circle. So the crank length and the distance of the pivots determine the ratio.
`python examples/quick_return.py FOLDER` draws the machine into FOLDER.

Source: textbook mechanism, e.g. Norton, Design of Machinery; own values.
"""

import sys
from pathlib import Path

import numpy as np

import symmb as mb

SPEED = 2 * np.pi  # one turn per second

p = mb.Parameters(crank=0.1, distance=0.25)
ground = mb.Ground()
crank = mb.Body("crank", mass=1.0, inertia=1.0 * p.crank**2 / 3)
arm = mb.Body("arm", mass=2.0, inertia=2.0 * 0.4**2 / 12)
system = mb.System(
    crank,
    arm,
    mb.Revolute("shaft", ground.point(0, 0), crank.point(0, 0)),
    mb.Revolute("pivot", ground.point(0, -p.distance), arm.point(0, -0.2)),
    mb.PointOnLine("slot", arm.point(0, 0), crank.point(p.crank, 0), axis=(0, 1, 0)),
    mb.Motion("motor", crank.theta, SPEED * mb.t),
    parameters=p,
)
scene = mb.Scene(
    system,
    start={"crank.theta": 0.0},
    guess={"arm.theta": -0.4, "arm.y": 0.0},
    times=np.linspace(0.0, 1.0, 501),
    outputs={"swing": arm.theta, "rate": arm.omega},
    box=mb.Box(crank=(0.098, 0.102), distance=(0.248, 0.252)),
    name="quick return",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def ratio(crank: float, distance: float) -> float:
    """Time of the slow stroke, divided by the time of the fast stroke."""
    alpha = np.arcsin(crank / distance)
    return (np.pi + 2 * alpha) / (np.pi - 2 * alpha)


# The arm points from the pivot to the pin, and reverses twice per turn.
x, y = 0.1 * np.cos(SPEED * scene.times), 0.25 + 0.1 * np.sin(SPEED * scene.times)
assert np.abs(run["swing"] - np.arctan2(-x, y)).max() < 1e-6
slow = np.mean(run["rate"][:-1] > 0)
assert abs(slow / (1 - slow) - ratio(0.1, 0.25)) < 0.01
low, high = bounds["swing"]
assert abs(high.max() - np.arcsin(0.102 / 0.248)) < 1e-4
assert not bounds.warnings

if __name__ == "__main__":
    print(f"The slow stroke takes {ratio(0.1, 0.25):.3f} times as long as the fast stroke,")
    print(f"and {ratio(0.098, 0.252):.3f} to {ratio(0.102, 0.248):.3f} times as long within the tolerances.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "quick_return.html")
        mb.view(run, Path(sys.argv[1]) / "quick_return.png", time=0.15)
