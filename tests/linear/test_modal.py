"""Modes: frequencies over boxes, shapes and phases against closed forms, and files of `view`."""

import numpy as np
import pytest
from faults import refused, warned
from machines import ball, pendulum, rods
from problems import read
from scipy.linalg import eigh
from scipy.optimize import fsolve
from small_scenes import particle, pushing_oscillator, two_masses

import symmb as mb
from models import double_wishbone, four_bar
from symmb.show.cli.main import main


def coupled(coupling: float) -> mb.Scene:
    """Two oscillators of 1 kg whose stiffnesses cross inside the box, with a spring between them [N/m]."""

    def law(p, a, b):
        pull = coupling * (a.x - b.x)
        return (-p.k1 * a.x - pull, 0, 0), (-p.k2 * b.x + pull, 0, 0)

    return two_masses(law, box=mb.Box(k1=(90.0, 110.0), k2=(93.6, 114.4)), k1=100.0, k2=104.0)


def frequencies(P: np.ndarray, coupling: float) -> np.ndarray:
    """Both [Hz], the lower one first, (N, 2)."""
    mean, half = P.mean(axis=1) + coupling, np.hypot((P[:, 0] - P[:, 1]) / 2, coupling)
    return np.sqrt(np.stack([mean - half, mean + half], axis=1)) / (2 * np.pi)


def agree(bounds, lowest, highest, share) -> None:
    """The bounds of both frequencies are these, to a share of their distance."""
    for found, known in ((bounds.lower, lowest), (bounds.upper, highest)):
        assert (np.abs(found[0, :2] - known) < share * (highest - lowest)).all()


def test_modes_that_cross_keep_their_numbers_and_this_is_told():
    scene = coupled(0.0)
    modal = mb.ModalSimulator(scene, count=2)
    P = np.array([[100.0, 104.0], [109.0, 95.0], [95.0, 110.0]])
    np.testing.assert_allclose(modal.run(P).Y[:, 0, :2], np.sqrt(P) / (2 * np.pi), rtol=1e-12)
    (told,) = modal.crossings(scene.box)
    assert told.startswith("f1 and f2 cross between k1 = 100, k2 = 104 and k1 = ")
    bounds = mb.propagate(modal, mb.PolynomialChaos(), box=scene.box)
    agree(bounds, *np.sqrt([[90, 93.6], [110, 114.4]]) / (2 * np.pi), 1e-3)


@pytest.mark.parametrize("coupling", [0.3, 1.0, 5.0])
def test_modes_that_veer_do_not_cross(coupling):
    scene = coupled(coupling)
    modal = mb.ModalSimulator(scene, count=2)
    P = np.random.default_rng(5).uniform(scene.box.lower, scene.box.upper, (60, 2))
    np.testing.assert_allclose(modal.run(P).Y[:, 0, :2], frequencies(P, coupling), rtol=1e-12)
    assert not modal.crossings(scene.box)


@pytest.mark.parametrize("coupling", [pytest.param(0.3, marks=pytest.mark.long), 1.0, 5.0])
def test_bounds_of_modes_that_veer(coupling):
    scene = coupled(coupling)
    bounds = mb.propagate(mb.ModalSimulator(scene, count=2), mb.PolynomialChaos(tolerance=1e-3), box=scene.box)
    grid = np.stack(np.meshgrid(*[np.linspace(*ends, 401) for ends in scene.box.bounds]), axis=-1).reshape(-1, 2)
    exact = frequencies(grid, coupling)
    agree(bounds, exact.min(axis=0), exact.max(axis=0), 2e-3)


def oscillator(**box) -> mb.Scene:
    return particle(lambda p, mass: (-p.k * mass.x - p.c * mass.vx, 0, 0), [0.0], {}, **box)


