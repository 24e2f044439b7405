"""An excavator lifts its bucket with an uncertain load. Which forces must its three cylinders give?

Cylinders with given lengths move boom, stick and bucket. At the end, all parts are at rest, and the moment of
the boom cylinder about the boom's foot is equal to the moment of all weights.
`python examples/excavator.py FOLDER` draws the machine and the runs that attain the bounds into FOLDER.

Source: textbook machine of the size of 20 t; own values.
"""

import sys
from pathlib import Path

import numpy as np

import symmb as mb

BOOM, STICK, TIME, G = 5.0, 2.6, 6.0, 9.81
MASS = {"boom": 1900.0, "stick": 1100.0, "bucket": 700.0}

p = mb.Parameters(load=1000.0)
ground = mb.Ground()
boom, stick = (
    mb.Body(name, MASS[name], MASS[name] * length**2 / 12) for name, length in (("boom", BOOM), ("stick", STICK))
)
bucket = mb.Body("bucket", MASS["bucket"] + p.load, 300.0)
share = mb.t / TIME
lift = share**3 * (10 - 15 * share + 6 * share**2)  # from 0 to 1, at rest at both ends
elbow, wrist = boom.point(BOOM / 2, 0), stick.point(STICK / 2, 0)
cylinders = {  # ends, lengths at the start and at the end [m]
    "boom_cylinder": (ground.point(0.9, -0.6), boom.point(-0.5, 0.6), 2.0, 2.55),
    "stick_cylinder": (boom.point(0.3, 0.9), stick.point(-1.9, 0.3), 2.52, 2.4),
    "bucket_cylinder": (stick.point(-0.8, 0.5), bucket.point(-0.9, 0.4), 2.04, 1.78),
}
system = mb.System(
    boom,
    stick,
    bucket,
    mb.Revolute("foot", ground.point(0, 0), boom.point(-BOOM / 2, 0)),
    mb.Revolute("elbow", elbow, stick.point(-STICK / 2, 0)),
    mb.Revolute("wrist", wrist, bucket.point(-0.6, 0)),
    *[mb.Distance(name, a, b, begin + (end - begin) * lift) for name, (a, b, begin, end) in cylinders.items()],
    mb.Gravity(0, -G),
    parameters=p,
)
scene = mb.Scene(
    system,
    guess={"boom.theta": 0.35, "stick.theta": -1.2, "bucket.theta": -1.7},
    times=np.linspace(0.0, TIME, 121),
    outputs={name: -system.lam(name)[0] / 1e3 for name in cylinders} | {"height": bucket.y},
    box=mb.Box(load=(600.0, 1400.0)),
    name="excavator",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def moment(load: float) -> float:
    """Moment of the weights about the boom's foot at the end [N m]."""
    xs = np.array([run(body.x)[-1] for body in (boom, stick, bucket)])
    return G * float(xs @ [MASS["boom"], MASS["stick"], MASS["bucket"] + load])


a, b, _, length = cylinders["boom_cylinder"]
lever = abs(0.9 * (run(b.y)[-1] + 0.6) + 0.6 * (run(b.x)[-1] - 0.9)) / length
assert abs(run["boom_cylinder"][-1] * 1e3 * lever / moment(1000.0) - 1) < 1e-6
low, high = bounds["boom_cylinder"]
assert np.allclose([low[-1], high[-1]], [moment(load) / lever / 1e3 for load in (600.0, 1400.0)], rtol=1e-4)
assert not bounds.warnings

if __name__ == "__main__":
    for name in cylinders:
        low, high = bounds[name]
        print(f"{name}: {low.min():.0f} to {high.max():.0f} kN")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "excavator.html")
        mb.view(run, Path(sys.argv[1]) / "excavator.png", time=0.0)
        mb.view(run, Path(sys.argv[1]) / "excavator_end.png", time=TIME)
        bounds.plot(Path(sys.argv[1]) / "excavator_bounds.png")
