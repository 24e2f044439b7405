"""Flexible bodies in a floating frame against particles by virtual power, rigid bodies, closed forms, invariants."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from bricks import bar
from faults import refused
from joints import random_state
from machines import ORIGIN, run_of
from problems import read

import symmb as mb
from models import spin_up_beam

POSES = {"planar": mb.Planar, "spatial": mb.Spatial}
FINE = mb.DormandPrince(rtol=1e-12)
poses = pytest.mark.parametrize("pose", POSES)


def particle_modes(n: int, planar: bool = False, seed: int = 0) -> tuple[mb.Modes, np.ndarray, np.ndarray, np.ndarray]:
    """Modes of 12 particles with random shapes of unit modal mass; masses (g,), places (g, 3) and shapes (g, 3, n)."""
    rng = np.random.default_rng(seed)
    masses, places = rng.uniform(0.5, 1.5, 12), rng.normal(size=(12, 3))
    shapes = rng.normal(size=(12, 3, n))
    if planar:
        places[:, 2] = shapes[:, 2] = 0.0
    gram = np.einsum("g,gkj,gki->ji", masses, shapes, shapes)
    shapes = shapes @ np.linalg.inv(np.linalg.cholesky(gram)).T
    eye = np.eye(3)

    def inertia(X: np.ndarray) -> np.ndarray:
        return np.trace(X, axis1=-2, axis2=-1)[..., None, None] * eye - X

    K = np.einsum("g,gk,glj->jkl", masses, places, shapes)
    KK = np.einsum("g,gki,glj->ijkl", masses, shapes, shapes)
    levi = np.array([[[(i - j) * (j - k) * (k - i) / 2 for k in range(3)] for j in range(3)] for i in range(3)])
    modes = mb.Modes(
        mass=masses.sum(),
        center=masses @ places / masses.sum(),
        J0=inertia(np.einsum("g,gk,gl->kl", masses, places, places)),
        J1=inertia(K + K.swapaxes(1, 2)),
        J2=inertia((KK + KK.swapaxes(2, 3)) / 2),
        S=np.einsum("g,gkj->kj", masses, shapes),
        G0=np.einsum("akl,g,gk,glj->aj", levi, masses, places, shapes),
        G1=np.einsum("akl,g,gki,glj->iaj", levi, masses, shapes, shapes),
        stiffness=rng.uniform(50, 100, n),
        damping=rng.uniform(0, 0.5, n),
        origin=np.zeros(3),
        positions=places,
        shapes=shapes,
        rotations=np.zeros((12, 3, n)),
        S2=np.zeros((3, n, n)),
        shapes2=np.zeros((12, 3, n, n)),
    )
    return modes, masses, places, shapes


def accelerations(body: mb.FlexibleBody, masses: np.ndarray, gravity: np.ndarray) -> ca.Function:
    """(q, v) -> v' of a free body by the virtual power of its particles, all rates by CasADi from their positions."""
    m, q, v, rate = body.modes, body.frame.q, body.frame.v, body.frame.rate
    vdot = ca.SX.sym("vdot", v.numel())
    virtual = ca.SX(v.numel(), 1)
    for k, mass in enumerate(masses):
        r = body.node(k).r
        velocity = ca.jtimes(r, q, rate)
        acceleration = ca.jtimes(velocity, q, rate) + ca.jtimes(velocity, v, vdot)
        virtual += ca.jacobian(velocity, v).T @ (mass * (acceleration - gravity))
    n = len(m.stiffness)
    eta = q[-n:]
    elastic = ca.SX(m.stiffness) * eta + ca.SX(m.damping) * v[-n:]
    virtual += ca.vertcat(ca.SX(v.numel() - n, 1), elastic)
    A, b = ca.jacobian(virtual, vdot), ca.substitute(virtual, vdot, ca.SX.zeros(v.numel()))
    return ca.Function("accelerations", [q, v], [A, b])


def undamped(modes: mb.Modes) -> mb.Modes:
    return replace(modes, damping=np.zeros_like(modes.damping))


