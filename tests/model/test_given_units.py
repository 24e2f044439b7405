"""Parameters, boxes and outputs with units, and units of outputs: worked out where they follow, blank elsewhere."""

import re

import casadi as ca
import numpy as np
import pytest
from faults import refused, told_in_a_line
from scipy import constants as si

import symmb as mb
from symmb.equations.model import units_of

FACTORS = {
    "mm": si.milli, "cm": si.centi, "µm": si.micro, "um": si.micro, "km": si.kilo, "in": si.inch, "ft": si.foot,
    "g": si.gram, "t": si.metric_ton, "lb": si.pound, "mg": 1e-6, "ms": si.milli, "min": si.minute, "h": si.hour,
    "deg": si.degree, "°": si.degree, "mrad": si.milli, "deg/s": si.degree, "rpm": 2 * si.pi / 60, "rad/s^2": 1.0,
    "kN": si.kilo, "lbf": si.pound_force, "N/mm": 1e3, "kN/m": 1e3, "N m/deg": 1 / si.degree,
    "Nmm/deg": 1e-3 / si.degree,
    "N·s/mm": 1e3, "N s/(m rad)": 1.0, "kg m^2": 1.0, "kg*cm**2": 1e-4, "g/cm³": 1e3, "MPa": 1e6, "bar": si.bar,
    "N/mm²": 1e6, "km/h": si.kmh, "s^-1": 1.0, "1/min": 1 / 60, "kW": 1e3, "mV": 1e-3, "ohm": 1.0, "mH": 1e-3,
    "V s/rad": 1.0, "N/(mm/s)": 1e3, "K": 1.0, "1": 1.0, "kHz": 1e3, "mJ": 1e-3,
}  # fmt: skip


def told(why, call, /, *arguments, **options):
    """A call is refused in a line."""
    assert "\n" not in refused(why, call, *arguments, **options)


@pytest.fixture(scope="module")
def quantities():
    """A scene of parameters that are outputs in their units, with random numbers, and its factors."""
    numbers = np.random.default_rng(59).uniform(0.1, 900, len(FACTORS))
    given = dict(zip(FACTORS, numbers.tolist(), strict=True))
    p = mb.Parameters(**{f"p{k}": (number, unit) for k, (unit, number) in enumerate(given.items())})
    outputs = {f"y{k}": (getattr(p, f"p{k}"), unit) for k, unit in enumerate(FACTORS)}
    si_values = {f"y{k} in SI units": getattr(p, f"p{k}") for k, unit in enumerate(FACTORS)}
    return mb.Scene(mb.System(parameters=p), outputs=outputs | si_values), given


@pytest.mark.parametrize("unit", FACTORS)
def test_a_quantity_goes_into_si_units_and_back(quantities, unit):
    scene, given = quantities
    run, k = mb.simulate(scene), [*FACTORS].index(unit)
    name, output = f"p{k}", f"y{k}"
    assert run[f"{output} in SI units"][0] == pytest.approx(given[unit] * FACTORS[unit], rel=4e-16)
    assert run[output][0] == pytest.approx(given[unit], rel=4e-16)
    assert scene.units[k] == unit
    box = mb.Box(**{name: (given[unit], 2 * given[unit])})
    text = f"{given[unit]!r} {unit}", f"{2 * given[unit]!r} {unit}"
    own = {name: unit}
    assert mb.Box(**{name: text}).with_units(own) == box.with_units(own) == mb.Box(**{name: (*box[name], unit)})


REFUSED = [
    ("mm", "2 kg", "'kg' does not fit parameter 'x', which is in mm"),
    ("mm", "2 N/mmm", "'mmm' in 'N/mmm' is not a known"),
    ("mm", "2 mmm", "'mmm' is not a known unit. Did you mean 'mm'"), ("rad/s", "2 Hz", "does not fit"),
    ("rpm", "2 1/s", "does not fit"), ("N m", "2 N", "does not fit"), ("K", "20 °C", "°C is not the zero of K"),
    ("K", "20 degF", "the zero of degF"), ("mm", "2 m2", "is not a unit"), ("N", "2 N/", "is not a unit"),
    ("N", "2 (N", "is not a unit"), ("N", "2 N/m s", "is ambiguous"), ("kg", "2 m/kg/s", "does not fit"),
    ("", "2 mm", "'x', which has no unit"), ("mm", "two mm", "not a finite number"),
    ("mm", "2,5 mm", "has a comma. Write decimals"),
    ("N m/rad", "2 N m", "does not fit"), ("mm", "2 %", "is not a unit"), ("mm", "nan mm", "not a finite number"),
    ("V", "2 A", "does not fit"), ("mm", "2 M", "'M' is not a known unit"), ("N", "2 kgf", "'kgf' is not a known unit"),
]  # fmt: skip


