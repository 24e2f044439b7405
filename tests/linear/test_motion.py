"""Modes as motions: shapes and phases against closed forms, joints that stay closed, and files of `view`."""

import numpy as np
import pytest
from faults import refused, warned
from small_scenes import pushing_oscillator

import symmb as mb
from models import four_bar
from symmb.show.cli.main import main


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


def rods() -> mb.Scene:
    """Two homogeneous rods of 1 m that hang."""
    one, two = (mb.Body(name, 1.0, 1 / 12) for name in ("one", "two"))
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), one.point(0, 0.5))
    pins = [pin, mb.Revolute("knee", one.point(0, -0.5), two.point(0, 0.5))]
    return mb.Scene(mb.System(one, two, *pins, mb.Gravity(0, -9.81)), {"one.theta": 0.0, "two.theta": 0.0})


@pytest.mark.parametrize("coordinates", ["joint", "body"])
def test_shapes_of_a_double_pendulum(coordinates):
    scene = rods()
    lin = mb.linearize(mb.Scene(scene.system, scene.start, coordinates=coordinates))
    M, K = np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]]), 9.81 * np.diag([1.5, 0.5])
    for number in (0, 1):
        run = lin.motion(number)
        squared = (2 * np.pi * lin.frequencies[number]) ** 2
        one, two = run["one.theta"], run["two.theta"]
        residual = (K - squared * M) @ np.stack([one, two]) / squared
        assert np.abs(residual).max() < (1e-10 if coordinates == "joint" else 2e-2)  # body: joints are closed by Newton
        assert 0.1 < np.abs(np.stack([one, two])).max() <= 0.3
        assert run.position_drift < 1e-9


def test_joints_of_loops_stay_closed():
    run = warned("neither an equilibrium", mb.linearize, four_bar.scene()).motion(0)
    assert run.position_drift < 1e-9 and np.ptp(run["crank.theta"]) > 0.1


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
