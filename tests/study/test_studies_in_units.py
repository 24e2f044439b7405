"""Studies of a scene with units are those of the scene in SI units, times factors."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import symmb as mb

DEGREE = np.pi / 180
FACTORS = {"tip": 1e3, "swing": 1 / DEGREE, "force": 1e-3}
"""Units of outputs over SI units."""
OF_PARAMETERS = {"arm": 1e-3, "rate": 1e3, "angle": DEGREE, "mass": 1e-3}
OWN = "mm", "N/mm", "deg", "g"
SOLVER = mb.DormandPrince(rtol=1e-9, atol=1e-11)


def pendulum(has_units):
    """A pendulum with a spring, with units or without."""
    if has_units:
        p = mb.Parameters(arm=(250, "mm"), rate=(0.125, "N/mm"), angle="30 deg", mass=(750, "g"))
    else:
        p = mb.Parameters(arm=0.25, rate=125.0, angle=30 * DEGREE, mass=0.75)
    ground, rod = mb.Ground(), mb.Body("rod", p.mass, p.mass * p.arm**2 / 12, com=(p.arm / 2, 0))
    hinge, tip = mb.Revolute("hinge", ground.point(0, 0), rod.point(0, 0)), rod.point(p.arm, 0)
    spring = mb.SpringDamper("spring", ground.point(0.1, 0.2), tip, p.rate, 1.5, 0.15)
    system = mb.System(rod, hinge, spring, mb.Gravity(0, -9.81), parameters=p)
    outputs = {"tip": tip.y, "swing": hinge.angle, "force": system.force("spring")}
    units = {"tip": "mm", "swing": "deg", "force": "kN"}
    box = mb.Box(arm=(0.249, 0.251), rate=(120.0, 130.0), angle=(29 * DEGREE, 31 * DEGREE))
    if has_units:
        outputs = {name: (expression, units[name]) for name, expression in outputs.items()}
        box = mb.Box.plus_minus(p, arm="250 mm ±1 mm", rate="0.125 ±0.005", angle="30° ±1°")
    return mb.Scene(system, {"hinge.angle": p.angle}, np.linspace(0, 0.6, 13), outputs, box, name="pendulum")


@pytest.fixture(scope="module")
def both():
    return pendulum(True), pendulum(False)


def same(own, si, rel=1e-12, factors=None):
    """Values (..., n_y) in units are those in SI units times factors, beside the largest of each output."""
    expected = np.asarray(si) * ([*FACTORS.values()] if factors is None else factors)
    assert np.all(np.abs(own - expected) <= rel * np.abs(expected).max(axis=0, keepdims=True))


def test_runs(both):
    runs = [mb.simulate(scene, SOLVER) for scene in both]
    same(*(run.values for run in runs))
    assert runs[0].units == ("mm", "deg", "kN")
    assert "arm = 250 mm, rate = 0.125 N/mm, angle = 30 deg, mass = 750 g" in str(runs[0])
    further = [mb.simulate(both[0], SOLVER, parameters={"arm": "26 cm", "mass": (0.8, "kg")})]
    further += [mb.simulate(both[1], SOLVER, parameters={"arm": 0.26, "mass": 0.8})]
    same(*(run.values for run in further))
    assert further[0].parameters == {"arm": 260, "rate": 0.125, "angle": 30, "mass": 800}


def test_expressions_of_a_run_are_in_si_units(both):
    scene = both[0]
    run = mb.simulate(scene, SOLVER)
    tip, _ = scene.outputs["tip"]
    np.testing.assert_allclose(run(tip), run["tip"] / 1000, rtol=1e-15)


@pytest.mark.parametrize("method", [mb.Vertex(), mb.Taylor(order=1), mb.PolynomialChaos(order=2)])
def test_bounds(both, method):
    bounds = [mb.propagate(scene, method, solver=SOLVER) for scene in both]
    for side in ("lower", "upper"):
        same(*(getattr(each, side) for each in bounds))
    assert bounds[0].units == ("mm", "deg", "kN") and bounds[0].box.units == ("mm", "N/mm", "deg")


def test_proved_bounds(both):
    bounds = [mb.propagate(scene.with_times([0.0, 0.05]), mb.TaylorModel(), solver=SOLVER) for scene in both]
    for side in ("lower", "upper"):
        same(*(getattr(each, side) for each in bounds), rel=1e-9)


def test_sensitivities(both):
    own, si = (mb.sensitivities(scene, solver=SOLVER) for scene in both)
    ratio = np.multiply.outer([*FACTORS.values()], [*OF_PARAMETERS.values()])
    same(own.values, si.values, 1e-8, ratio)  # steps follow the sizes of derivatives
    assert "arm [mm]" in str(own) and "angle [deg]" in str(own)


def test_contributions_worst_cases_and_limits(both, tmp_path):
    own, si = (mb.propagate(scene, mb.PolynomialChaos(), solver=SOLVER) for scene in both)
    widths = [np.swapaxes(each.contributions().alone, 1, 2) for each in (own, si)]
    same(*widths, 1e-6)
    worst = own.worst("tip").upper.parameters, si.worst("tip").upper.parameters
    assert [*worst[0].values()] == pytest.approx(np.divide([*worst[1].values()], [*OF_PARAMETERS.values()]), rel=1e-6)
    assert "arm [mm]" in str(own.worst("tip")) and " mm, rate = " in str(own.worst("tip").upper)
    limits = {"tip": ("-0.2 m", "21 cm"), "swing": (None, 0.7, "rad")}
    checks = own.check(limits), si.check({"tip": (-0.2, 0.21), "swing": (None, 0.7)})
    for name in limits:
        assert checks[0][name].kept == checks[1][name].kept
        np.testing.assert_allclose(checks[0][name].margin, checks[1][name].margin * FACTORS[name], rtol=1e-6)
    for suffix in ("json", "npz"):
        own.save(tmp_path / f"bounds.{suffix}")
        again = mb.Bounds.load(tmp_path / f"bounds.{suffix}")
        assert again.box == own.box and again.units == own.units
        assert str(again.worst("tip")) == str(own.worst("tip"))
        assert again.check({"tip": ("-0.2 m", None)})["tip"].low == -200
    own.report(tmp_path / "report.html", limits)
    assert "arm [mm]" in (tmp_path / "report.html").read_text()
    texts = {text for axes in own.plot().axes for text in (axes.get_title(loc="left"), axes.get_ylabel())}
    assert {"tip [mm]", "swing [°]", "force [kN]"} <= texts


def test_calibration(both, tmp_path):
    truth = mb.simulate(both[1], SOLVER, parameters={"arm": 0.252, "rate": 121.0})["tip"]
    own = mb.calibrate(both[0], {"tip": 1e3 * truth}, ["arm", "rate"], SOLVER, noise={"tip": 0.1})
    si = mb.calibrate(both[1], {"tip": truth}, ["arm", "rate"], SOLVER, noise={"tip": 1e-4})
    assert own.parameters == pytest.approx({"arm": 252, "rate": 0.121}, rel=1e-6)
    assert [*own.deviations.values()] == pytest.approx(np.multiply([*si.deviations.values()], [1e3, 1e-3]), rel=1e-4)
    assert own.box().units == ("mm", "N/mm") and "arm [mm]" in str(own)
    own.save(tmp_path / "fit.json")
    again = mb.Calibration.load(tmp_path / "fit.json")
    assert again.box() == own.box() and str(again) == str(own)


def test_tolerances(both):
    own = mb.tolerances(both[0], {"swing": (None, "0.56 rad")}, solver=SOLVER)
    si = mb.tolerances(both[1], {"swing": (None, 0.56)}, solver=SOLVER)
    assert own.factor == pytest.approx(si.factor, rel=1e-3)
    assert own.box.units == ("mm", "N/mm", "deg") and "arm [mm]" in str(own)


def test_sweeps_and_pickles(both):
    scene = pickle.loads(pickle.dumps(both[0]))
    assert scene.units == both[0].units and scene.box == both[0].box
    own, si = mb.sweep(scene, {"arm": [240, 260]}, SOLVER), mb.sweep(both[1], {"arm": [0.24, 0.26]}, SOLVER)
    same(own.values.reshape(-1, 3), si.values.reshape(-1, 3))


def test_modes(both):
    still = [replace(scene, start={}, equilibrium=True, box=scene.box.without("angle")) for scene in both]
    own, si = (mb.propagate(mb.ModalSimulator(scene), mb.Vertex(), scene.box) for scene in still)
    np.testing.assert_allclose(own.upper, si.upper, rtol=1e-9)
    assert own.box.units == ("mm", "N/mm")


def test_a_function_takes_numbers_in_its_units():
    chain = mb.FunctionSimulator(lambda a, b: [[a + b]], mb.Parameters(a=(1.0, "mm"), b=(2.0, "mm")), [0.0], ["gap"])
    bounds = mb.propagate(chain, mb.Vertex(), mb.Box(a="1 mm ±10%", b=(0.0019, 0.0021, "m")))
    assert [bounds.lower[0, 0], bounds.upper[0, 0]] == pytest.approx([2.8, 3.2], rel=1e-15)
    assert "a [mm]" in str(bounds.worst("gap"))


@pytest.mark.parametrize("version", [2, 3])
def test_fmus_tell_units_and_run_in_them(both, tmp_path, version):
    fmpy, validation = pytest.importorskip("fmpy"), pytest.importorskip("fmpy.validation")
    path = tmp_path / "pendulum.fmu"
    mb.save_fmu(mb.prepare(both[0], SOLVER), path, version=version)
    assert validation.validate_fmu(str(path)) == []
    told = fmpy.read_model_description(path)
    units = {unit.name: unit.baseUnit for unit in told.unitDefinitions}
    assert (units["mm"].factor, units["mm"].m, units["deg"].factor, units["deg"].rad) == (1e-3, 1, DEGREE, 1)
    assert (units["N/mm"].factor, units["N/mm"].kg, units["N/mm"].s, units["kN"].m) == (1e3, 1, -2, 1)
    variables = {variable.name: variable for variable in told.modelVariables}
    assert {name: variables[name].unit for name in OF_PARAMETERS} == dict(zip(OF_PARAMETERS, OWN, strict=True))
    assert float(variables["arm"].start) == 250
    fmu = mb.FMUSimulator(path, {"arm": 250.0}, both[0].times, ["tip", "swing", "force"])
    assert fmu.units == ("mm", "deg", "kN")
    bounds = mb.propagate(fmu, mb.Vertex(), mb.Box(arm=("24.9 cm", "25.1 cm")))
    expected = mb.propagate(both[1], mb.Vertex(), mb.Box(arm=(0.249, 0.251)), SOLVER)
    same(bounds.upper, expected.upper, 1e-7)