@pytest.mark.parametrize(("own", "given", "why"), REFUSED)
def test_what_does_not_fit_is_refused(own, given, why):
    p = mb.Parameters(x=(3.0, own))
    scene = mb.Scene(mb.System(parameters=p), outputs={"y": (p.x, own) if own else p.x})
    told(why, lambda: mb.Scene(scene.system, outputs=scene.outputs, box=mb.Box(x=(given, given))))
    told(why, mb.simulate, scene, parameters={"x": given})
    ends = np.array([[2.0]]), np.array([[4.0]])
    bounds = mb.Bounds(np.zeros(1), ("y",), *ends, "sampled", "Vertex()", 2, units=(own,))
    told(why.replace("parameter 'x'", "output 'y'").replace("'x'", "'y'"), bounds.check, {"y": (None, given)})


@pytest.mark.parametrize("unit", sorted({unit for unit in FACTORS if unit.isascii() and unit.isalpha()} - {"m", "N"}))
def test_units_in_other_letters_are_recognised(unit):
    for wrong in {unit.upper(), unit.lower(), unit.capitalize()} - {*FACTORS, unit, "MPA"}:
        try:
            mb.Parameters(x=(1.0, wrong))
        except mb.DeclarationError as error:
            assert f"{wrong!r} is not a known unit. Did you mean {unit!r}?" in str(error)
        else:  # another unit: Mg is no Mm
            assert wrong in {"G", "H", "K", "A", "V", "W", "J", "h", "g", "s"}


@pytest.mark.parametrize("seed", range(3))
def test_decimal_commas_are_recognised(seed):
    number = f"{np.random.default_rng(seed).uniform(1, 900):.3f}".replace(".", ",")
    for text in (f"{number} N/mm", number, f"{number}mm", f"1.{number} mm"):
        told("has a comma. Write decimals with a point", mb.Parameters, x=text)
        told("has a comma. Write decimals with a point", mb.Box, x=(text, "3 mm"))
    told("Use a point", mb.Box, x=f"{number} mm ±10%")


@pytest.mark.parametrize("unit", ["N/mmm", "°C", "N/m s", "m2", "kgf"])
def test_unknown_units_are_refused_where_they_are_declared(unit):
    told("unit|ambiguous|zero", mb.Parameters, x=(1.0, unit))
    told("unit|ambiguous|zero", mb.Scene, mb.System(), outputs={"y": (mb.t, unit)})


BODY = mb.Body("body", 1.0, 0.1)


@pytest.mark.parametrize(
    ("output", "unit", "why"),
    [
        (BODY.x, "kg", "'kg' does not fit output 'y', which is in m"), (BODY.omega, "Hz", "which is in rad/s"),
        (mb.maximum(BODY.vx), "mm", "which is in m/s"), (mb.first_time(BODY.x < 0), "mm", "which is in s"),
        (mb.mean(BODY.theta), "m", "which is in rad"),
    ],
)  # fmt: skip
def test_outputs_are_asked_in_units_that_fit(output, unit, why):
    told(why, mb.Scene, mb.System(BODY), times=[0.0, 1.0], outputs={"y": (output, unit)})