@pytest.mark.parametrize("n", [1, 4])
@poses
def test_mass_matrix_and_accelerations_are_those_of_the_particles(pose: str, n: int) -> None:
    planar = pose == "planar"
    modes, masses, *_ = particle_modes(n, planar)
    body = mb.FlexibleBody("body", modes, POSES[pose]())
    gravity = np.array([1.0, -9.81, 0.0 if planar else 2.0])
    dae = mb.compile_dae(mb.System(body, mb.Gravity(*gravity)))
    q, v = random_state(dae, np.random.default_rng(1))
    A, b = (np.asarray(part) for part in accelerations(body, masses, gravity)(q, v))
    assert np.asarray(dae.M(q, v, [], 0.0)) == pytest.approx(A, abs=1e-12)
    assert np.asarray(dae.rhs(q, v, [], 0.0)[1]).ravel() == pytest.approx(-np.linalg.solve(A, b).ravel(), abs=1e-11)


@poses
def test_without_modes_it_is_the_rigid_body(pose: str) -> None:
    planar = pose == "planar"
    whole, *_ = particle_modes(1, planar)
    c, m = whole.center, whole.mass
    about_c = whole.J0 - m * (c @ c * np.eye(3) - np.outer(c, c))
    turned = replace(whole, J0=about_c, center=np.zeros(3))
    empty = {
        "J1": (0, 3, 3), "J2": (0, 0, 3, 3), "S": (3, 0), "G0": (3, 0), "G1": (0, 3, 0), "stiffness": 0, "damping": 0,
        "shapes": (12, 3, 0), "rotations": (12, 3, 0), "S2": (3, 0, 0), "shapes2": (12, 3, 0, 0),
    }  # fmt: skip
    none = {name: np.zeros(shape) for name, shape in empty.items()}

    def swing(body: mb.Body) -> mb.Trajectory:
        hinge = (mb.Revolute if planar else mb.Spherical)("hinge", ORIGIN, body.point(*whole.positions[0]))
        push = mb.Force("push", body.point(*whole.positions[1]), (3.0, ca.sin(5 * mb.t)))
        scene = {"start": {"body.omega": 1.0 if planar else (1.0, 2.0, 3.0)}, "times": np.linspace(0, 1, 11)}
        return run_of(body, hinge, push, mb.Gravity(0.5, -9.81), **scene, coordinates="body", solver=FINE)

    inertia = float(about_c[2, 2]) if planar else (about_c + about_c.T) / 2
    rigid = swing(mb.Body("body", whole.mass, inertia, POSES[pose]()))
    flexible = swing(mb.FlexibleBody("body", replace(turned, **none), POSES[pose]()))
    assert flexible.x == pytest.approx(rigid.x, abs=1e-12)


@poses
def test_a_node_carries_a_frame_that_moves_as_it_says(pose: str) -> None:
    planar = pose == "planar"
    modes, *_ = particle_modes(3, planar)
    turning = np.random.default_rng(2).normal(size=modes.rotations.shape) * ([[0.0], [0.0], [1.0]] if planar else 1.0)
    body = mb.FlexibleBody("body", replace(modes, rotations=turning), POSES[pose]())
    frame = body.node(3).body.frame
    q, v = random_state(mb.compile_dae(mb.System(body)), np.random.default_rng(1))
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


@poses
def test_energy_and_momentum_are_kept(pose: str) -> None:
    planar = pose == "planar"
    modes, masses, *_ = particle_modes(3, planar)
    body = mb.FlexibleBody("body", undamped(modes), POSES[pose]())
    start = {"body.vx": 1.0, "body.omega": 2.0 if planar else (1.0, 2.0, -1.0), "body.eta1": 0.2, "body.eta3_dot": 0.5}
    nodes = [body.node(k) for k in range(len(masses))]
    moments = [ca.dot(masses, ca.vertcat(*[n.velocity[i] for n in nodes])) for i in range(3)]
    spins = [sum(m * ca.cross(n.r, n.velocity)[i] for m, n in zip(masses, nodes, strict=True)) for i in range(3)]
    outputs = {f"{what}{i}": value for what, values in (("p", moments), ("L", spins)) for i, value in enumerate(values)}
    found = run_of(body, start=start, times=np.linspace(0, 5, 21), outputs=outputs, solver=FINE)
    assert found.energy_drift < 1e-10
    assert found.values == pytest.approx(np.tile(found.values[0], (21, 1)), abs=1e-9)
    assert np.abs(found.values[0]).max() > 1


def test_work_of_damping_is_counted() -> None:
    body = mb.FlexibleBody("body", particle_modes(2)[0])
    found = run_of(body, start={"body.eta1": 0.3}, times=np.linspace(0, 5, 21), solver=FINE)
    assert found.energy_drift < 1e-10
    kinetic, potential, _ = found.energy
    assert (kinetic + potential)[-1] < 0.9 * potential[0]


