r"""A six-axis arm from a URDF file, with an uncertain load. Proportional-derivative control acts on every joint.

              forearm_roll
         elbow    |      wrist_bend
          (o)=====|========(o)-|-[load]
           |                   tool_roll
           |
           |  upper arm                z
          (o) shoulder                 |
        __|_|__                        o--- x       g = 9.81 m/s^2 along -z
        | waist |
       -----------

The arm starts in its zero pose: the upper arm points up and the forearm points along x. Each motor torque is
linear in the joint's angle and rate, without gravity compensation. So the load determines how far the arm sags.

Source: own design; the machine is in six_axis_arm.urdf in the same folder.
"""

from pathlib import Path

import numpy as np

import symmb as mb

TARGETS = {"waist": 0.8, "shoulder": 0.4, "elbow": -0.3, "forearm_roll": 1.0, "wrist_bend": -0.6, "tool_roll": 2.0}
"""Target angles of the motors [rad]."""
GAINS = {
    "waist": (3000.0, 500.0),
    "shoulder": (5000.0, 800.0),
    "elbow": (2500.0, 300.0),
    "forearm_roll": (60.0, 2.5),
    "wrist_bend": (120.0, 8.0),
    "tool_roll": (12.0, 0.8),
}
"""Stiffness [N m/rad] and damping [N m s/rad] of the motors."""


def scene() -> mb.Scene:
    """The arm moves to its targets within two seconds."""
    p = mb.Parameters(load=3.0, forearm=4.0, elbow_y=-0.45)
    robot = mb.load_urdf(
        Path(__file__).with_suffix(".urdf"),
        replace={"payload.mass": p.load, "forearm.mass": p.forearm, "elbow.origin.y": p.elbow_y},
    )
    joints = robot.joints
    motors = [
        mb.Actuator(
            f"{name}_motor", joints[name], gain * (TARGETS[name] - joints[name].angle) - rate * joints[name].angle_rate
        )
        for name, (gain, rate) in GAINS.items()
    ]
    tool = robot.bodies["tool0"].point(0, 0, 0)
    return mb.Scene(
        mb.System(*robot.elements, *motors, mb.Gravity(0, 0, -9.81), parameters=p),
        start=robot.start,
        times=np.linspace(0.0, 2.0, 101),
        outputs={"x": tool.x, "y": tool.y, "z": tool.z, "elbow": joints["elbow"].angle},
        box=mb.Box(load=(2.7, 3.3), forearm=(3.8, 4.2), elbow_y=(-0.452, -0.448)),
        name="six-axis arm",
    )
