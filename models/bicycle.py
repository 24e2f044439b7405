r"""The Whipple bicycle: four rigid bodies on knife-edge wheels that roll without slip.

                    frame o------._  steering axis, tilted back by lambda
           (rider)  _.-'          \\
                 _.-'        fork o\\
        rear   .-'                 .-\\.  front
        wheel ( o )               ( o\\ )
     ----------P-------------------Q--\\------> x     z up, y to the left, g = 9.81 m/s^2 along -z
               |<----- wheelbase ----->|<>| trail

The rear and front contacts stay on the ground (two holonomic constraints) and do not slip (four velocity constraints).
Straight upright motion at the speed v is a steady motion.

Source: Meijaard, Papadopoulos, Ruina & Schwab (2007), Linearized dynamics equations for the balance and steer of a
bicycle: a benchmark and review, Proc. R. Soc. A 463; benchmark parameters of table 1. In the paper, z points down and y
points to the right. Reference: weave is stable above 4.292 m/s, capsize is unstable above 6.024 m/s.
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene(*, speed: float = 4.6) -> mb.Scene:
    """The benchmark bicycle, upright on a straight path. A nonzero parameter `lean_rate` [rad/s] is a push to the side.

    Parameters
    ----------
    speed : float          forward speed at the start [m/s]
    """
    p = mb.Parameters(
        v=speed,
        wheelbase=1.02,
        trail=0.08,
        tilt=np.pi / 10,
        rear_radius=0.3,
        rear_mass=2.0,
        frame_x=0.3,
        frame_z=0.9,
        frame_mass=85.0,
        fork_x=0.9,
        fork_z=0.7,
        fork_mass=4.0,
        front_radius=0.35,
        front_mass=3.0,
        lean_rate=0.0,
    )
    frame_inertia = np.array([[9.2, 0.0, -2.4], [0.0, 11.0, 0.0], [-2.4, 0.0, 2.8]])
    fork_inertia = np.array([[0.05892, 0.0, 0.00756], [0.0, 0.06, 0.0], [0.00756, 0.0, 0.00708]])
    frame = mb.Body("frame", p.frame_mass, frame_inertia, mb.Spatial())
    fork = mb.Body("fork", p.fork_mass, fork_inertia, mb.Spatial())
    rear = mb.Body("rear", p.rear_mass, (0.0603, 0.12, 0.0603), mb.Spatial())
    front = mb.Body("front", p.front_mass, (0.1405, 0.28, 0.1405), mb.Spatial())
    foot = p.wheelbase + p.trail  # where the steering axis meets the ground
    steering = mb.Revolute(
        "steering",
        frame.point(foot - p.frame_x, 0, -p.frame_z),
        fork.point(foot - p.fork_x, 0, -p.fork_z),
        axis=(-ca.sin(p.tilt), 0, ca.cos(p.tilt)),
    )
    system = mb.System(
        frame,
        fork,
        rear,
        front,
        steering,
        mb.Revolute(
            "rear_axle", frame.point(-p.frame_x, 0, p.rear_radius - p.frame_z), rear.point(0, 0, 0), axis=(0, 1, 0)
        ),
        mb.Revolute(
            "front_axle",
            fork.point(p.wheelbase - p.fork_x, 0, p.front_radius - p.fork_z),
            front.point(0, 0, 0),
            axis=(0, 1, 0),
        ),
        *_rolling("rear_contact", rear, p.rear_radius),
        *_rolling("front_contact", front, p.front_radius),
        mb.Gravity(0, 0, -9.81),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={
            "frame.x": p.frame_x,
            "frame.y": 0.0,
            "frame.rotation": mb.rotation(axis=(0, 1, 0), angle=0.0),
            "frame.vx": p.v,
            "frame.omega_x": p.lean_rate,
            "frame.omega_z": 0.0,
            "steering.angle": 0.0,
            "steering.angle_rate": 0.0,
            "rear_axle.angle": 0.0,
            "front_axle.angle": 0.0,
        },
        guess={"frame.z": p.frame_z},
        times=np.linspace(0.0, 5.0, 251),
        outputs={"lean": ca.asin(frame.rotation[2, 1]), "steer": steering.angle, "y": frame.y},
        box=mb.Box.around(p, 0.05, ("wheelbase", "trail", "tilt", "frame_x", "frame_z", "frame_mass")),
        name="bicycle",
    )


def _rolling(name: str, wheel: mb.Body, radius: ca.SX) -> tuple[mb.Motion, mb.VelocityConstraint]:
    """Constraints of a wheel that turns about its y axis. The wheel touches the ground and does not slip."""
    n = wheel.rotation[:, 1]
    level = ca.sqrt(n[0] ** 2 + n[1] ** 2)
    arm = -radius * ca.vertcat(-n[0] * n[2], -n[1] * n[2], level**2) / level  # from the centre to the contact
    slip = ca.vertcat(wheel.vx, wheel.vy, wheel.vz) + ca.cross(wheel.rotation @ wheel.omega, arm)
    return mb.Motion(name, wheel.z + arm[2], 0), mb.VelocityConstraint(f"{name}_slip", (slip[0], slip[1]))