def test_a_force_at_a_node_does_the_work_of_its_displacement() -> None:
    body = mb.FlexibleBody("body", undamped(particle_modes(3)[0]))
    push, outputs = mb.Force("push", body.node(5), (1.0, -2.0, 0.5)), {k: getattr(body.node(5), k) for k in "xyz"}
    found = run_of(body, push, times=np.linspace(0, 2, 11), outputs=outputs, solver=FINE)
    moved = (found.values - found.values[0]) @ [1.0, -2.0, 0.5]
    kinetic, potential, work = found.energy
    assert work == pytest.approx(moved, abs=1e-9)
    assert kinetic + potential == pytest.approx(moved, abs=1e-9)


def test_reaction_of_a_hinge_at_a_node_balances_gravity_and_momentum() -> None:
    modes, masses, *_ = particle_modes(2)
    body, times = mb.FlexibleBody("body", modes), np.linspace(0, 0.2, 2001)
    system = mb.System(body, mb.Spherical("ball", ORIGIN, body.node(4)), mb.Gravity(0, 0, -9.81))
    momentum = sum(m * body.node(n).velocity for n, m in enumerate(masses))
    outputs = {f"f{k}": getattr(system.reaction("ball"), f"f{k}") for k in "xyz"}
    outputs |= {f"p{k}": momentum[i] for i, k in enumerate("xyz")}
    scene = mb.Scene(system, start={"body.rotation": mb.rotation((1, 0, 0), 0.3)}, times=times, outputs=outputs)
    found = mb.simulate(scene, FINE)
    for k, weight in zip("xyz", (0.0, 0.0, -9.81 * masses.sum()), strict=True):
        rate = np.gradient(found[f"p{k}"], times, edge_order=2)[5:-5]
        assert found[f"f{k}"][5:-5] + weight == pytest.approx(rate, abs=2e-3 * np.abs(rate).max())


def test_a_tumbling_bar_moves_as_in_exudyn() -> None:
    """The same elements and modes in another program's floating frame (tests/benchmarks/flexible.py), over 4 m."""
    known = read("tumbling_bar")
    positions, K, M = bar()
    body = mb.FlexibleBody("bar", mb.FiniteElements.matrices(positions, K, M).modes(count=known["modes"]))
    corner = body.node(len(positions) - 1)
    loads = mb.Gravity(*known["gravity"]), mb.Force("pull", body.node(0), known["pull"])
    scene = {"start": {"bar.omega": known["omega"]}, "times": known["times"]}
    run = run_of(body, *loads, **scene, outputs={k: getattr(corner, k) for k in "xyz"})
    assert run.values == pytest.approx(np.array(known["corner"]), abs=5e-6)


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
    refused(told, build, particle_modes(2)[0])


# The spin-up beam against a geometrically exact one, and what its modes can show at best.

KNOWN = read("spin_up_beam")


@pytest.mark.parametrize(("count", "largest"), [(3, 1e-3), (5, 1e-3)])
def test_the_tip_is_within_a_millimetre_of_the_exact_beam(count: int, largest: float) -> None:
    run = mb.simulate(spin_up_beam.scene(count=count), times=KNOWN["times"])
    exact = np.array(KNOWN["exact"])
    for name, column in (("u1", 0), ("u2", 1), ("tip_x", 2), ("tip_y", 3)):
        assert np.abs(run[name] - exact[:, column]).max() < largest
    assert run["u2"].min() == pytest.approx(KNOWN["least_u2"], abs=1e-3)
    assert run["u1"][-1] == pytest.approx(KNOWN["last_u1"], abs=1e-3)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_as_many_modes_show_what_galerkin_s_method_does(count: int) -> None:
    run = mb.simulate(spin_up_beam.scene(count=count), times=KNOWN["times"])
    assert run["u2"] == pytest.approx(np.array(KNOWN["galerkin_u2"][str(count)]), abs=2e-5)


def test_without_foreshortening_it_diverges() -> None:
    """Centrifugal forces overcome the first mode's stiffness at 3.8 rad/s, which the root reaches at 9 s."""
    scene = spin_up_beam.scene(count=3, stiffening=False)
    with pytest.warns(mb.SymmbWarning, match="'beam': it turns at .* at t = 12 s, which is 1.5 times its first"):
        bend = np.abs(mb.simulate(scene, times=[0.0, 4.0, 12.0])["u2"])
    assert bend[1] < 0.4 and bend[2] > 10
