"""How much does a bearing force depend on tolerances? A slider-crank is driven at constant speed. The lengths and the
slider's mass have intervals. The example computes the bounds of the force in the crankpin.

`python examples/bearing_force.py FOLDER` writes pictures of the mechanism and of the bounds into FOLDER.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import symmb as mb

SPEED = 2 * np.pi  # one turn per second

p = mb.Parameters(crank=0.1, rod=0.3, slider_mass=2.0)
ground = mb.Ground()
crank = mb.Body("crank", mass=0.5, inertia=0.5 * p.crank**2 / 12)
rod = mb.Body("rod", mass=0.8, inertia=0.8 * p.rod**2 / 12)
slider = mb.Body("slider", mass=p.slider_mass, pose=mb.Particle())
system = mb.System(
    crank,
    rod,
    slider,
    mb.Revolute("bearing", ground.point(0, 0), crank.point(-p.crank / 2, 0)),
    mb.Revolute("crankpin", crank.point(p.crank / 2, 0), rod.point(-p.rod / 2, 0)),
    mb.Spherical("wristpin", rod.point(p.rod / 2, 0), slider.point(0, 0)),
    mb.Motion("guide", slider.y, 0),
    mb.Motion("motor", crank.theta, SPEED * mb.t),
    mb.Damper("process", ground.point(-1, 0), slider.point(0, 0), 40.0),
    parameters=p,
)
pin = system.reaction("crankpin")
scene = mb.Scene(
    system,
    start={"crank.theta": 0.0},
    guess={"slider.x": 0.4},
    times=np.linspace(0.0, 1.0, 201),
    outputs={"stroke": slider.x, "pin_force": ca.sqrt(pin.fx**2 + pin.fy**2)},
    box=mb.Box(crank=(0.098, 0.102), rod=(0.297, 0.303), slider_mass=(1.9, 2.1)),
    name="bearing force",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())

# The stroke has a closed form. When the crank points outwards, the stroke increases with both lengths.
theta = SPEED * scene.times
stroke = 0.1 * np.cos(theta) + np.sqrt(0.3**2 - (0.1 * np.sin(theta)) ** 2)
assert np.abs(run["stroke"] - stroke).max() < 1e-6
assert abs(bounds["stroke"][1][0] - (0.102 + 0.303)) < 1e-6
assert run.energy_drift < 1e-6  # the energy balance includes the work of motor and damper
force_low, force_high = bounds["pin_force"]
assert (force_low <= run["pin_force"] + 1e-6).all() and (run["pin_force"] <= force_high + 1e-6).all()

if __name__ == "__main__":
    print(run)
    peak = int(force_high.argmax())
    print(
        f"largest pin force at {scene.times[peak]:.3f} s: {run['pin_force'][peak]:.2f} N nominal, "
        f"at most {force_high[peak]:.2f} N"
    )
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "bearing_force.html")
        bounds.plot(Path(sys.argv[1]) / "bearing_force.png")
