"""Studies of a scene with units are those of the scene in SI units, times factors."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from black_boxes import reloaded
from faults import refused
from machines import ball, spring_mass

import symmb as mb

DEGREE = np.pi / 180
FACTORS = {"tip": 1e3, "swing": 1 / DEGREE, "force": 1e-3}
"""Units of outputs over SI units."""
OF_PARAMETERS = {"arm": 1e-3, "rate": 1e3, "angle": DEGREE, "mass": 1e-3}
OWN = "mm", "N/mm", "deg", "g"
SOLVER, T = mb.DormandPrince(rtol=1e-9, atol=1e-11), np.linspace(0, 0.6, 13)


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
    return mb.Scene(system, {"hinge.angle": p.angle}, T, outputs, box, name="pendulum")


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
    assert "arm = 250 mm, rate = 0.125 N/mm, angle = 30 °, mass = 750 g" in str(runs[0])
    tip, _ = both[0].outputs["tip"]
    np.testing.assert_allclose(runs[0](tip), runs[0]["tip"] / 1000, rtol=1e-15)  # expressions are in SI units
    others = {"arm": "26 cm", "mass": (0.8, "kg")}, {"arm": 0.26, "mass": 0.8}
    further = [mb.simulate(scene, SOLVER, parameters=own) for scene, own in zip(both, others, strict=True)]
    same(*(run.values for run in further))
    assert further[0].parameters == {"arm": 260, "rate": 0.125, "angle": 30, "mass": 800}


@pytest.mark.parametrize(
    ("method", "times", "rel"),
    [(mb.Vertex(), T, 1e-12), (mb.Taylor(order=1), T, 1e-12), (mb.PolynomialChaos(order=2), T, 1e-12),
     (mb.TaylorModel(), [0.0, 0.05], 1e-9)],
    ids=["vertex", "taylor", "chaos", "proved"],
)  # fmt: skip
def test_bounds(both, method, times, rel):
    bounds = [mb.propagate(scene.with_times(times), method, solver=SOLVER) for scene in both]
    for side in ("lower", "upper"):
        same(*(getattr(each, side) for each in bounds), rel=rel)
    assert bounds[0].units == ("mm", "deg", "kN") and bounds[0].box.units == ("mm", "N/mm", "deg")


def test_sensitivities(both):
    own, si = (mb.sensitivities(scene, solver=SOLVER) for scene in both)
    ratio = np.multiply.outer([*FACTORS.values()], [*OF_PARAMETERS.values()])
    same(own.values, si.values, 1e-8, ratio)  # steps follow the sizes of derivatives
    assert "arm [mm]" in str(own) and "angle [°]" in str(own)


def test_contributions_worst_cases_and_limits(both, tmp_path):
    own, si = (mb.propagate(scene, mb.PolynomialChaos(), solver=SOLVER) for scene in both)
    same(*(np.swapaxes(each.contributions().alone, 1, 2) for each in (own, si)), 1e-6)
    worst = own.worst("tip").upper.parameters, si.worst("tip").upper.parameters
    assert [*worst[0].values()] == pytest.approx(np.divide([*worst[1].values()], [*OF_PARAMETERS.values()]), rel=1e-6)
    assert "arm [mm]" in str(own.worst("tip")) and " mm, rate = " in str(own.worst("tip").upper)
    limits = {"tip": ("-0.2 m", "21 cm"), "swing": (None, 0.7, "rad")}
    checks = own.check(limits), si.check({"tip": (-0.2, 0.21), "swing": (None, 0.7)})
    for name in limits:
        one, other = (check[name] for check in checks)
        assert one.kept == other.kept and one.margin == pytest.approx(other.margin * FACTORS[name], rel=1e-6)
    for path in (tmp_path / "bounds.json", tmp_path / "bounds.npz"):
        again = reloaded(own, path)
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
    assert "tip [mm]: 0.1\n" in str(own) and "tip: 0.0001\n" in str(si)
    assert [fit.plot().axes[0].get_title(loc="left") for fit in (own, si)] == ["tip [mm]", "tip"]
    again = reloaded(own, tmp_path / "fit.json")
    assert again.box() == own.box() and str(again) == str(own)


def test_tolerances_sweeps_modes_and_pickles(both):
    ends = (None, "0.56 rad"), (None, 0.56)
    own, si = (mb.tolerances(s, {"swing": end}, solver=SOLVER) for s, end in zip(both, ends, strict=True))
    assert own.factor == pytest.approx(si.factor, rel=1e-3)
    assert own.box.units == ("mm", "N/mm", "deg") and "arm [mm]" in str(own)
    scene = pickle.loads(pickle.dumps(both[0]))
    assert scene.units == both[0].units and scene.box == both[0].box
    own, si = mb.sweep(scene, {"arm": [240, 260]}, SOLVER), mb.sweep(both[1], {"arm": [0.24, 0.26]}, SOLVER)
    same(own.values.reshape(-1, 3), si.values.reshape(-1, 3))
    still = [replace(scene, start={}, equilibrium=True, box=scene.box.without("angle")) for scene in both]
    own, si = (mb.propagate(mb.ModalSimulator(scene), mb.Vertex(), scene.box) for scene in still)
    np.testing.assert_allclose(own.upper, si.upper, rtol=1e-9)
    assert own.box.units == ("mm", "N/mm")


def test_functions_and_fmus_take_quantities():
    chain = mb.FunctionSimulator(lambda a, b: [[a + b]], mb.Parameters(a=(1.0, "mm"), b=(2.0, "mm")), [0.0], ["gap"])
    bounds = mb.propagate(chain, mb.Vertex(), mb.Box(a="1 mm ±10%", b=(0.0019, 0.0021, "m")))
    assert [bounds.lower[0, 0], bounds.upper[0, 0]] == pytest.approx([2.8, 3.2], rel=1e-15)
    assert "a [mm]" in str(bounds.worst("gap"))
    chain = mb.FunctionSimulator(lambda a, b: [[a + b]], {"a": "1 mm", "b": (0.2, "cm")}, [0.0], ["gap"])
    assert dict(chain.parameters) == {"a": 1, "b": 0.2}
    assert mb.propagate(chain, mb.Vertex(), mb.Box(b="2 mm ±1 mm"))["gap"][0] == 1.1
    wrong = "FunctionSimulator: parameter 'a': 'x mm' is not a finite number"
    refused(wrong, mb.FunctionSimulator, lambda a: [[a]], {"a": "x mm"}, [0.0], ["gap"])


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
    for arm in ("25 cm", (0.25, "m"), "250 mm"):
        assert mb.FMUSimulator(path, {"arm": arm}, both[0].times, ["tip"]).parameters == {"arm": 250}
    fmu = mb.FMUSimulator(path, {"arm": 250.0}, both[0].times, ["tip", "swing", "force"])
    assert fmu.units == ("mm", "deg", "kN")
    bounds = mb.propagate(fmu, mb.Vertex(), mb.Box(arm=("24.9 cm", "25.1 cm")))
    expected = mb.propagate(both[1], mb.Vertex(), mb.Box(arm=(0.249, 0.251)), SOLVER)
    same(bounds.upper, expected.upper, 1e-7)


def test_tables_tell_units(both):
    own, si = ([mb.propagate(s, mb.PolynomialChaos(), solver=SOLVER), mb.simulate(s, SOLVER)] for s in both)
    for results, scene in ((own, both[0]), (si, both[1])):
        results += [results[0].contributions(), mb.sensitivities(scene, solver=SOLVER)]
        results += [mb.sweep(scene, {"mass": [scene.system.parameters["mass"]]}, SOLVER)]
    for result, plain in zip(own, si, strict=True):
        for name, unit in zip(FACTORS, own[0].units, strict=True):
            assert f"{name} [{unit.replace('deg', '°')}]" in str(result) and f"{name} [" not in str(plain)
    for name, unit in zip(FACTORS, own[0].units, strict=True):
        worst, plain = own[0].worst(name), si[0].worst(name)
        assert f"lowest {name} [{unit.replace('deg', '°')}]" in str(worst) and f"lowest {name} [" not in str(plain)
        assert f"{unit.replace('deg', '°')} at " in str(worst.lower)
        assert str(plain.lower).startswith(f"lowest {name} {plain.lower.value:.6g} at")
    assert [limit.text for limit in own[0].check({"tip": (-200, 210)}).limits] == ["-200 <= tip <= 210 mm"]
    assert [limit.text for limit in si[0].check({"tip": (-0.2, 0.21)}).limits] == ["-0.2 <= tip <= 0.21 m"]


def test_probabilities_and_samples(both):
    from scipy.stats import norm

    own, si = (mb.propagate(scene, mb.PolynomialChaos(order=2), solver=SOLVER) for scene in both)
    rows = (zip(b.box.names, b.box.center, b.box.radius, strict=True) for b in (own, si))
    laws = [{name: norm(c, r / 3) for name, c, r in each} for each in rows]
    level = float(np.degrees(np.mean(si["swing"], axis=0)).max())
    levels = (level, f"{level!r} deg", (level, "°"), (np.deg2rad(level), "rad"))
    found = [own.probability("swing", above=above, distributions=laws[0]) for above in levels]
    plain = si.probability("swing", above=np.deg2rad(level), distributions=laws[1])
    assert [each.ever[0] for each in found] == pytest.approx([plain.ever[0]] * 4, rel=1e-6)
    assert f"swing above {level:g} °" in str(found[1]) and f"above {np.deg2rad(level):g} rad" in str(plain)
    unfit = "'mm' does not fit output 'swing', which is in deg"
    refused(unfit, own.probability, "swing", above="60 mm", distributions=laws[0])
    assert "Quantiles of tip [mm]" in str(own.quantiles("tip", [0.1], distributions=laws[0]))
    assert own.samples(3, laws[0]).to_xarray()["arm"].attrs == {"units": "mm"}


def test_arrays_tell_units(both):
    pytest.importorskip("xarray")
    bounds, fit = mb.propagate(both[0], mb.Vertex(), solver=SOLVER), mb.simulate(both[0], SOLVER)
    for result in (bounds, mb.sensitivities(both[0], ["arm", "rate", "angle"], SOLVER), bounds.worst("tip")):
        units = result.to_xarray()["parameter_unit"].to_series()
        assert units[:3].to_list() == ["mm", "N/mm", "deg"]
    for result in (fit, mb.simulate(both[0], SOLVER, parameters=[{}]), bounds.worst("tip")):
        arrays = result.to_xarray()
        assert [arrays[name].attrs.get("units") for name in OF_PARAMETERS] == [*OWN]
    assert bounds.worst("tip").to_xarray()["attained"].attrs == {"units": "mm"}
    assert "parameter_unit" not in mb.propagate(both[1], mb.Vertex(), solver=SOLVER).to_xarray()


@pytest.mark.parametrize("seed", range(5))
def test_tables_in_files_hold_units(tmp_path, seed):
    """Names with brackets as well; files without units are read as they were."""
    rng = np.random.default_rng(seed)
    some = ["x", "y [mm]", "v[0]", "a []", "b] [", "[mm]", "µ", "w, z", "deg [deg] [deg]", "p lower"]
    names = tuple(rng.permutation(some)[: rng.integers(1, 8)].tolist())
    t, ends = np.arange(3.0), np.sort(rng.normal(size=(2, 3, len(names))), axis=0)
    drawn = rng.choice(["mm", "N/mm", "", "deg", "m/s^2", "°"], len(names)).tolist()
    for units in (tuple(drawn), ("m",) * len(names), ()):
        bounds = mb.Bounds(t, names, *ends, "sampled", "Vertex()", 4, units=units)
        again = reloaded(bounds, tmp_path / "bounds.csv")
        has_units = any(unit not in ("", "m", "m/s^2") for unit in units)
        assert again.names == names and again.units == (units if has_units else ())
        np.testing.assert_array_equal(again.upper, bounds.upper)
        head = (tmp_path / "bounds.csv").read_text().split(",")[0]
        assert head == ("t [s]" if has_units else "t")
        again.save(tmp_path / "again.csv")
        assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "bounds.csv").read_bytes()
    p = mb.Parameters(length=(250, "mm"))
    outputs = dict.fromkeys(names, p.length) | {"own": (p.length, "cm")}
    run = mb.simulate(mb.Scene(mb.System(parameters=p), outputs=outputs))
    again = reloaded(run, tmp_path / "run.csv")
    assert again.names == run.names and again.units == run.units == ("m",) * len(names) + ("cm",)
    np.testing.assert_array_equal(again.values, run.values)


@pytest.mark.parametrize("seed", range(5))
def test_limits_are_compared_without_units(seed):
    """What comes closest does not depend on the units of outputs."""
    rng = np.random.default_rng(seed)
    widths, shares = 10 ** rng.uniform(-3, 3, 3), rng.uniform(-0.4, 0.9, 3)
    names, t = ["a", "b", "c"], np.linspace(0, 1, 4)
    for factors in (np.ones(3), 10 ** rng.uniform(-6, 6, 3)):
        scales = widths * factors
        nominal = dict.fromkeys("xyz", 0.0)
        f = mb.FunctionSimulator(lambda x, y, z, s=scales: np.outer(1 + t, s * [x, y, z]), nominal, t, names)
        bounds = mb.propagate(f, mb.Vertex(), mb.Box(**dict.fromkeys("xyz", (-0.5, 0.5))))
        check = bounds.check({name: (None, (1 + 2 * s) * w) for name, s, w in zip(names, shares, scales, strict=True)})
        closest = int(np.argmin(shares))
        assert check.worst.output == names[closest]
        np.testing.assert_array_equal(check.margin, check[names[closest]].margin)
        assert (check.margin.min() < 0) == (check.kept is False)


def test_times_have_units(both):
    """First times, and output times, in other units."""
    scene, units, fall = both[0], {"ms": 1e-3, "min": 60.0, "us": 1e-6, "s": 1.0, "h": 3600.0}, ball(height=1.0)
    landed = mb.first_time(fall.ball.y <= 0)
    outputs = {unit: (landed, unit) for unit in units} | {"plain": landed}
    own = mb.Scene(fall.system, {"ball.y": 1.0}, (np.linspace(0, 1000, 11), "ms"), outputs)
    run = mb.simulate(own)
    np.testing.assert_array_equal(own.times, np.linspace(0, 1000, 11) / 1000)
    assert [run[unit] * factor for unit, factor in units.items()] == pytest.approx([np.sqrt(2 / 9.81)] * 5, rel=1e-8)
    assert run["plain"] == run["s"] and own.units == (*units, "s")
    thrown = fall.scene(outputs, [0, 1], {"ball.y": fall.p.height}, box=mb.Box(height=(0.9, 1.1)))
    bounds = mb.propagate(thrown, mb.Vertex())
    expected = np.outer(np.sqrt(np.array([0.9, 1.1]) * 2 / 9.81), 1 / np.array([*units.values(), 1.0]))
    np.testing.assert_allclose([bounds.lower[0], bounds.upper[0]], expected, rtol=1e-8)
    np.testing.assert_allclose(bounds.noise * [*units.values(), 1.0], bounds.noise[-1], rtol=1e-6)
    seconds = mb.simulate(scene, SOLVER, times=[0.0, 0.1])
    for times in (([0.0, 100.0], "ms"), ["0 s", "100 ms"], [0.0, "0.1 s"]):
        np.testing.assert_array_equal(mb.simulate(scene, SOLVER, times=times).values, seconds.values)
    refused("'mm' does not fit a time, which is in s", scene.with_times, ([0.0, 1.0], "mm"))
    for times in (2, 2.0, "2 s"):
        refused("expected a list of times in s, such as numpy", scene.with_times, times)


def test_values_of_sweeps_have_units(both):
    scene, radians = both[0], (np.deg2rad([30]), "rad")
    own = mb.sweep(scene, {"arm": [240, 250], "angle": [30]}, SOLVER)
    given = (["24 cm", 250], ["30 deg"]), (([0.24, 0.25], "m"), radians), ([240, "0.25 m"], [30])
    for arm, angle in given:
        again = mb.sweep(scene, {"arm": arm, "angle": angle}, SOLVER)
        np.testing.assert_allclose(again.values, own.values, rtol=1e-12)
        assert again.parameters["arm"].tolist() == [240, 250]
    runs = mb.simulate(scene, SOLVER, parameters=[{"arm": "24 cm"}, {"arm": (0.25, "m")}])
    np.testing.assert_allclose(runs.values, own.values, rtol=1e-12)
    for wrong in (["24 kg"], ([24], "kg"), [24, "kg"]):
        refused("kg", mb.sweep, scene, {"arm": wrong})


@pytest.mark.parametrize(
    "given", [("40 rpm", "90 rpm"), (40, 90, "rpm"), ("240 deg/s", "9.42477796076938 rad/s"), "65 ±25 rpm"]
)
def test_ranges_of_root_loci_have_units(given):
    damper = lambda m: mb.Force("damper", m.at, (-m.p.speed * m.ball.vx, 0))  # noqa: E731
    scene = mb.Scene(spring_mass(damper, stiffness=100.0, speed=(60, "rpm")).system)
    locus = mb.root_locus(scene, "speed", given, count=3)
    np.testing.assert_allclose(locus.values, [40, 65, 90], rtol=1e-12)
    np.testing.assert_allclose(locus.damping[:, 0], locus.values * 2 * np.pi / 60 / 20, rtol=1e-9)
    assert "speed = 40 to 90 rpm" in str(locus)


@pytest.mark.parametrize(
    "interval, is_far", [((0.709, 0.711), True), ((7.1e4, 7.2e4), True), ((650.0, 700.0), False), ((-8e4, 8e4), False)]
)
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_intervals_in_another_unit_are_told_if_runs_fail(interval, is_far):
    def arm(length: float) -> list[float]:
        raise ValueError("out of reach")

    failing = mb.FunctionSimulator(arm, mb.Parameters(length=(710.0, "mm")), [0.0], ["y"])
    own = failing, mb.PolynomialChaos(), mb.Box(length=interval)
    message = refused(None, mb.propagate, *own, error=mb.PropagationError)
    assert ("mm is far from the nominal value 710 mm. Check its unit." in message) == is_far
