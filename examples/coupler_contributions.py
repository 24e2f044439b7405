"""Which length of a four-bar causes the tolerance of its coupler point?

Each of the four lengths is known to 0.5 %. The width of the bounds is nearly the sum of the contributions of single
lengths. The contributions to the variance have other ratios, because they are proportional to the squares of widths.
`python examples/coupler_contributions.py FOLDER` draws the contributions into FOLDER.

Source: textbook mechanism; own values.
"""

import sys
from pathlib import Path

import numpy as np

import symmb as mb

p = mb.Parameters(crank=1.0, coupler=3.0, rocker=2.5, base=3.0)
ground = mb.Ground()
crank, coupler, rocker = (mb.Body(name, 1.0, 0.1) for name in ("crank", "coupler", "rocker"))
system = mb.System(
    crank,
    coupler,
    rocker,
    mb.Revolute("A", ground.point(0, 0), crank.point(0, 0)),
    mb.Revolute("B", crank.point(p.crank, 0), coupler.point(0, 0)),
    mb.Revolute("C", coupler.point(p.coupler, 0), rocker.point(p.rocker, 0)),
    mb.Revolute("D", ground.point(p.base, 0), rocker.point(0, 0)),
    mb.Motion("motor", crank.theta, 2.0 * mb.t),
    parameters=p,
)
box = mb.Box.around(p, 0.005)
scene = mb.Scene(
    system,
    guess={"coupler.theta": 0.7, "rocker.theta": 1.9},
    times=np.linspace(0, 3, 91),
    outputs={"tip_x": coupler.point(1.5, 1.0).x, "tip_y": coupler.point(1.5, 1.0).y},
    box=box,
    name="four-bar",
)
bounds = mb.propagate(scene, mb.PolynomialChaos(tolerance=1e-3))
found = bounds.contributions()
run = mb.simulate(scene)

slopes = mb.sensitivities(scene)
k = found.names.index("tip_y")
linear = np.stack([2 * r * np.abs(slopes["tip_y", name]) for name, r in zip(p, box.radius, strict=True)], axis=1)
width = found.width[:, k]
assert np.abs(found.alone[:, k] - linear).max() < 0.02 * width.max()
shares = np.square(linear) / np.square(linear).sum(axis=1, keepdims=True)
assert np.abs(found.first[:, k] - shares)[width > 0.1 * width.max()].max() < 0.05
i = int(width.argmax())
largest = int(found.alone[i, k].argmax())
assert found.first[i, k, largest] > found.alone[i, k, largest] / width[i]

if __name__ == "__main__":
    print(found)
    if len(sys.argv) > 1:
        found.plot(Path(sys.argv[1]) / "coupler_contributions.png")
        mb.view(run, Path(sys.argv[1]) / "coupler_contributions.html")
