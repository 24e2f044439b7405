"""A six-axis arm with PD control carries a load. Where does the tip stop if the masses are known to 5 %?

Every joint has an axis, an angle, and a motor. The torque of the motor is a linear function of the angle and its rate.
Positions of links are not needed: symmb places the bodies along the joints by the angles at the start.
`python examples/six_axis_arm.py FOLDER` draws the arm into FOLDER.

Source: axes and lengths of a common industrial arm with a spherical wrist, rounded; own gains.
"""

import sys

import numpy as np

import symmb as mb

AXES = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
ENDS = [(0.1, 0, 0.4), (0, 0, 0.6), (0.3, 0, 0.1), (0.3, 0, 0), (0.1, 0, 0), (0.1, 0, 0)]  # ends of the links [m]
MASSES = [20.0, 15.0, 10.0, 6.0, 2.0]  # links without the load [kg]
GAINS = [(6000, 1200), (8000, 1600), (5000, 800), (400, 40), (400, 40), (50, 5)]  # [N m/rad], [N m s/rad]
TARGETS = {"j0.angle": 0.8, "j1.angle": 0.4, "j2.angle": -0.3, "j3.angle": 1.0, "j4.angle": -0.6, "j5.angle": 2.0}

p = mb.Parameters(load=5.0, links=1.0)
elements, end = [mb.Gravity(0, 0, -9.81)], mb.Ground().point(0, 0, 0)
for k, (stiffness, damping) in enumerate(GAINS):
    mass = p.links * MASSES[k] if k < 5 else p.load
    link = mb.Body(f"link{k}", mass, [0.02 * mass] * 3, mb.Spatial(), com=tuple(x / 2 for x in ENDS[k]))
    joint = mb.Revolute(f"j{k}", end, link.point(0, 0, 0), axis=AXES[k])
    law = stiffness * (TARGETS[f"j{k}.angle"] - joint.angle) - damping * joint.angle_rate
    elements += [link, joint, mb.Actuator(f"motor{k}", joint, law)]
    end = link.point(*ENDS[k])
system, outputs = mb.System(*elements, parameters=p), {"x": end.x, "y": end.y, "z": end.z}
scene = mb.Scene(system, dict.fromkeys(TARGETS, 0.0), np.linspace(0.0, 4.0, 81), outputs, mb.Box.around(p, 0.05))
low, high = mb.propagate(scene, mb.PolynomialChaos(order=2))["z"]

rest = mb.simulate(mb.Scene(system, guess=TARGETS, outputs=outputs, equilibrium=True))
assert low[-1] < rest["z"][0] < high[-1]
if __name__ == "__main__":
    print(f"The tip stops at z = {low[-1]:.4f} to {high[-1]:.4f} m. The nominal value is {rest['z'][0]:.4f} m.")
    if len(sys.argv) > 1:
        mb.view(mb.simulate(scene), f"{sys.argv[1]}/six_axis_arm.html")
