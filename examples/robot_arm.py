"""A robot arm with PD control lifts a load of uncertain mass. How far from its target does the tip stop?

Two motors turn the shoulder and the elbow. The torque of each motor is proportional to the angle error, minus a term
proportional to the speed. There is no integral term. So the arm sags under its weight until the torques are in balance.
`python examples/robot_arm.py FOLDER` draws the arm and the runs that attain the bounds into FOLDER.

Source: textbook control, e.g. Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, chapter 6; own values.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import root

import symmb as mb

L, M, G = 0.5, 3.0, 9.81
TARGET = np.radians([60.0, -70.0])
STIFFNESS, DAMPING = np.array([600.0, 250.0]), (60.0, 20.0)

p = mb.Parameters(load=1.0)
ground = mb.Ground()
upper, lower = (mb.Body(name, M, M * L**2 / 12) for name in ("upper", "lower"))
tip = lower.point(L / 2, 0)
load = mb.Body("load", p.load, pose=mb.Particle())
joints = [
    mb.Revolute("shoulder", ground.point(0, 0), upper.point(-L / 2, 0)),
    mb.Revolute("elbow", upper.point(L / 2, 0), lower.point(-L / 2, 0)),
]
motors = [
    mb.Actuator(f"{joint.name}_motor", joint, stiffness * (target - joint.angle) - damping * joint.angle_rate)
    for joint, target, stiffness, damping in zip(joints, TARGET, STIFFNESS, DAMPING, strict=True)
]
system = mb.System(
    upper, lower, load, *joints, mb.Spherical("grip", tip, load.point(0, 0)), *motors, mb.Gravity(0, -G), parameters=p
)
scene = mb.Scene(
    system,
    start={"shoulder.angle": 0.0, "elbow.angle": 0.0},
    times=np.linspace(0.0, 4.0, 201),
    outputs={"tip_x": tip.x, "tip_y": tip.y},
    box=mb.Box(load=(0.2, 2.0)),
    name="robot arm",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def rest(load: float) -> np.ndarray:
    """Position of the tip at which motor torques and weights are in balance."""

    def torques(angles: np.ndarray) -> np.ndarray:
        a, b = angles[0], angles.sum()
        at_elbow = G * L * (M / 2 + load) * np.cos(b)
        at_shoulder = at_elbow + G * L * (1.5 * M + load) * np.cos(a)
        return STIFFNESS * (TARGET - angles) - [at_shoulder, at_elbow]

    a, b = np.cumsum(root(torques, TARGET, tol=1e-12).x)
    return L * np.array([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)])


assert np.abs(run.values[-1] - rest(1.0)).max() < 1e-5
low, high = bounds["tip_y"]
assert np.allclose([low[-1], high[-1]], [rest(2.0)[1], rest(0.2)[1]], atol=1e-4)
assert not bounds.warnings

if __name__ == "__main__":
    wanted = L * (np.sin(TARGET[0]) + np.sin(TARGET.sum()))
    print(f"The tip stops {1e3 * (wanted - high[-1]):.0f} to {1e3 * (wanted - low[-1]):.0f} mm below its target.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "robot_arm.html")
        mb.view(bounds, Path(sys.argv[1]) / "robot_arm.png", output="tip_y", time=4.0)