@pytest.mark.parametrize(
    ("given", "ends"),
    [
        ("235 mm ±0.5 mm", (234.5, 235.5)), ("235 ±0.5 mm", (234.5, 235.5)), ("23.5 cm ±0.5 mm", (234.5, 235.5)),
        ("235 ±0.5", (234.5, 235.5)), ("235 mm +/- 2%", (230.3, 239.7)), ("235 mm +0.2/-0.1 mm", (234.9, 235.2)),
        ("235 +0.2 -0.1 mm", (234.9, 235.2)), ((0.234, 0.236, "m"), (234, 236)), (("234 mm", "23.6 cm"), (234, 236)),
        ((234, 236), (234, 236)),
    ],
)  # fmt: skip
def test_intervals_are_told_in_words(given, ends):
    p = mb.Parameters(arm=(235, "mm"))
    scene = mb.Scene(mb.System(parameters=p), outputs={"arm": p.arm}, box=mb.Box(arm=given))
    assert scene.box.units == ("mm",)
    assert scene.box["arm"] == pytest.approx(ends, rel=1e-15)


@pytest.mark.parametrize(
    ("tolerance", "ends"),
    [
        ("±0.1 mm", (234.9, 235.1)), ("±0.01 cm", (234.9, 235.1)), ("235 mm ±0.1", (234.9, 235.1)),
        ("235 ±0.1", (234.9, 235.1)), ("1%", (232.65, 237.35)), (0.1, (234.9, 235.1)), ((-0.1, 0.2), (234.9, 235.2)),
        ("235 H7", (235, 235.046)), ("+0.2/-0.1 mm", (234.9, 235.2)), ("23.5 cm +1/-2 mm", (233, 236)),
        ("235 ISO 2768-m", (234.5, 235.5)),
    ],
)  # fmt: skip
def test_tolerances_around_nominal_values(tolerance, ends):
    box = mb.Box.plus_minus(mb.Parameters(arm=(235, "mm")), arm=tolerance)
    assert box.units == ("mm",) and box["arm"] == pytest.approx(ends, rel=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_tolerances_without_a_size(seed):
    """Quantities, shares and pairs, by SciPy's factors."""
    rng = np.random.default_rng(seed)
    own, other = rng.choice(["mm", "cm", "in", "m", "µm", "ft"], 2)
    ratio, (nominal, size) = FACTORS.get(other, 1.0) / FACTORS.get(own, 1.0), rng.uniform(1, 9, 2).round(3)
    p = mb.Parameters(arm=(nominal, own))
    texts = f"{size} {other}", f"±{size} {other}", f"±{size:.3e} {other}", f"+/- {size} {other}"
    for text in (*texts, (size, other), (-size, size, other)):
        ends = nominal - size * ratio, nominal + size * ratio
        assert mb.Box.plus_minus(p, arm=text)["arm"] == pytest.approx(ends, rel=1e-12), text
    ends = nominal - size * ratio, nominal + 2 * size * ratio
    assert mb.Box.plus_minus(p, arm=(f"-{size} {other}", f"{2 * size} {other}"))["arm"] == pytest.approx(ends)
    for share in (f"±{size}%", f"± {size} %", f"+/-{size}%", f"+/− {size} %"):
        assert mb.Box.plus_minus(p, arm=share) == mb.Box.plus_minus(p, arm=f"{size}%")
        assert mb.Box.around(p, share) == mb.Box.around(p, f"{size}%")


@pytest.mark.parametrize(("text", "unit"), [("1°", "°"), ("2 mm", "mm"), ("±1 N/mm", "N/mm"), ("1 N m/deg", "N m/deg")])
def test_tolerances_with_a_unit_ask_for_that_of_the_parameter(text, unit):
    with told_in_a_line(re.escape(f"'rest' has no unit, but {text!r} has. Declare rest=(..., {unit!r}).")):
        mb.Box.plus_minus(mb.Parameters(rest=1.0), rest=text)


@pytest.mark.parametrize("unit", ["m", "in", "cm"])
def test_tolerances_of_drawings_for_parameters_in_other_units(unit):
    p = mb.Parameters(arm=(0.235 / FACTORS.get(unit, 1.0), unit))
    for text, ends in (("235 H7", (0.235, 0.235046)), ("235 mm ±0.1 mm", (0.2349, 0.2351)), ("±1 mm", (0.234, 0.236))):
        box = mb.Box.plus_minus(p, arm=text)
        assert np.multiply(box["arm"], FACTORS.get(unit, 1.0)) == pytest.approx(ends, rel=1e-14)


@pytest.mark.parametrize(
    ("tolerance", "why"),
    [
        ("±0.1 kg", "'kg' does not fit parameter 'arm', which is in mm"), ("236 mm ±1 mm", "is 235 mm, which is"),
        ("235 H99", "'arm'"), ("235 mm ±1 kg", "does not fit the size of 'arm'"), ("235 mm ±0,1 mm", "Use a point"),
        ("1°", "'°' does not fit parameter 'arm'"), ("-1 mm", "'arm': '-1 mm' is not a tolerance"),
        ("1,5 mm", "'arm'"), ("1,5%", "Use a point"), ("±1,5%", "Use a point"), ((1, "kg"), "'kg' does not fit"),
        (("1 mm", 2), "give both ends a unit, or neither end"), ((1, 2, "mmm"), "'mmm' is not a"),
        ((-1, "mm"), "at least 0"), ("-1%", "at least 0 % and"), (".1", "or a tolerance. Write '±.1'"),
    ],
)  # fmt: skip
def test_tolerances_that_do_not_fit_are_refused(tolerance, why):
    told(why, mb.Box.plus_minus, mb.Parameters(arm=(235, "mm")), arm=tolerance)
    told("has no unit, but|not a tolerance|'arm'", mb.Box.plus_minus, mb.Parameters(arm=0.235), arm=tolerance)


@pytest.mark.parametrize(
    "given", ["±1 mm", ("234", "236"), ("1 mm", 2), ("1 mm", "2 kg"), "wide", "10%", (1.0, 2.0, "N/mmm")]
)
def test_what_is_no_interval_is_refused(given):
    told("Box: ", mb.Box, arm=given)


def test_tables_of_tolerances_in_units(tmp_path):
    file = tmp_path / "tolerances.csv"
    file.write_text(
        "name,nominal,plus,minus,tolerance\narm,235,0.5 mm,0.01 cm,\nrate,2.5 N/mm,,,10%\nmass,800,,,±5 g\n"
    )
    p = mb.Parameters(arm=(235, "mm"), rate=(2500, "N/m"), mass=(0.8, "kg"))
    told("nominal value of 'mass' is 800 in the table, but 0.8 in the model", mb.Box.read, file, p)
    file.write_text(file.read_text().replace("800", "0.8"))
    box = mb.Box.read(file, p)
    assert box.units == ("mm", "N/m", "kg")
    assert np.ravel(box.bounds) == pytest.approx([234.9, 235.5, 2250, 2750, 0.795, 0.805], rel=1e-15)


def test_units_are_shown_and_equations_are_in_si_units():
    p = mb.Parameters(arm=(235, "mm"), angle=(30, "deg"), mass=0.8)
    assert repr(p) == "Parameters(arm=(235, 'mm'), angle=(30, 'deg'), mass=0.8)"
    box = mb.Box.around(p, 0.1)
    assert repr(box) == "Box(arm=(211.5, 258.5, 'mm'), angle=(27, 33, 'deg'), mass=(0.72, 0.88))"
    assert repr(eval(repr(box), {"Box": mb.Box})) == repr(box)
    assert "arm [mm]" in box._repr_html_() and "arm [mm]" in p._repr_html_()
    rod = mb.Body("rod", p.mass, p.mass * p.arm**2 / 12)
    with_units = mb.System(rod, mb.Torque("t", rod, p.mass * p.angle), parameters=p)
    q = mb.Parameters(arm=0.235, angle=0.5, mass=0.8)
    bar = mb.Body("rod", q.mass, q.mass * q.arm**2 / 12)
    without = mb.System(bar, mb.Torque("t", bar, q.mass * q.angle), parameters=q)
    assert with_units.equations() == without.equations() and with_units.to_sympy() == without.to_sympy()


def test_without_units_expressions_are_the_symbols():
    p = mb.Parameters(arm=0.235)
    assert p.arm.is_symbolic() and mb.Box.around(p, 0.1).units == () and repr(p) == "Parameters(arm=0.235)"


@pytest.mark.parametrize("seed", range(20))
def test_products_of_units_have_the_product_of_factors(seed):
    rng = np.random.default_rng(seed)
    simple = [unit for unit in FACTORS if unit.isalpha() or unit == "°"]
    above, below, (power, raised) = rng.choice(simple, 2), rng.choice(simple, 2), rng.integers(1, 4, 2)
    sign = rng.choice([" ", "*", " * ", "·", "."])
    text = f"{above[0]}^{power}{sign}{above[1]}/({below[0]}{sign}{below[1]}^{raised})"
    factor = FACTORS[above[0]] ** power * FACTORS[above[1]] / FACTORS[below[0]] / FACTORS[below[1]] ** raised
    p = mb.Parameters(x=(3.0, text), y=f"3 {above[0]}**{power}{sign}{above[1]}/{below[0]}/{below[1]}^{raised}")
    run = mb.simulate(mb.Scene(mb.System(parameters=p), outputs={"x": p.x, "y": p.y, "own": (p.x, text)}))
    assert run["x"][0] == pytest.approx(3 * factor, rel=1e-14) and run["y"][0] == pytest.approx(3 * factor, rel=1e-14)
    assert run["own"][0] == pytest.approx(3.0, rel=1e-15)


P = mb.Parameters(x=2.0, k=3.0)
GROUND = mb.Ground()
ROD = mb.Body("rod", mass=2.0, inertia=0.1, pose=mb.Planar())
BALL = mb.Body("ball", mass=1.0, pose=mb.Particle())
TOP = mb.Body("top", mass=1.0, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
HINGE = mb.Revolute("hinge", GROUND.point(0, 0), ROD.point(-0.3, 0))
BAR = mb.Distance("bar", GROUND.point(1, 0), BALL.point(0, 0), 0.7)
SPIN = mb.Motion("spin", ROD.theta, 0.2 * mb.t)
PIN = mb.Revolute("pin", GROUND.point(0, 0, 0), TOP.point(0, 0, -0.1), axis=(0, 0, 1))
SYSTEM = mb.System(ROD, BALL, TOP, HINGE, BAR, SPIN, PIN, parameters=P)
LAM = SYSTEM.lam

REACTION = SYSTEM.reaction("hinge").fx
UNITS = {
    "rad": (ROD.theta, ROD.theta - P.k, ca.atan2(BALL.y, BALL.x), HINGE.angle, PIN.angle),
    "rad/s": (-ROD.omega,),
    "rad/s^2": (SYSTEM.ddt(ROD.omega),),
    "m": (ROD.point(0.3, 0).x, ca.sqrt(BALL.x**2 + BALL.y**2), ca.fmax(BALL.x, 0.1), ca.if_else(BALL.x > 0, BALL.x, 0)),
    "m^3": (BALL.x * BALL.y * BALL.z,),
    "m/s": (ROD.point(0.3, 0).vy, ROD.omega * BALL.x),
    "m/s^2": (BALL.vx / mb.t,),
    "m^2/s^2": (BALL.vx**2,),
    "N": (LAM("hinge")[0], REACTION),
    "N m": (LAM("spin")[0],),
    "W": (LAM("spin")[0] * ROD.omega,),
    "s": (mb.t,),
}
KNOWN = [(expression, unit) for unit, expressions in UNITS.items() for expression in expressions]
UNKNOWN = [1000 * BALL.x, 2 * BALL.x, BALL.x / BALL.y, BALL.x > 0, BALL.x + BALL.vx, BALL.x**3.7, 0.5 * BALL.vx**2]
UNKNOWN += [P.x, P.k * BALL.x, 1 / mb.t * P.k, ca.SX(3.0), ca.sin(ROD.theta), ROD.theta * 180 / ca.pi]
UNKNOWN += [REACTION * ca.cos(ROD.theta), ROD.omega * ca.cos(ROD.theta)]


@pytest.mark.parametrize("expression, unit", [*KNOWN, *((e, "") for e in UNKNOWN)], ids=lambda value: str(value)[:30])
def test_units_that_follow_and_blank_where_nothing_is_known(expression, unit):
    assert units_of(SYSTEM, ca.SX(expression)) == (unit,)


def test_all_outputs_of_a_scene_together():
    outputs = {str(i): expression for i, (expression, _) in enumerate(KNOWN)}
    scene = mb.Scene(SYSTEM, outputs=outputs, start={"ball.x": 0.3, "ball.y": 0.0, "ball.z": 0.1})
    assert units_of(scene.system, scene.y) == tuple(unit for _, unit in KNOWN)
