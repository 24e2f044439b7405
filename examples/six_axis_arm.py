"""A six-axis arm under PD control carries a load that is known to 5 %, as are its links. Where does the tip stop?

Every joint has an axis, an angle, and a motor with a linear law of this angle and its rate. Nobody writes down where a
link is: bodies are placed along the joints by their angles at the start. `python examples/six_axis_arm.py FOLDER` draws
the arm there.

Source: axes and lengths of a common industrial arm with a spherical wrist, rounded; own gains.
"""

import sys
from pathlib import Path

import numpy as np

import symmb as mb

AXES = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
ENDS = [(0.1, 0, 0.4), (0, 0, 0.6), (0.3, 0, 0.1), (0.3, 0, 0), (0.1, 0, 0), (0.1, 0, 0)]  # of the links [m]
MASSES = [20.0, 15.0, 10.0, 6.0, 2.0]  # of all but the load [kg]
TARGETS = [0.8, 0.4, -0.3, 1.0, -0.6, 2.0]
GAINS = [(6000, 1200), (8000, 1600), (5000, 800), (400, 40), (400, 40), (50, 5)]  # [N m/rad], [N m s/rad]

p = mb.Parameters(load=5.0, links=1.0)
elements, joints, end = [], [], mb.Ground().point(0, 0, 0)
for k, (axis, reach) in enumerate(zip(AXES, ENDS, strict=True)):
    mass = p.links * MASSES[k] if k < 5 else p.load
    link = mb.Body(f"link{k}", mass, [0.02 * mass] * 3, mb.Spatial(), com=tuple(x / 2 for x in reach))
    joint = mb.Revolute(f"j{k}", end, link.point(0, 0, 0), axis=axis)
    law = GAINS[k][0] * (TARGETS[k] - joint.angle) - GAINS[k][1] * joint.angle_rate
    elements += [link, joint, mb.Actuator(f"motor{k}", joint, law)]
    joints, end = [*joints, joint], link.point(*reach)
scene = mb.Scene(
    mb.System(*elements, mb.Gravity(0, 0, -9.81), parameters=p),
    start={f"j{k}.angle": 0.0 for k in range(6)},
    times=np.linspace(0.0, 4.0, 81),
    outputs={"x": end.x, "y": end.y, "z": end.z, **{joint.name: joint.angle for joint in joints}},
    box=mb.Box.around(p, 0.05),
    name="six-axis arm",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos(order=2))

standing = {f"j{k}.angle": target for k, target in enumerate(TARGETS)}
rest = mb.simulate(mb.Scene(scene.system, guess=standing, outputs=scene.outputs, equilibrium=True))
assert np.abs(run.values[-1] - rest.values[-1]).max() < 1e-3
low, high = bounds["z"]
assert low[-1] < rest["z"][0] < high[-1]

if __name__ == "__main__":
    print(f"The tip stops at z = {low[-1]:.4f} to {high[-1]:.4f} m.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "six_axis_arm.html")