def test_damping_and_a_mode_that_ends():
    modal = mb.ModalSimulator(oscillator(c=(0.1, 0.3), k=(3.0, 5.0)))
    assert modal.outputs == ("f1", "zeta1")
    assert modal.units == ("Hz", "1")
    samples = modal.run(np.array([[0.2, 4.0], [1.0, 9.0], [5.0, 4.0]]))
    np.testing.assert_allclose(samples.Y[:2, 0], [[2 / (2 * np.pi), 0.05], [3 / (2 * np.pi), 1 / 6]], rtol=1e-12)
    assert samples.ok.tolist() == [True, True, False]
    assert "mode 1 does not oscillate at these parameters" in samples.messages[0]


def test_a_swing_is_doubtful():
    swing = pendulum().scene(start={"rod.theta": -0.7})
    warned("neither an equilibrium nor a steady motion", mb.ModalSimulator, swing)


def test_faults():
    refused("has no oscillation", mb.ModalSimulator, ball().scene())
    refused("count must be an integer of at least 1", mb.ModalSimulator, coupled(0.0), 0)
    refused("Expected a Scene, got System", mb.ModalSimulator, coupled(0.0).system)


def test_the_box_of_the_scene_is_taken():
    scene = oscillator(k=(81.0, 121.0), c=(-1.0, 1.0))
    bounds = mb.propagate(mb.ModalSimulator(scene), mb.Vertex())
    assert 2 * np.pi * np.ravel(bounds["f1"]) == pytest.approx([9.0, 11.0])
    assert mb.critical(scene, "c", (-1.0, 1.5)).box == mb.Box(k=(81.0, 121.0))


def test_phases_of_a_complex_mode():
    run = mb.linearize(pushing_oscillator(name="masses")).motion(0)
    eigenvalue = -0.2 + 1j * np.sqrt(3.96)
    ratio = 2 * eigenvalue / (eigenvalue**2 + 9)
    size, rate = np.abs(run["a.x"]).max(), eigenvalue.imag
    assert run.t[-1] == pytest.approx(3 * 2 * np.pi / rate)
    begin = np.arctan2(-run["a.vx"][0] / rate, run["a.x"][0])  # close to the phase of a at the start
    fitted = np.exp(1j * rate * run.t)
    a, b = (np.linalg.lstsq(np.stack([fitted.real, -fitted.imag], 1), run[name], rcond=None) for name in ("a.x", "b.y"))
    complex_a, complex_b = (found[0] @ [1, 1j] for found in (a, b))
    assert max(*a[1], *b[1]) < 1e-25  # both are pure oscillations
    assert complex_b / complex_a == pytest.approx(ratio, rel=1e-9)
    assert abs(complex_a) == pytest.approx(size, rel=1e-2) and abs(np.angle(complex_a) - begin) < 0.2
    assert "It is not a run of the scene" in run.doubts[0]


@pytest.mark.parametrize("coordinates", ["joint", "body"])
def test_shapes_of_a_double_pendulum(coordinates):
    lin = mb.linearize(rods(2).scene(coordinates=coordinates))
    M, K = np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]]), 9.81 * np.diag([1.5, 0.5])
    for number in (0, 1):
        run = lin.motion(number)
        squared = (2 * np.pi * lin.frequencies[number]) ** 2
        one, two = run["rod0.theta"], run["rod1.theta"]
        residual = (K - squared * M) @ np.stack([one, two]) / squared
        assert np.abs(residual).max() < (1e-10 if coordinates == "joint" else 2e-2)  # body: joints are closed by Newton
        assert 0.1 < np.abs(np.stack([one, two])).max() <= 0.3
        assert run.position_drift < 1e-9


def test_joints_of_loops_stay_closed():
    lin = warned("neither an equilibrium nor a steady motion", mb.linearize, four_bar.scene())
    run = lin.motion(0)
    assert lin.doubts and run.position_drift < 1e-9 and np.ptp(run["crank.theta"]) > 0.1


