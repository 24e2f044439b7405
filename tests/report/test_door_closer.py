"""A door closer in the units of its drawing, from declaration to report, is that of the benchmark in SI units."""

import html
import re

import casadi as ca
import numpy as np
import pytest
from _machines_a import door_closer, rod

import symmb as mb

FACTORS = {"angle": 180 / np.pi, "speed": 180 / np.pi, "slam": 1.0, "shut after": 1.0}


def drawn():
    """The door closer of `_machines_a` in mm, degrees, N m: no number is converted by hand."""
    p = mb.Parameters(
        main="240 mm", fore="330 mm", bracket="450 mm", mass="45 kg", preload="7 N m", spring=(4, "N m/rad"),
        sweep="9 N m s/rad", latch="4 N m s/rad", seal="0.6 N m", width="90 cm", pinion_x="220 mm", pinion_y="60 mm",
        shoe_y="60 mm", valve="15 deg", shut="1.55 rad", fading="0.02 rad/s", open="1.4 rad",
    )  # fmt: skip
    ground = mb.Ground()
    leaf = mb.Body("leaf", p.mass, p.mass * p.width**2 / 12, mb.Planar(), com=(p.width / 2, 0))
    main, fore = rod("main", p.main, 0.6), rod("fore", p.fore, 0.5)
    hinge = mb.Revolute("hinge", ground.point(0, 0), leaf.point(0, 0))
    pinion = mb.Revolute("pinion", leaf.point(p.pinion_x, p.pinion_y), main.point(0, 0))
    oil = ca.if_else(hinge.angle > p.valve, p.sweep, p.latch)
    torque = p.preload + p.spring * (p.shut - pinion.angle) - oil * pinion.angle_rate
    system = mb.System(
        leaf, main, fore, hinge, pinion,
        mb.Revolute("elbow", main.point(p.main, 0), fore.point(0, 0)),
        mb.Revolute("shoe", fore.point(p.fore, 0), ground.point(p.bracket, p.shoe_y)),
        mb.Actuator("closer", pinion, torque),
        mb.Actuator("bearing", hinge, -p.seal * ca.tanh(hinge.angle_rate / p.fading)),
        mb.Stop("frame", hinge, 0.0, None, mb.KelvinVoigt(6e4, 150.0)),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"hinge.angle": p.open},
        guess={"main.theta": 0.25, "fore.theta": -0.76},
        times=np.linspace(0, 6, 151),
        outputs={
            "angle": (hinge.angle, "deg"),
            "speed": (hinge.angle_rate, "deg/s"),
            "slam": (mb.maximum(system.force("frame")), "N m"),
            "shut after": (mb.first_time(hinge.angle <= 0), "s"),
        },
        box=mb.Box.plus_minus(
            p, main="240 mm ±0.3 mm", fore="±0.3 mm", mass="45 ±1 kg", preload="7 ±10%", spring="±0.2 N m/rad",
            sweep=0.6, latch=0.3, seal="20%",
        ),
        name="door closer",
    )  # fmt: skip


@pytest.fixture(scope="module")
def both():
    return drawn(), door_closer(None)


def test_its_runs_are_those_in_si_units(both):
    runs = [mb.simulate(scene) for scene in both]
    for name, factor in FACTORS.items():
        size = np.abs(factor * runs[1][name]).max()
        np.testing.assert_allclose(runs[0][name], factor * runs[1][name], rtol=0, atol=1e-7 * size)
    assert both[0].units == ("deg", "deg/s", "N m", "s")


def test_its_box_is_that_in_si_units(both):
    si = dict(zip(both[0].box.names, both[0].box.units, strict=True))
    expected = {"main": (0.2397, 0.2403), "fore": (0.3297, 0.3303)}
    for name, ends in dict(both[1].box).items():
        factor = 1e-3 if si[name] == "mm" else 1.0
        assert np.multiply(both[0].box[name], factor) == pytest.approx(expected.get(name, ends), rel=1e-12)
        assert ends == pytest.approx(expected.get(name, ends), rel=1e-12)


def test_its_report_is_in_units(both, tmp_path):
    times, names = np.linspace(0, 2, 21), ("angle", "speed")
    few = (scene.with_times(times).with_outputs({k: scene.outputs[k] for k in names}) for scene in both)
    bounds, si = (mb.propagate(scene, mb.Vertex()) for scene in few)
    size = np.abs(si.upper).max(axis=0) * 180 / np.pi
    assert np.all(np.abs(bounds.upper - si.upper * 180 / np.pi) <= 1e-6 * size)
    check = bounds.check({"speed": ("-75 deg/s", None), "angle": (None, "1.5 rad")})
    assert check["angle"].high == pytest.approx(1.5 * 180 / np.pi, rel=1e-15)
    bounds.report(tmp_path / "report.html", {"speed": ("-75 deg/s", None)})
    text = re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " ", (tmp_path / "report.html").read_text())))
    for shown in ("main [mm]", "spring [N m/rad]", "°/s", "239.7 240.3"):
        assert shown in text
