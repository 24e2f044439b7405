"""The gun of models/artillery.py: its targets, its equilibrium, its energy, and all its finite elements beside it."""

import casadi as ca
import numpy as np
import pytest
from artillery_elements import Gun
from scipy.linalg import eig, null_space

import symmb as mb
from models import artillery as gun

SOLVER = mb.DormandPrince(rtol=1e-6)


@pytest.fixture(scope="module")
def scene():
    return gun.scene()


@pytest.fixture(scope="module")
def simulator(scene):
    """To 14 ms, as compiled for examples/artillery.py, too."""
    return mb.DAESimulator(scene, SOLVER)


@pytest.fixture(scope="module")
def shot(scene):
    return mb.simulate(scene, SOLVER)


@pytest.fixture(scope="module")
def structure(scene):
    whole = Gun(scene)
    return whole, whole.equilibrium()


def test_largest_breech_pressure():
    t = np.linspace(0.0, 0.02, 20001)
    pressure = np.array(ca.Function("p", [mb.t], [gun.PRESSURE(mb.t)])(t[None])).ravel()
    assert pressure.max() == pytest.approx(366.56e6, rel=3e-3)
    assert 5e-3 <= t[pressure.argmax()] <= 6e-3


def test_muzzle_at_14_ms(shot):
    assert np.degrees(shot["muzzle_vertical"][-1]) == pytest.approx(0.01382, rel=0.1)


@pytest.mark.long
def test_recoil_length(scene):
    whole = mb.simulate(scene.with_times([*scene.times, *np.linspace(0.02, 0.3, 57)]), SOLVER)
    assert 1.001 < whole["recoil"].max() < 1.072
    assert whole["recoil"].argmax() < len(whole.t) - 1
    assert whole.energy_drift < 1e-4


def test_nothing_moves_before_the_shot(shot):
    dae, x = shot.program.bodies.dae, shot.x[0]
    at = dae.arguments(x, dae.p_nominal, 0.0)
    _, lam = dae.forward(*at, dae.gamma(*at))
    left = dae.Q(*at) - dae.G(*at).T @ lam
    assert np.abs(left.full()).max() <= 1e-8 * np.abs(dae.Q(*at).full()).max()
    assert np.abs([shot[name][0] for name in ("recoil", "D_Y", "Omega_t", "muzzle_vertical")]).max() < 1e-12


def test_energy_of_the_shot_balances(shot):
    assert shot.energy_drift < 1e-4


@pytest.mark.long
def test_angle_does_not_depend_on_the_tolerance(shot, simulator):
    tighter = simulator.solved_by(mb.DormandPrince(rtol=1e-8)).run(np.zeros((1, 2))).Y[0]
    angle = tighter[:, simulator.outputs.index("muzzle_vertical")]
    assert np.abs(shot["muzzle_vertical"] - angle).max() < 1e-3 * np.abs(angle).max()


@pytest.mark.long
def test_eccentricities_turn_the_muzzle_their_way(simulator):
    """A mass that is higher lowers the muzzle, and the gun is symmetric: e_z turns it to either side alike."""
    Y = simulator.run(np.array([[0, 0], [5e-3, 0], [0, 3e-3], [0, -3e-3]])).Y[:, -1]
    vertical, horizontal = (simulator.outputs.index(f"muzzle_{name}") for name in ("vertical", "horizontal"))
    assert Y[1, vertical] < Y[0, vertical]
    assert abs(Y[0, horizontal]) < 1e-9
    assert Y[2, horizontal] == pytest.approx(-Y[3, horizontal], rel=1e-3)
    assert abs(Y[2, horizontal]) > 1e-6


def test_static_deflection_of_all_finite_elements(shot, structure):
    whole, u = structure
    drawn = gun.tilted(gun.MUZZLE, 0)
    sag, turned = (whole.at("barrel", drawn) @ u)[[1, 5]]
    barrel = next(b for b in shot.scene.system.bodies if b.name == "barrel")
    muzzle = barrel.point(gun.MUZZLE, 0)
    assert shot(muzzle.y)[0] - drawn[1] == pytest.approx(sag, rel=0.01)
    assert shot(ca.asin(muzzle.body.rotation[1, 0]))[0] - gun.ELEVATION == pytest.approx(turned, rel=0.012)


def test_frequencies_of_all_finite_elements(shot, structure):
    whole, u = structure
    assert frequencies(shot)[:6] == pytest.approx(whole.frequencies(u, 6), rel=0.01)


def frequencies(run):
    """Of small motions about the start of a run [Hz], rising."""
    dae = run.program.bodies.dae
    at = q, v, s, p, t = dae.arguments(run.x[0], dae.p_nominal, 0.0)
    lam = dae.forward(*at, dae.gamma(*at))[1]
    delta = ca.SX.sym("delta", dae.n_v)
    moved = dae.retract(ca.SX(q), delta)
    left = dae.Q(moved, v, s, p, t) - dae.G(moved, v, s, p, t).T @ lam
    K = -ca.Function("K", [delta], [ca.jacobian(left, delta)])(0).full()
    Z = null_space(dae.G(*at).full())
    return np.sqrt(np.sort(np.real(eig(Z.T @ K @ Z, Z.T @ dae.M(*at).full() @ Z)[0]))) / (2 * np.pi)