def test_files(tmp_path, capsys):
    lin = mb.linearize(pushing_oscillator(name="masses"))
    for name in ("mode.html", "mode.png"):
        mb.view(lin.motion(1), tmp_path / name)
        assert (tmp_path / name).stat().st_size > 10_000
    page = tmp_path / "pendulum.html"
    scene = tmp_path / "pendulum.py"
    scene.write_text(
        "import symmb as mb\n\ndef scene():\n    rod = mb.Body('rod', 1.0, 0.1)\n"
        "    pin = mb.Revolute('pin', mb.Ground().point(0, 0), rod.point(0, 1))\n"
        "    return mb.Scene(mb.System(rod, pin, mb.Gravity(0, -9.81)), {'rod.theta': 0.0}, name='clock')\n"
    )
    assert main(["view", str(scene), "--mode", "1", "-o", str(page)]) == 0
    assert "<title>clock, mode 1, 0.4753 Hz</title>" in page.read_text()  # sqrt(9.81 / 1.1) / 2 pi
    assert main(["view", str(scene), "--mode", "2", "-o", str(page)]) == 2
    assert "clock has no mode 2. Number of modes: 1. The first mode has the number 1." in capsys.readouterr().err


def test_refusals(tmp_path):
    lin = mb.linearize(pushing_oscillator(name="masses"))
    for number in (-1, 2, 0.0, True):
        refused(r"masses has no mode .*\. Numbers of modes: 0 to 1", lin.motion, number)
    lin.save(tmp_path / "lin.npz")
    refused("was read from a file", mb.Linearization.load(tmp_path / "lin.npz").motion, 0)


# Euler-Bernoulli beams as flexible bodies in joints: the first four frequencies against characteristic equations.

BETA = read("beam_modes")
FREE, PINNED = BETA["free_free_and_clamped_clamped"], BETA["clamped_pinned_and_pinned_free"]
ROOTS = {
    "clamped-free": BETA["clamped_free"], "free-free": FREE, "clamped-clamped": FREE, "clamped-pinned": PINNED,
    "pinned-free": PINNED, "pinned-pinned": np.pi * np.arange(1, 5),
    "clamped-mass": BETA["clamped_free_tip_mass_ratio_1"],
}  # fmt: skip
JOINTS = {"clamped": mb.Weld, "pinned": mb.Revolute}
STEEL, LENGTH, ELEMENTS = mb.Material(E=2.1e11, nu=0.3, density=7850.0), 1.0, 40


@pytest.mark.parametrize("ends", ROOTS)
def test_four_frequencies(ends):
    section = mb.Section.circle(2e-4).without_shear()
    mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (LENGTH, 0, 0)], section, STEEL, elements=ELEMENTS))
    beam = mb.FlexibleBody("beam", mesh.modes([0, ELEMENTS], count=20, planar=True), mb.Planar())
    elements, guess, ground = [beam], {"beam.x": LENGTH / 2}, mb.Ground()
    for x, end in zip((0.0, LENGTH), ends.split("-"), strict=True):
        if end in JOINTS:
            elements.append(JOINTS[end](f"at_{x:g}", ground.point(x, 0), beam.point(x, 0)))
        elif end == "mass":
            tip = mb.Body("tip", mass=STEEL.density * section.area * LENGTH, inertia=1e-12)
            elements += [tip, mb.Weld("end", beam.point(x, 0), tip.point(0, 0))]
            guess |= {"tip.x": x}
    lin = mb.linearize(mb.Scene(mb.System(*elements), guess=guess, times=[0.0, 1.0]))
    rate = np.sqrt(STEEL.E * section.Iz / (STEEL.density * section.area * LENGTH**4))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies[:4], np.square(ROOTS[ends][:4]) * rate, rtol=1e-4)


# Ride and wheel hop of a double wishbone suspension against its energies along kinematics by intersecting circles.

G, CENTER = 9.81, np.array([0.75, 0.31])
STEP = 1e-3
WEIGHTS = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}  # fourth-order differences


