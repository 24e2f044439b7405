"""Modes: frequencies over boxes, shapes and phases against closed forms, and files of `view`."""

import numpy as np
import pytest
from faults import refused, warned
from machines import ball, pendulum, rods
from small_scenes import particle, pushing_oscillator, two_masses

import symmb as mb
from models import four_bar
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
