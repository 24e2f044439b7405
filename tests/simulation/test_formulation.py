"""Runs in coordinates of joints against those in coordinates of bodies."""

from dataclasses import replace

import bricard
import numpy as np
import pytest
from mechanisms import double_pendulum
from numpy.testing import assert_allclose

import symmb as mb
from models import andrews, four_bar, spherical_pendulum

TIGHT = mb.DormandPrince(rtol=1e-11)
GROUND = mb.Ground()


def controlled_arm():
    """Two links with a sampled law, a state, a stop and a motor in each joint."""
    p = mb.Parameters(m=1.0)
    elements, outputs, end = [mb.Gravity(0, -9.81)], {}, GROUND.point(0, 0)
    for k in range(2):
        link = mb.Body(f"link{k}", p.m, 0.1)
        joint = mb.Revolute(f"j{k}", end, link.point(-0.5, 0))
        lag = mb.State(f"lag{k}", rate=lambda z, joint=joint: (joint.angle - z) / 0.1)
        held = mb.Sampled(f"held{k}", period=0.013, law=-20 * (lag.value - 0.5) - 3 * joint.angle_rate)
        stop = mb.Stop(f"stop{k}", joint, -1.2, 0.4, mb.KelvinVoigt(500.0, 5.0))
        elements += [link, joint, lag, held, stop, mb.Actuator(f"motor{k}", joint, held.value)]
        outputs |= {f"angle{k}": joint.angle, f"held{k}": held.value, f"lag{k}": lag.value}
        end = link.point(0.5, 0)
    system = mb.System(*elements, parameters=p)
    return mb.Scene(system, {"j0.angle": -0.4, "j1.angle": 0.3}, np.linspace(0, 1, 11), outputs)


def hanging():
    """Two rods that hang in equilibrium against a torsional spring, and then its support moves."""
    p = mb.Parameters(m=1.0)
    elements, end = [mb.Gravity(0, -9.81)], GROUND.point(0, 0)
    for k in range(2):
        rod = mb.Body(f"rod{k}", p.m, 0.1)
        joint = mb.Revolute(f"j{k}", end, rod.point(-0.5, 0))
        elements += [rod, joint, mb.Actuator(f"spring{k}", joint, -8.0 * joint.angle * (1 - 0.1 * mb.t))]
        end = rod.point(0.5, 0)
    system = mb.System(*elements, parameters=p)
    return mb.Scene(system, times=np.linspace(0, 2, 11), outputs={"x": end.x}, equilibrium=True, name="hanging")


SCENES = {
    "sampled values, states, stops": controlled_arm,
    "equilibrium": hanging,
    "redundant loop": lambda: bricard.scene(np.linspace(0, 1, 5)),
    "loops": lambda: andrews.scene().with_times(np.linspace(0, 0.01, 5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_samples_run_alike_in_both_coordinates(name):
    scene = SCENES[name]()
    bodies, joints = (mb.DAESimulator(replace(scene, coordinates=c), TIGHT) for c in ("body", "joint"))
    assert joints.formulation.dae.n_v < bodies.formulation.dae.n_v
    P = bodies.dae.p_nominal * np.array([[1.0], [1.02]])
    assert_allclose(joints.run(P).Y, expected := bodies.run(P).Y, rtol=0, atol=1e-8 * max(1, np.abs(expected).max()))
    d = P.shape[1]
    if name != "sampled values, states, stops":  # which switch
        slopes = [s.jets(bodies.dae.p_nominal, np.eye(d)[:1], 1)[1] for s in (bodies, joints)]
        assert_allclose(slopes[1], slopes[0], rtol=0, atol=1e-6 * max(1, np.abs(slopes[0]).max()))


@pytest.mark.parametrize("make", [lambda: bricard.scene(np.linspace(0, 1, 5)), double_pendulum])
def test_a_trajectory_looks_the_same_in_both(make):
    scene = replace(make(), outputs=None)
    body, joint = (mb.simulate(replace(scene, coordinates=c), mb.CVODES(rtol=1e-12)) for c in ("body", "joint"))
    assert body.names == joint.names
    assert_allclose(joint.q, body.q, atol=1e-8)
    assert_allclose(joint.values, body.values, atol=1e-7)
    assert joint.position_drift < 1e-8


def test_reactions_and_accelerations_are_outputs_in_both():
    scene = double_pendulum(np.linspace(0, 1, 5))
    reaction, a = scene.system.reaction("shoulder").force, scene.system.vdot
    scene = scene.with_outputs({"x": reaction[0], "y": reaction[1], "a": a[4]})
    body, joint = (mb.simulate(replace(scene, coordinates=c), TIGHT) for c in ("body", "joint"))
    assert_allclose(joint.values, body.values, atol=1e-8)


def test_the_cheaper_coordinates_are_chosen_and_told():
    study = mb.DAESimulator(double_pendulum(), mb.DormandPrince())
    assert study.coordinates == "joint" and study.reason.startswith("coordinates of joints: ")
    assert "coordinates of joints: " in mb.simulate(double_pendulum()).reason
    assert mb.DAESimulator(spherical_pendulum.scene(), mb.DormandPrince()).coordinates == "body"
    augmented = mb.DormandPrince(stabilization=mb.AugmentedLagrangian())
    assert mb.DAESimulator(four_bar.scene(), augmented).coordinates == "body"


def test_coordinates_that_are_not_possible_are_refused():
    with pytest.raises(mb.DeclarationError, match='coordinates="joint" are not possible: no joint carries a body'):
        mb.DAESimulator(replace(spherical_pendulum.scene(), coordinates="joint"), mb.DormandPrince())
