r"""A Stewart platform: six legs with cylinders carry a load along a closed path.

                 ___load___
           _____|__________|_____       platform
            \  /     \  /     \  /      spherical joints
             \/       \/       \/
             /\       /\       /\       rods that slide in cylinders
            /  \     /  \     /  \
        ===o====o===o====o===o====o===  universal joints on the base     z up, g = 9.81 m/s^2

Each leg is a cylinder on a universal joint and a rod on a spherical joint. The rod slides in the cylinder. A controller
gives each cylinder a force that depends on the error of its length. The required lengths follow in closed form from the
required motion of the platform: a closed path on which the platform rises and turns about z.

Source: Stewart (1965), A platform with six degrees of freedom, Proc. Inst. Mech. Eng. 180; own values.
"""

import casadi as ca
import numpy as np

import symmb as mb

BASE, TOP, HEIGHT = 1.0, 0.6, 1.2
"""Radii of the rings of joints, and height of the upper ring at the start [m]."""
MASS, INERTIA = 50.0, (5.0, 5.0, 9.0)
"""Mass and inertia of the platform without load [kg], [kg m^2]."""
PART = 0.7
"""Length of a cylinder, and of a rod [m]. A leg is longer than PART and shorter than 2 PART."""
SPEED = np.pi
"""Angular frequency of the required motion [rad/s]."""


def ring(radius: float, spread: float) -> np.ndarray:
    """Three pairs of points on a circle [m], (6, 3). The points of a pair are `spread` degrees from its middle."""
    angles = np.radians([120 * (i // 2) + (spread if i % 2 else -spread) for i in range(6)])
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])


FEET, HEADS = ring(BASE, 50.0), ring(TOP, 20.0)


def wanted_pose(t: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Position of the platform's middle [m], (3,), and its angle about z [rad]; at rest at t = 0."""
    share = (1 - ca.cos(SPEED * t)) / 2
    return ca.vertcat(0.2 * share, 0.1 * share * ca.sin(SPEED * t), HEIGHT + 0.15 * share), 0.3 * share


def wanted_lengths(t: ca.SX) -> list[ca.SX]:
    """Lengths of the legs in the required motion [m]."""
    middle, angle = wanted_pose(t)
    c, s = ca.cos(angle), ca.sin(angle)
    heads = (middle + ca.vertcat(c * x - s * y, s * x + c * y, z) for x, y, z in HEADS)
    return [ca.norm_2(head - foot) for head, foot in zip(heads, FEET, strict=True)]


def scene(*, prescribed: bool = False, leg_mass: float = 8.0) -> mb.Scene:
    """A platform with a load. Mass and position of the load are uncertain.

    Parameters
    ----------
    prescribed : bool      if True, the legs follow the required lengths exactly, and the forces are the results
    leg_mass : float       mass of a cylinder, and of a rod; both are slender [kg]
    """
    p = mb.Parameters(load=100.0, offset=0.0)  # the load's mass [kg], and its position along the platform's x axis [m]
    total, ground = MASS + p.load, mb.Ground()
    moved = MASS * p.load / total * p.offset**2  # the load is a point mass
    inertia = (INERTIA[0], INERTIA[1] + moved, INERTIA[2] + moved)
    platform = mb.Body("platform", total, inertia, mb.Spatial(), com=(p.load * p.offset / total, 0, 0))
    elements, forces, guess = [platform, mb.Gravity(0, 0, -9.81)], {}, {}
    slender = (leg_mass * PART**2 / 12, leg_mass * PART**2 / 12, 0.01)
    for i, (foot, head, length) in enumerate(zip(FEET, HEADS, wanted_lengths(mb.t), strict=True)):
        along = np.array([0.0, 0.0, HEIGHT]) + head - foot
        start_length = float(np.linalg.norm(along))
        along /= start_length
        across = np.array([-along[1], along[0], 0.0]) / np.hypot(*along[:2])
        turn = mb.rotation((across[0], across[1], 0.0), float(np.arccos(along[2])))  # rotates z to the leg
        lower, upper = (mb.Body(f"{part}{i}", leg_mass, slender, mb.Spatial()) for part in ("cylinder", "rod"))
        toe, tip = lower.point(0, 0, -PART / 2), upper.point(0, 0, PART / 2)
        slide = mb.Prismatic(f"slide{i}", lower.point(0, 0, PART / 2), upper.point(0, 0, -PART / 2), axis=(0, 0, 1))
        stroke = length - 2 * PART  # the rod is inside the cylinder, so that the displacement is negative
        elements += [
            lower,
            upper,
            mb.Universal(f"foot{i}", ground.point(*foot), toe, axis=tuple(across), axis_b=(-across[1], across[0], 0)),
            slide,
            mb.Spherical(f"head{i}", tip, platform.point(*head)),
        ]
        drive = f"drive{i}"
        if prescribed:
            elements.append(mb.Motion(drive, slide.displacement, stroke))
        else:
            error, hold = stroke - slide.displacement, (MASS + 100.0 + 12 * leg_mass) * 9.81 / 6 / along[2]
            rate = ca.jacobian(length, mb.t) - slide.displacement_rate
            forces[f"force{i}"] = hold + 1e5 * error + 3e3 * rate
            elements.append(mb.Actuator(drive, slide, forces[f"force{i}"]))
        for body, place in ((lower, foot + PART / 2 * along), (upper, foot + (start_length - PART / 2) * along)):
            guess |= {f"{body.name}.{x}": float(r) for x, r in zip("xyz", place, strict=True)}
            guess[f"{body.name}.rotation"] = turn
    system = mb.System(*elements, parameters=p)
    if prescribed:
        forces = {f"force{i}": -system.lam(f"drive{i}")[0] for i in range(6)}
    middle = platform.point(0, 0, 0)
    pose = {"x": middle.x, "y": middle.y, "z": middle.z, "tilt": ca.asin(platform.rotation[0, 2])}
    start = {"platform.x": p.load * p.offset / total, "platform.y": 0.0, "platform.z": HEIGHT}
    return mb.Scene(
        system,
        start={} if prescribed else start | {"platform.rotation": mb.rotation((0, 0, 1), 0.0)},
        guess=guess | {"platform.z": HEIGHT},
        times=np.linspace(0.0, 2.0, 101),
        outputs=pose | forces,
        box=mb.Box(load=(90.0, 110.0), offset=(-0.05, 0.05)),
        name="Stewart platform",
    )
