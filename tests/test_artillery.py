"""The gun of models/artillery.py: its targets, its equilibrium, its energy, and all its finite elements beside it.

These are one linear structure in NumPy and SciPy alone, of small displacements from the gun as drawn. Base plate,
bottom carriage and trails are one rigid body of 6 degrees of freedom, joints are rows C u = 0, and the four contacts
that carry before the shot are scalar laws k d^1.5.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import eig, eigh, null_space

import symmb as mb
from models import artillery as gun

BASE = ("bottom_carriage", "base_plate", "left_trail", "right_trail")


def cross(arm):
    """(3, 3) matrix of arm x ..."""
    x, y, z = arm
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def transport(arm):
    """(6, 6) motion of a place by that of the origin of the arm."""
    T = np.eye(6)
    T[:3, 3:] = -cross(arm)
    return T


@dataclass
class Contact:
    """Force along a relative displacement b u from a gap on, to either side; before the shot it is one of them."""

    b: np.ndarray
    stiffness: float
    gap: float

    def force(self, u):
        d = self.b @ u
        return -np.sign(d) * self.stiffness * max(abs(d) - self.gap, 0.0) ** 1.5

    def tangent(self, u):
        return 1.5 * self.stiffness * max(abs(self.b @ u) - self.gap, 0.0) ** 0.5


class Gun:
    """Matrices K, M (n, n) and rows C of the whole gun, loads f (n,) and contacts."""

    def __init__(self, scene):
        c, s = np.cos(gun.ELEVATION), np.sin(gun.ELEVATION)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        self.bore, self.normal = R[:, 0], R[:, 1]
        parts = [
            ("top_carriage", gun.top_carriage_elements(), np.eye(3), np.zeros(3)),
            ("cradle", gun.cradle_elements(), R, gun.TRUNNION),
            ("barrel", gun.barrel_elements(), R, gun.TRUNNION),
        ]
        n = 6 + sum(part.K.shape[0] for _, part, _, _ in parts)
        self.K, self.M = np.zeros((n, n)), np.zeros((n, n))
        self.first, self.places, self.origin = {}, {}, np.array([0.0, 0.55, 0.0])
        bodies = {body.name: body for body in scene.system.bodies}
        for name in BASE:
            self.M[:6, :6] += self._rigid(bodies[name], np.eye(3), np.array(bodies[name].com) - self.origin)
        at = 6
        for name, part, turn, origin in parts:
            rows = slice(at, at + part.K.shape[0])
            T = np.kron(np.eye(2 * len(part.positions)), turn)
            self.K[rows, rows], self.M[rows, rows] = T @ part.K.toarray() @ T.T, T @ part.M.toarray() @ T.T
            self.first[name], self.places[name] = at, part.positions @ turn.T + origin
            at = rows.stop
        breech = self._node("barrel", gun.tilted(gun.BREECH, 0))
        arm = gun.tilted(gun.BREECH + 0.2, gun.HEIGHTS["mass"]) - gun.tilted(gun.BREECH, 0)
        self.M[breech, breech] += self._rigid(bodies["mass"], R, arm)
        self._joints()
        self.f = -gun.GRAVITY * self.M @ np.tile([0, 1.0, 0, 0, 0, 0], n // 6)
        self._springs()

    def _rigid(self, body, turn, arm):
        inertia = turn @ np.diag(body.inertia) @ turn.T
        T = transport(arm)
        whole = np.zeros((6, 6))
        whole[:3, :3], whole[3:, 3:] = body.mass * np.eye(3), inertia
        return T.T @ whole @ T

    def _node(self, name, place):
        k = int(np.argmin(np.linalg.norm(self.places[name] - place, axis=1)))
        return slice(self.first[name] + 6 * k, self.first[name] + 6 * k + 6)

    def at(self, name, place):
        """(6, n) displacement and rotation at a world place of a part, by rigid arm from its nearest node."""
        rows = np.zeros((6, len(self.K)))
        if name == "base":
            rows[:, :6] = transport(place - self.origin)
        else:
            node = self._node(name, place)
            k = (node.start - self.first[name]) // 6
            rows[:, node] = transport(place - self.places[name][k])
        return rows

    def _joints(self):
        hinge = np.array([0.0, 0.75, 0.0])
        turned = self.at("top_carriage", hinge) - self.at("base", hinge)
        held = self.at("cradle", gun.TRUNNION) - self.at("top_carriage", gun.TRUNNION)
        self.C = np.vstack([turned[[0, 1, 2, 3, 5]], held[:5]])
        self._add(gun.TRAVERSE, turned[4])

    def _add(self, stiffness, row):
        self.K += stiffness * np.outer(row, row)

    def _springs(self):
        spades = ((np.array(spade), gun.SPADE, 0.0) for spade in gun.SPADES)
        for place, law, turning in ((np.zeros(3), gun.FOOT, gun.PLATE), *spades):
            rows = self.at("base", place)
            for row, stiffness in zip(rows, (gun.GROUND[0], law.stiffness, gun.GROUND[2], *3 * [turning]), strict=True):
                self._add(stiffness, row)

        def apart(a, b, place_a, place_b):
            return self.at(b, place_b)[:3] - self.at(a, place_a)[:3]

        tooth = apart("top_carriage", "cradle", gun.PINION, gun.PINION)
        self.contacts = [Contact(self.bore @ tooth, gun.TOOTH.stiffness, gun.BACKLASH / 2)]
        self.lateral = []
        for x in (gun.REAR, gun.FRONT):
            place = gun.tilted(x, 0)
            bush = apart("cradle", "barrel", place, place)
            self.contacts.append(Contact(self.normal @ bush, gun.BUSH.stiffness, gun.CLEARANCE))
            self.lateral.append(bush[2])
        rear = gun.tilted(gun.REAR, 0)
        self.contacts.append(Contact(self.bore @ apart("cradle", "barrel", rear, rear), gun.STOP.stiffness, 0.0))
        rolled = self.at("barrel", rear)[3:] - self.at("cradle", rear)[3:]
        self._add(gun.KEY, self.bore @ rolled)
        height = gun.HEIGHTS["rods"]
        ends = gun.tilted(gun.CYLINDER, height), gun.tilted(gun.BREECH, height)
        self._gas(gun.RECUPERATOR, apart("cradle", "barrel", *ends), ends)
        ends = np.array([*gun.PISTON, 0.0]), gun.tilted(*gun.LUG)
        self._gas(gun.EQUILIBRATOR, apart("top_carriage", "cradle", *ends), ends)

    def _gas(self, law, rows, ends):
        line = ends[1] - ends[0]
        length = np.linalg.norm(line)
        row = line / length @ rows
        pull = [float(law(x, 0.0)) for x in (length - 1e-6, length, length + 1e-6)]
        self._add((pull[2] - pull[0]) / 2e-6, row)
        self.f -= pull[1] * row

    def equilibrium(self):
        """(n,) displacements under gravity and gas, by Newton's method from springs of the contacts' size."""
        Z = null_space(self.C)
        k = 2e8  # softer than the contacts are: Newton's method comes from where they are pressed too far
        soft = self.K + sum(k * np.outer(c.b, c.b) for c in self.contacts) + self._sideways(k * np.ones(2))
        u = Z @ np.linalg.solve(Z.T @ soft @ Z, Z.T @ self.f)
        pressed = self.f + sum(k * c.gap * np.sign(c.b @ u) * c.b for c in self.contacts)
        u = Z @ np.linalg.solve(Z.T @ soft @ Z, Z.T @ pressed)
        for _ in range(100):
            J = self.K + self._sideways(self._hold(u)) + sum(c.tangent(u) * np.outer(c.b, c.b) for c in self.contacts)
            left = self.f - self.K @ u + sum(c.force(u) * c.b for c in self.contacts)
            step = Z @ np.linalg.solve(Z.T @ J @ Z, Z.T @ left)
            u = u + step
            if np.abs(step).max() < 1e-9 * np.abs(u).max():
                return u
        raise AssertionError("the linear structure has found no equilibrium")

    def _hold(self, u):
        """A pin at the bottom of a round bush is held sideways by its load, as a pendulum is."""
        return np.array([abs(c.force(u)) / abs(c.b @ u) if abs(c.b @ u) > c.gap else 1e6 for c in self.contacts[1:3]])

    def _sideways(self, stiffness):
        return sum(k * np.outer(row, row) for k, row in zip(stiffness, self.lateral, strict=True))

    def frequencies(self, u, count):
        """(count,) lowest ones of the gun in equilibrium [Hz]."""
        Z = null_space(self.C)
        K = self.K + self._sideways(self._hold(u)) + sum(c.tangent(u) * np.outer(c.b, c.b) for c in self.contacts)
        squares = eigh(Z.T @ K @ Z, Z.T @ self.M @ Z, eigvals_only=True, subset_by_index=(0, count - 1))
        return np.sqrt(squares) / (2 * np.pi)


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