def positions(z, p):
    """Chassis, both arms and wheel, rows (x, y, angle), for the chassis' height and the turning of the lower arm."""
    height, turning = z
    points = {k: np.array([p[f"{k}_x"], p[f"{k}_y"]]) for k in ("lower", "upper", "knuckle", "top", "mount")}
    arm, other, rigid = (points[b] - points[a] for a, b in (("lower", "knuckle"), ("upper", "top"), ("knuckle", "top")))
    angle = np.arctan2(arm[1], arm[0]) + turning
    along = np.array([np.cos(angle), np.sin(angle)])
    up = np.array([0.0, height])
    inner, hinge, mount = (points[k] + up for k in ("lower", "upper", "mount"))
    end = inner + np.linalg.norm(arm) * along
    # the upper ball lies on circles about the upper hinge and the lower ball, outside of the line between them
    r, s, line = np.linalg.norm(other), np.linalg.norm(rigid), end - hinge
    d = np.linalg.norm(line)
    a = (r**2 - s**2 + d**2) / (2 * d)
    normal = np.array([-line[1], line[0]]) / d
    ball = hinge + a * line / d + np.sqrt(r**2 - a**2) * normal
    before, now = (np.arctan2(v[1], v[0]) for v in (rigid, ball - end))
    tilt = now - before
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    wheel = end + turn @ (CENTER - points["knuckle"])
    upper_angle = np.arctan2(*(ball - hinge)[::-1])
    rows = [(*up, 0.0), (*(inner + end) / 2, angle), (*(hinge + ball) / 2, upper_angle), (*wheel, tilt)]
    return np.array(rows), np.linalg.norm(inner + p["seat"] * along - mount)


def potential(z, p):
    rows, strut = positions(z, p)
    masses = np.array([p["sprung"], 6.0, 3.0, p["unsprung"]])
    springs = p["stiffness"] * (strut - p["length"]) ** 2 + p["tyre"] * (p["radius"] - rows[3, 1]) ** 2
    return G * masses @ rows[:, 1] + springs / 2


def slopes(f, z):
    """(2, ...) derivatives by differences."""
    return np.array([sum(w * f(z + k * STEP * e) for k, w in WEIGHTS.items()) / STEP for e in np.eye(2)])


@pytest.mark.parametrize("changes", [{}, {"lower_y": 0.215, "seat": 0.29, "tyre": 190e3, "upper_y": 0.46}])
def test_ride_and_wheel_hop(changes):
    scene = double_wishbone.scene()
    lin = mb.linearize(scene, parameters={"damping": 0.0, **changes})
    assert not lin.doubts
    p = {**scene.system.parameters, **changes}
    z = fsolve(lambda z: slopes(lambda y: potential(y, p), z), [0.0, 0.0], xtol=1e-12)
    J = slopes(lambda y: positions(y, p)[0], z)
    inertias = np.array([[m, m, J] for m, J in ((p["sprung"], 0), (6.0, 0.08), (3.0, 0.02), (p["unsprung"], 0.9))])
    M = np.einsum("iab,jab,ab->ij", J, J, inertias)
    K = slopes(lambda y: slopes(lambda x: potential(x, p), y), z)
    expected = np.sqrt(eigh((K + K.T) / 2, M, eigvals_only=True))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies, expected, rtol=1e-6)
    assert 0.8 < lin.frequencies[0] < 2.0 < 8.0 < lin.frequencies[1] < 16.0  # ride, wheel hop


def test_bounds_of_the_frequencies():
    """The nominal frequencies lie inside, and the tyre matters for wheel hop alone."""
    scene = double_wishbone.scene()
    bounds = mb.propagate(mb.ModalSimulator(scene), mb.Vertex(), mb.Box(tyre=(200e3, 220e3)))
    lin = mb.linearize(scene)
    assert lin.stability == "asymptotically stable"
    shares = (bounds.upper - bounds.lower)[0, :2] / lin.frequencies
    assert shares[0] < 0.03 < 0.04 < shares[1]
