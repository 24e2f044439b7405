"""Flexible bodies in a floating frame against particles by virtual power, rigid bodies, closed forms, invariants."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from bricks import bar
from particles import accelerations, particle_modes
from problems import read

import symmb as mb

POSES = {"planar": mb.Planar, "spatial": mb.Spatial}


def random_state(dae: mb.DAESimulator, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q, v = rng.normal(size=dae.n_q), rng.normal(size=dae.n_v)
    at = [i for i, name in enumerate(dae.q_names) if name.rpartition(".")[2] in ("e0", "e1", "e2", "e3")]
    q[at] /= np.linalg.norm(q[at]) or 1.0
    return q, v


def undamped(modes: mb.Modes) -> mb.Modes:
    return replace(modes, damping=np.zeros_like(modes.damping))


@pytest.mark.parametrize("n", [1, 4])
@pytest.mark.parametrize("pose", POSES)
def test_mass_matrix_and_accelerations_are_those_of_the_particles(pose: str, n: int) -> None:
    planar = pose == "planar"
    modes, masses, *_ = particle_modes(n, planar)
    body = mb.FlexibleBody("body", modes, POSES[pose]())
    gravity = np.array([1.0, -9.81, 0.0 if planar else 2.0])
    dae = mb.compile_dae(mb.System(body, mb.Gravity(*gravity)))
    q, v = random_state(dae)
    A, b = (np.asarray(part) for part in accelerations(body, masses, gravity)(q, v))
    assert np.asarray(dae.M(q, v, [], 0.0)) == pytest.approx(A, abs=1e-12)
    assert np.asarray(dae.rhs(q, v, [], 0.0)[1]).ravel() == pytest.approx(-np.linalg.solve(A, b).ravel(), abs=1e-11)


@pytest.mark.parametrize("pose", POSES)
def test_without_modes_it_is_the_rigid_body(pose: str) -> None:
    planar = pose == "planar"
    whole, *_ = particle_modes(1, planar)
    c, m = whole.center, whole.mass
    about_c = whole.J0 - m * (c @ c * np.eye(3) - np.outer(c, c))
    turned = replace(whole, J0=about_c, center=np.zeros(3))
    none = {
        "J1": np.zeros((0, 3, 3)), "J2": np.zeros((0, 0, 3, 3)), "S": np.zeros((3, 0)), "G0": np.zeros((3, 0)),
        "G1": np.zeros((0, 3, 0)), "stiffness": np.zeros(0), "damping": np.zeros(0),
        "shapes": np.zeros((12, 3, 0)), "rotations": np.zeros((12, 3, 0)),
        "S2": np.zeros((3, 0, 0)), "shapes2": np.zeros((12, 3, 0, 0)),
    }  # fmt: skip
    ground = mb.Ground()

    def swing(body: mb.Body) -> mb.Trajectory:
        joint = mb.Revolute if planar else mb.Spherical
        system = mb.System(
            body,
            joint("hinge", ground.point(0, 0), body.point(*whole.positions[0])),
            mb.Gravity(0.5, -9.81),
            mb.Force("push", body.point(*whole.positions[1]), (3.0, ca.sin(5 * mb.t))),
        )
        spin = {"body.omega": 1.0 if planar else (1.0, 2.0, 3.0)}
        scene = mb.Scene(system, start=spin, times=np.linspace(0, 1, 11), coordinates="body")
        return mb.simulate(scene, mb.DormandPrince(rtol=1e-12))

    inertia = float(about_c[2, 2]) if planar else (about_c + about_c.T) / 2
    rigid = swing(mb.Body("body", whole.mass, inertia, POSES[pose]()))
    flexible = swing(mb.FlexibleBody("body", replace(turned, **none), POSES[pose]()))
    assert flexible.x == pytest.approx(rigid.x, abs=1e-12)


@pytest.mark.parametrize("pose", POSES)
def test_a_node_carries_a_frame_that_moves_as_it_says(pose: str) -> None:
    planar = pose == "planar"
    modes, *_ = particle_modes(3, planar)
    turning = np.random.default_rng(2).normal(size=modes.rotations.shape) * ([[0.0], [0.0], [1.0]] if planar else 1.0)
    body = mb.FlexibleBody("body", replace(modes, rotations=turning), POSES[pose]())
    frame = body.node(3).body.frame
    q, v = random_state(mb.compile_dae(mb.System(body)))
    velocity = ca.jtimes(frame.r, frame.q, frame.rate)
    spin = ca.inv_skew(frame.R.T @ ca.reshape(ca.jtimes(ca.vec(frame.R), frame.q, frame.rate), 3, 3))
    twist = ca.Function("twist", [frame.q, frame.v], [ca.vertcat(velocity, spin), frame.S @ frame.v])
    by_rates, told = (np.asarray(part).ravel() for part in twist(q, v))
    assert told == pytest.approx(by_rates, abs=1e-12)
    rigid = np.asarray(ca.Function("rigid", [frame.q], [frame.S @ frame.rigid])(q))
    kept = [0, 1, 5] if planar else range(6)
    assert rigid[np.ix_(kept, kept)] == pytest.approx(np.eye(len(kept)), abs=1e-12)
    R = np.asarray(ca.Function("R", [frame.q], [frame.R])(q))
    assert R @ R.T == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize("pose", POSES)
def test_energy_and_momentum_are_kept(pose: str) -> None:
    planar = pose == "planar"
    modes, masses, *_ = particle_modes(3, planar)
    body = mb.FlexibleBody("body", undamped(modes), POSES[pose]())
    start = {"body.vx": 1.0, "body.omega": 2.0 if planar else (1.0, 2.0, -1.0), "body.eta1": 0.2, "body.eta3_dot": 0.5}
    nodes = [body.node(k) for k in range(len(masses))]
    moments = [ca.dot(masses, ca.vertcat(*[n.velocity[i] for n in nodes])) for i in range(3)]
    spins = [sum(m * ca.cross(n.r, n.velocity)[i] for m, n in zip(masses, nodes, strict=True)) for i in range(3)]
    outputs = {f"{what}{i}": value for what, values in (("p", moments), ("L", spins)) for i, value in enumerate(values)}
    scene = mb.Scene(mb.System(body), start=start, times=np.linspace(0, 5, 21), outputs=outputs)
    found = mb.simulate(scene, mb.DormandPrince(rtol=1e-12))
    assert found.energy_drift < 1e-10
    values = np.column_stack([found[name] for name in outputs])
    assert values == pytest.approx(np.tile(values[0], (21, 1)), abs=1e-9)
    assert np.abs(values[0]).max() > 1


def test_work_of_damping_is_counted() -> None:
    modes, *_ = particle_modes(2)
    body = mb.FlexibleBody("body", modes)
    scene = mb.Scene(mb.System(body), start={"body.eta1": 0.3}, times=np.linspace(0, 5, 21))
    found = mb.simulate(scene, mb.DormandPrince(rtol=1e-12))
    assert found.energy_drift < 1e-10
    kinetic, potential, _ = found.energy
    assert (kinetic + potential)[-1] < 0.9 * potential[0]


def test_a_force_at_a_node_does_the_work_of_its_displacement() -> None:
    modes, *_ = particle_modes(3)
    body = mb.FlexibleBody("body", undamped(modes))
    system = mb.System(body, mb.Force("push", body.node(5), (1.0, -2.0, 0.5)))
    scene = mb.Scene(system, times=np.linspace(0, 2, 11), outputs={k: getattr(body.node(5), k) for k in "xyz"})
    found = mb.simulate(scene, mb.DormandPrince(rtol=1e-12))
    moved = np.column_stack([found[k] - found[k][0] for k in "xyz"]) @ [1.0, -2.0, 0.5]
    kinetic, potential, work = found.energy
    assert work == pytest.approx(moved, abs=1e-9)
    assert kinetic + potential == pytest.approx(moved, abs=1e-9)


def test_reaction_of_a_hinge_at_a_node_balances_gravity_and_momentum() -> None:
    modes, masses, *_ = particle_modes(2)
    body, ground = mb.FlexibleBody("body", modes), mb.Ground()
    system = mb.System(body, mb.Spherical("ball", ground.point(0, 0, 0), body.node(4)), mb.Gravity(0, 0, -9.81))
    reaction = system.reaction("ball")
    outputs = {f"f{k}": getattr(reaction, f"f{k}") for k in "xyz"}
    outputs |= {
        f"p{k}": ca.dot(masses, ca.vertcat(*[body.node(n).velocity["xyz".index(k)] for n in range(12)])) for k in "xyz"
    }
    times = np.linspace(0, 0.2, 2001)
    scene = mb.Scene(system, start={"body.rotation": mb.rotation((1, 0, 0), 0.3)}, times=times, outputs=outputs)
    found = mb.simulate(scene, mb.DormandPrince(rtol=1e-12))
    for k, weight in zip("xyz", (0.0, 0.0, -9.81 * masses.sum()), strict=True):
        rate = np.gradient(found[f"p{k}"], times, edge_order=2)[5:-5]
        assert found[f"f{k}"][5:-5] + weight == pytest.approx(rate, abs=2e-3 * np.abs(rate).max())


def test_a_tumbling_bar_moves_as_in_exudyn() -> None:
    """The same elements and modes in another program's floating frame (tests/benchmarks/flexible.py), over 4 m."""
    known = read("tumbling_bar")
    positions, K, M = bar()
    body = mb.FlexibleBody("bar", mb.FiniteElements.matrices(positions, K, M).modes(count=known["modes"]))
    corner = body.node(len(positions) - 1)
    system = mb.System(body, mb.Gravity(*known["gravity"]), mb.Force("pull", body.node(0), known["pull"]))
    outputs = {k: getattr(corner, k) for k in "xyz"}
    scene = mb.Scene(system, {"bar.omega": known["omega"]}, known["times"], outputs)
    assert mb.simulate(scene).values == pytest.approx(np.array(known["corner"]), abs=5e-6)


@pytest.mark.parametrize(
    ("build", "told"),
    [
        (lambda m: mb.FlexibleBody("b", 3.0), "expected Modes, got float"),
        (lambda m: mb.FlexibleBody("b", m, mb.Particle()), "has no rotation"),
        (lambda m: mb.System(mb.FlexibleBody("b", m, mb.Planar())), "modes have displacements out of the xy plane"),
        (lambda m: mb.FlexibleBody("b", m).node(12), "nodes are 0 to 11"),
        (lambda m: mb.FlexibleBody("b", m).point(5, 0), "points need nodes with rotations"),
        (lambda m: mb.FlexibleBody("b", m).point(mb.Parameters(a=1.0).a, 0), "must be numbers"),
        (lambda m: mb.System(mb.Force("f", mb.FlexibleBody("b", m).node(0), (1, 0))), "'b' is not part of the System"),
    ],
)
def test_faults_are_told(build, told: str) -> None:
    with pytest.raises(mb.DeclarationError, match=told):
        build(particle_modes(2)[0])
