"""A planar scene and the same scene of spatial bodies move alike: one joint library for both."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import symmb as mb

TIMES = np.linspace(0, 2, 41)
TIGHT = mb.CVODES(rtol=1e-12, stabilization=mb.Projection())


def body(name, mass, inertia, planar):
    if planar:
        return mb.Body(name, mass, inertia, mb.Planar())
    return mb.Body(name, mass, (0.4 * inertia, 0.8 * inertia, inertia), mb.Spatial())


def turned(planar, name, angle, omega=0):
    """Start of a body turned about z, about which it turns."""
    place = {f"{name}.theta": angle} if planar else {f"{name}.rotation": mb.rotation((0, 0, 1), angle)}
    return place | ({f"{name}.omega": omega if planar else (0, 0, omega)} if omega else {})


def run(system, start, bodies, joint, **more):
    """Positions, velocities, turns and the reaction in a joint of the same names, whatever the poses are."""
    outputs, reaction = {}, system.reaction(joint)
    for b in bodies:
        point, R = b.point(0.3, 0.1), b.rotation
        outputs |= {f"{b.name}.p{name}": getattr(point, name) for name in ("x", "y", "vx", "vy")}
        outputs |= {f"{b.name}.turn": ca.atan2(R[1, 0], R[0, 0]), f"{b.name}.spin": b.omega[b.omega.numel() - 1]}
    outputs |= {name: getattr(reaction, name) for name in ("fx", "fy", "fz", "tx", "tz")}
    trajectory = mb.simulate(mb.Scene(system, start=start, times=TIMES, outputs=outputs, **more), TIGHT)
    assert trajectory.position_drift < 1e-13
    assert trajectory.energy_drift < 1e-9
    return trajectory.values


def chain(planar):
    """Two rods and a plate that slides along the second; spring, damper, torsion spring, force, torque, gravity."""
    ground = mb.Ground()
    rod1, rod2, plate = (body(f"b{i}", m, j, planar) for i, m, j in ((1, 1.0, 0.2), (2, 2.0, 0.1), (3, 0.5, 0.3)))
    system = mb.System(
        rod1, rod2, plate,
        mb.Revolute("shoulder", ground.point(0, 0), rod1.point(-0.5, 0)),
        mb.Revolute("elbow", rod1.point(0.5, 0.1), rod2.point(-0.4, 0)),
        mb.Prismatic("slide", rod2.point(0, 0), plate.point(0.1, 0), axis=(1, 0, 0)),
        mb.Gravity(0.3, -9.81),
        mb.SpringDamper("spring", rod2.point(0.2, 0), plate.point(0, 0.3), 80.0, 0.6, 0.2),
        mb.TorsionSpring("torsion", rod1, rod2, 3.0, 0.05, 0.4),
        mb.Force("push", plate.point(0, 0.2), (ca.sin(3 * mb.t), 1.0)),
        mb.Torque("twist", rod1, 0.4),
    )  # fmt: skip
    return run(system, turned(planar, "b1", 0.3, 1.5) | turned(planar, "b2", -0.8), (rod1, rod2, plate), "elbow")


def slider_crank(planar):
    """In space, a ball joint and a cylindrical joint carry the rod: with hinges it would be redundant."""
    ground = mb.Ground()
    parts = (("crank", 1.0, 0.1), ("rod", 1.5, 0.3), ("slider", 2.0, 0.2))
    crank, rod, slider = (body(*part, planar) for part in parts)
    wrist, pin = (mb.Revolute, mb.Revolute) if planar else (mb.Cylindrical, mb.Spherical)
    system = mb.System(
        crank, rod, slider,
        mb.Revolute("main", ground.point(0, 0), crank.point(-0.2, 0)),
        pin("pin", crank.point(0.2, 0), rod.point(-0.6, 0)),
        wrist("wrist", rod.point(0.6, 0), slider.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0.1), slider.point(0, 0), axis=(1, 0, 0)),
        mb.Gravity(0, -9.81),
        mb.Spring("spring", ground.point(2.5, 0.1), slider.point(0, 0), 30.0, 0.5),
    )  # fmt: skip
    start, guess = turned(planar, "crank", 0.6, 4.0), {"slider.x": 1.5, "rod.x": 0.9}
    return run(system, start, (crank, rod, slider), "pin", guess=guess)


@pytest.mark.parametrize("machine", [chain, slider_crank], ids=lambda machine: machine.__name__)
def test_a_machine_moves_alike_in_the_plane_and_in_space(machine):
    planar, spatial = machine(True), machine(False)
    assert np.ptp(planar, axis=0)[0] > 0.3  # it moves
    assert_allclose(spatial, planar, atol=1e-8)
