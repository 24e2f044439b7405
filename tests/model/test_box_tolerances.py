"""Boxes from tolerances of drawings and tables, and from records of uncertainty."""

import copy
import math
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from faults import refused, told_in_a_line

import symmb as mb
from symmb import Box, Parameters
from symmb._errors import FileError
from symmb.equations.model.iso_grades import sizes_of_grade

PUBLISHED = {  # lower and upper deviation [um]
    "40 H7": (0, 25), "40 g6": (-25, -9), "40 K7": (-18, 7), "40 P7": (-42, -17), "25 js6": (-6.5, 6.5),
    "25 p6": (22, 35), "50 n6": (17, 33), "30 f7": (-41, -20), "100 h6": (-22, 0), "20 k6": (2, 15),
    "60 s6": (53, 72), "16 H8": (0, 27), "10 E9": (25, 61), "300 M6": (-41, -9), "8 D10": (40, 98),
    "40 N7": (-33, -8), "40 M7": (-25, 0), "2 K7": (-10, 0), "40 K8": (-27, 12), "40 N9": (-62, 0),
    "110 c11": (-400, -180), "400 r6": (114, 150), "500 H6": (0, 40), "3 H7": (0, 10), "3.1 H7": (0, 12),
    "120 ISO 2768-m": (-300, 300), "5 2768 fH": (-50, 50), "1500 ISO 2768-c": (-3000, 3000),
}  # fmt: skip


@pytest.mark.parametrize("text", PUBLISHED)
def test_deviations_are_those_of_the_standards(text):
    size, lower, upper = sizes_of_grade(text)
    assert 1e3 * np.array([lower - size, upper - size]) == pytest.approx(PUBLISHED[text], abs=1e-6)


def test_zones_follow_the_standard_s_formulas_up_to_their_rounding():
    """ISO 286-1, annex: IT6 to IT16 are 10 i to 1000 i with i = 0.45 D^(1/3) + 0.001 D; shafts by powers of D."""
    ends = [3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500]
    factors = dict(zip(range(6, 17), (10, 16, 25, 40, 64, 100, 160, 250, 400, 640, 1000), strict=True))
    shafts = {"d": (16, 0.44), "e": (11, 0.41), "f": (5.5, 0.41), "g": (2.5, 0.34), "n": (-5, 0.34)}
    for begin, end in zip([1, *ends], ends, strict=False):
        D = np.sqrt(begin * end)
        for grade, factor in factors.items():
            _, lower, upper = sizes_of_grade(f"{end} h{grade}")
            exact = factor * (0.45 * D ** (1 / 3) + 0.001 * D)
            assert 1e3 * (upper - lower) == pytest.approx(exact, rel=0.15 if end > 3 else 0.4)
        for letter, (factor, power) in shafts.items():
            size, lower, upper = sizes_of_grade(f"{end} {letter}7")
            near = size - upper if factor > 0 else size - lower
            assert 1e3 * near == pytest.approx(factor * D**power, rel=0.1 if end > 3 else 0.35, abs=1)


@pytest.mark.parametrize(("hole", "shaft"), [("H7", "p6"), ("H8", "f7"), ("H6", "k5"), ("H7", "s6")])
@pytest.mark.parametrize("size", [5, 16, 45, 75, 110, 220])
def test_fits_with_exchanged_letters_are_as_tight(hole, shaft, size):
    """A hole H with a shaft p fits as a hole P with a shaft h."""

    def play(a, b):
        (_, *hole), (_, *shaft) = (sizes_of_grade(f"{size} {text}") for text in (a, b))
        return hole[0] - shaft[1], hole[1] - shaft[0]

    assert play(hole, shaft) == pytest.approx(play(shaft[0].upper() + hole[1:], "h" + shaft[1:]), abs=1e-9)


def test_tolerances_of_every_kind_become_intervals():
    p = mb.Parameters(crank=0.05, rocker=-2.0, pin=0.01, bore=0.04, hub=40.0, fixed=1.0)
    box = mb.Box.plus_minus(p, crank=5e-5, rocker="1%", pin=(-1e-5, 3e-5), bore="40 H7", hub="40 H7", fixed=0)
    exact = [(0.04995, 0.05005), (-2.02, -1.98), (0.00999, 0.01003), (0.04, 0.040025), (40, 40.025), (1, 1)]
    np.testing.assert_allclose(box.bounds, exact, rtol=1e-12)


@pytest.mark.parametrize(
    ("tolerance", "why"),
    [
        (-1e-5, "at least 0"), ((1e-5, -1e-5), "pair"), ((1, 2, 3), "pair"), (None, "pair"), (np.nan, "pair"),
        ("-1%", "percentage"), ("100%", "percentage"), ("x%", "percentage"), ("H7", "is not a tolerance"),
        ("40 H17", "IT1 to IT16"), ("600 H7", "up to 500"), ("40 Q7", "letters"), ("40 K9", "K up to the grade K8"),
        ("40 2768-x", "f, m, c and v"),
        ("50 H7", "0.05 .in m. or 50 .in mm."), (True, "pair"), ("0 H7", "the size must be above 0"),
        ("2 2768-v", "class v .* above 3 to 4000"),
        ("3000 ISO 2768-f", "class f .* from 0.5 to 2000"), ("0.4 ISO 2768-m", "class m .* from 0.5 to 4000"),
        ("5000 ISO 2768-c", "from 0.5 to 4000"), ("1_0%", "percentage"),
        ("+1/-2 %", "is not a percentage. Write .1%. or .±1%.; both mean"),
        ("40 ±x", "'40 ±x' of 'bore' is not a tolerance. Write a size with its deviations"), ("40 ±0,1", "Use a point"),
        ("40 0.1/0.2", "is not a tolerance"), ("40 +0.1", "is not a tolerance"), ("400/-0.2", "is not a tolerance"),
        ("40 ±-0.1", "is not a tolerance"), ("40 ±100%", "percentage '40 ±100%'"), ("41 ±0.1",
            "0.041 .in m. or 41 .in mm."),
        ("0 ±0.1", "the unit of deviations from 0 may be m or mm"),
        ("±0.1", "in the unit of the parameter or in mm. Write the number 0.1"), ("±.1", "Write the number 0.1"),
        (".1", "Write the number 0.1"), ("+.1/-2e-1", r"Write the pair of numbers .-0.2, 0.1. in the unit"),
        ("40 +1e-1", "is not a tolerance"), ("40 ±1e999", "is not a finite number"),
    ],
)  # fmt: skip
def test_what_is_no_tolerance_is_told(tolerance, why):
    with told_in_a_line(why):
        mb.Box.plus_minus({"bore": 0.04}, bore=tolerance)


@pytest.mark.parametrize("text", ["120 mm", "12 cm", "0.12 m"])
def test_a_nominal_value_in_the_place_of_a_tolerance_is_refused(text):
    p = mb.Parameters(arm=(120, "mm"))
    with told_in_a_line("is the nominal value of 'arm'. Write a tolerance"):
        mb.Box.plus_minus(p, arm=text)
    assert mb.Box.plus_minus(p, arm=f"±{text}").lower == pytest.approx([0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    [
        ("40 ±0.1", 39.9, 40.1), ("40±.1", 39.9, 40.1), ("40 +.1/-.2", 39.8, 40.1), ("40±1e-1", 39.9, 40.1),
        ("4E1 ± 1E-1", 39.9, 40.1), ("40 +1e-1/-2e-1", 39.8, 40.1), ("40 ±1e0%", 39.6, 40.4),
        ("40 +/- 0.1", 39.9, 40.1), (" 40 +-0.1 ", 39.9, 40.1),
        ("40 ± 1%", 39.6, 40.4), ("40 ±1 %", 39.6, 40.4), ("40 +0.1/-0.2", 39.8, 40.1), ("40 +0.1 / -0.2", 39.8, 40.1),
        ("40 -0.2/+0.1", 39.8, 40.1), ("40 +0.1 -0.2", 39.8, 40.1), ("40 +0.3/+0.1", 40.1, 40.3),
        ("40 0/-0.2", 39.8, 40), ("40 +0.1/0", 40, 40.1), ("40-0.1/-0.3", 39.7, 39.9), ("40.0 + 0.1/−0.2", 39.8, 40.1),
    ],
)  # fmt: skip
@pytest.mark.parametrize("unit", [1, 1e-3])
def test_deviations_of_drawings(tmp_path, text, lower, upper, unit):
    box = mb.Box.plus_minus({"bore": 40 * unit}, bore=text)
    assert box["bore"] == pytest.approx((lower * unit, upper * unit), rel=1e-12)
    (tmp_path / "a.csv").write_text(f"name,nominal,tolerance\nbore,{40 * unit},{text}\n", encoding="utf-8")
    assert mb.Box.read(tmp_path / "a.csv") == box


def test_signs_of_diameters_and_angles():
    """h11 of 140 mm is -0.25 mm; 30 degrees are pi / 6."""
    p = mb.Parameters(a=0.14, b=0.14, c=140.0, deg=30.0, rad=np.pi / 6)
    box = mb.Box.plus_minus(p, a="Ø140 h11", b="⌀140 ±0.5", c="140 iso 2768 m", deg="30° ±0.5°", rad="30° +1°/-0.5°")
    rad = np.pi / 6 * np.array([59, 62]) / 60
    exact = [(0.13975, 0.14), (0.1395, 0.1405), (139.5, 140.5), (29.5, 30.5), rad]
    np.testing.assert_allclose(box.bounds, exact, rtol=1e-12)
    refused(r"must be 0\.52\d* \(in rad\) or 30 \(in deg\)", mb.Box.plus_minus, p, a="30° ±0.5°")
    for grade in ("30° ISO 2768-m", "30° H7"):
        refused("only lengths have tolerance grades", mb.Box.plus_minus, p, deg=grade)
    refused(r"For a value below 0, write '-140 ±0\.5'", mb.Box.plus_minus, mb.Parameters(x=-0.14), x="140 ISO 2768-m")


def test_negative_sizes_have_deviations_and_grades_are_no_exponents():
    assert mb.Box.plus_minus({"pin": 40.0}, pin="40e7") == mb.Box.plus_minus({"pin": 40.0}, pin="40 e7")
    assert mb.Box.plus_minus({"angle": -30.0}, angle="-30 +1/-2")["angle"] == (-32, -29)


CSV = """name,nominal,plus,minus,tolerance
crank,0.05,5e-5,,
pin,0.01,3e-5,1e-5,

bore,0.04,,,40 H7
rocker,0.2,,,1%
"""
TOML = """crank = {nominal = 0.05, plus = 5e-5}
pin = {nominal = 0.01, plus = 3e-5, minus = 1e-5}
bore = {nominal = 0.04, tolerance = "40 H7"}
[rocker]
nominal = 0.2
tolerance = "1%"
"""


@pytest.mark.parametrize(("name", "text"), [("a.csv", CSV), ("a.CSV", "\ufeff" + CSV), ("a.toml", TOML)])
def test_tables_of_tolerances_are_read(tmp_path, name, text):
    (tmp_path / name).write_text(text, encoding="utf-8")
    box = mb.Box.read(tmp_path / name)
    assert box.names == ("crank", "pin", "bore", "rocker")
    exact = [(0.04995, 0.05005), (0.00999, 0.01003), (0.04, 0.040025), (0.198, 0.202)]
    np.testing.assert_allclose(box.bounds, exact, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no rows"), ("name,nominal,plus\n", "no rows"), ("nominal,plus\n1,2\n", "name"),
        ("name,nominal,plus\na,1,2\na,1,2\n", "twice"), ("name,nominal,plus\na,one,2\n", "number"),
        ("name,nominal,plus\na,1\n", "needs plus"), ("name,nominal,plus,minus\na,1,2,-1\n", "one side of"),
        ("name,nominal,pls\na,1,2\n", "Did you mean 'plus'"), ("name,nominal,plus\na,1,2,3\n", "cells"),
        ("name,nominal,plus,tolerance\na,1,2,1%\n", "Remove one of"), ("name,nominal,plus\na,1,1e400\n", "number"),
        ("name,nominal,plus,plus\na,1,2,3\n", "'plus' appears twice"), ("name,nominal,plus\na,1_0,2\n", "number"),
        ("name;nominal;plus\na;1;2\n", "a.csv: the cells are separated by semicolons. Separate them by commas"),
        ("name\tnominal\tplus\na\t1\t2\n", "by tabs. Separate"), ("name,nominal,plus\na,1,2,3\n", "a.csv: a row has"),
        ("# of drawing 7\nname,nominal,plus\na,1,2\n", "Remove the line '# of drawing 7'"),
    ],
)  # fmt: skip
def test_damaged_tables_are_told(tmp_path, text, why):
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    refused(why, mb.Box.read, tmp_path / "a.csv")


def test_nominal_values_of_a_table_are_those_of_the_model(tmp_path):
    (tmp_path / "a.csv").write_text("name,nominal,plus,minus\nhandle,0.041,1e-4,1e-4\n", encoding="utf-8")
    assert mb.Box.read(tmp_path / "a.csv", mb.Parameters(handle=0.041 * (1 + 1e-10), k=1.0)).names == ("handle",)
    for nominal, why in (
        ({"handle": 0.04}, r"a.csv: the nominal value of 'handle' is 0.041 in the table, but 0.04 in the model"),
        ({"handel": 0.041}, "unknown parameter 'handle'. Did you mean 'handel'"),
        ({"handle": "b"}, "parameters must be nominal values by name"), (3.0, "parameters must be nominal values"),
    ):  # fmt: skip
        refused(why, mb.Box.read, tmp_path / "a.csv", nominal)
    (tmp_path / "a.csv").write_text("name,nominal,plus\na,0,1\n", encoding="utf-8")
    assert mb.Box.read(tmp_path / "a.csv", {"a": 0.0}).bounds == ((-1.0, 1.0),)


def test_other_files_are_told(tmp_path):
    (tmp_path / "a.toml").write_text("a = 3\n")
    (tmp_path / "b.toml").write_text("a = \n")
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe\x00")
    told = {"a.toml": "must be a table", "b.toml": "not a table", "c.csv": "not a table", "d.xls": "ssv or .fmu"}
    for name, why in told.items():
        refused(why, mb.Box.read, tmp_path / name)
    refused("cannot be read", mb.Box.read, tmp_path / "none.csv", error=FileError)


def test_boxes_are_joined():
    a, b = mb.Box(k=(1, 2), m=(0, 1)), mb.Box(m=(0, 1), c=(3, 4))
    assert (a | b).names == ("k", "m", "c")
    refused("in the other", lambda: a | mb.Box(m=(0, 2)))


SSV = '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters>'


PARAMETER = '<ssv:Parameter name="{}"><ssv:Real value="{}" {}/></ssv:Parameter>'


def write(path: Path, *parameters: str, head: str = "") -> Path:
    rows = [PARAMETER.format(n, v, *(f'unit="{u}"' for u in unit), "") for n, v, *unit in map(str.split, parameters)]
    path.write_text(head + SSV + "".join(rows) + "</ssv:Parameters></ssv:ParameterSet>")
    return path


def test_records_of_ssv_give_intervals_in_the_units_of_the_parameters(tmp_path: Path) -> None:
    arm = "data.arm.uncertainty.lower 0.19 m", "data.arm.uncertainty.upper 0.22 m", "data.arm.value 0.2 m"
    load = *(f"load.uncertainty.{row}" for row in ("nominal -4", "relTol 0.05", "absTol 0.1")), "other 7"
    box = mb.Box.read(write(tmp_path / "a.ssv", *arm, *load), mb.Parameters(arm=(200, "mm"), load=-4.0))
    assert box["arm"] == pytest.approx((190, 220)) and box["load"] == pytest.approx((-4.2, -3.8))


@pytest.mark.parametrize(
    "variable",
    ['<ScalarVariable name="k.uncertainty.{}"><Real start="{}"/></ScalarVariable>',
     '<Float64 name="k.uncertainty.{}" start="{}"/>'],
)  # fmt: skip
def test_fmus_of_both_versions_are_read(tmp_path: Path, variable: str) -> None:
    rows = variable.format("nominal", "200") + variable.format("relTol", "0.05")
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as archive:
        text = f"<fmiModelDescription><ModelVariables>{rows}</ModelVariables></fmiModelDescription>"
        archive.writestr("modelDescription.xml", text)
    assert mb.Box.read(tmp_path / "a.fmu")["k"] == (190, 210)


def test_wrong_files_are_refused(tmp_path: Path) -> None:
    path, n, low, up = tmp_path / "a.ssv", *(f"k.uncertainty.{f}" for f in ("nominal", "lower", "upper"))
    for why, rows in {
        "no nominal value": [f"{low} 1", f"{up} 2"],
        "must be between lower": [f"{n} 1", f"{low} 2", f"{up} 0"],
        "needs lower and upper": [f"{n} 1", f"{low} 0"],
        "must be at least 0": [f"{n} 1", "k.uncertainty.absTol -1"],
        "must be a number": [f"{n} x", f"{low} 0", f"{up} 2"],
        "unknown parameter 'k'": [f"{n} 1", f"{low} 0", f"{up} 2"],
        "has no rows": ["k 1"],
    }.items():
        refused(why, mb.Box.read, write(path, *rows), {"arm": 1.0})
    refused("entities are not supported", mb.Box.read, write(path, head='<!DOCTYPE a [<!ENTITY b "c">]>'))
    refused("cannot be read", mb.Box.read, tmp_path / "none.ssv", error=FileError)
    (tmp_path / "a.fmu").write_text("no archive")
    refused("is not an FMU", mb.Box.read, tmp_path / "a.fmu")


def test_names_and_values_of_the_published_drive_are_read(tmp_path: Path) -> None:
    """DataVariant001 of DLR's SimpleControlledDriveNonlinear: Ja is 2 kg.m2 +- 5 %; the stiffness is a table."""
    rows = "data.Ja.value 2 kg.m2", "data.Ja.uncertainty.nominal 2 kg.m2", "data.Ja.uncertainty.relTol 0.05"
    table = "data.stiffness.table[1,1] 0", "data.stiffness.uncertainty.relTol 0.1"
    box = mb.Box.read(write(tmp_path / "a.ssv", *rows, *table), mb.Parameters(Ja=(2, "kg m^2")))
    assert box.names == ("Ja",) and box["Ja"] == pytest.approx((1.9, 2.1))


# Box: declaration, faults, the map to the unit box.


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box(), "at least one interval"),
        (lambda: Box(a=(2, 1)), "'a' has lower 2.0 above upper 1.0"),
        (lambda: Box(a=(0, float("nan"))), "'a' must be finite"),
        (lambda: Box(a=(0, float("inf"))), "'a' must be finite"),
        (lambda: Box(a=1.0), "'a' must be a pair"),
        (lambda: Box(a=(1, 2, 3)), "'a' must be a pair"),
        (lambda: Box.around({"a": 0.0}, 0.1), "nominal value of 'a' is 0"),
        (lambda: Box.around({"alpha": 1.0}, 0.1, ["alpa"]), "unknown parameter 'alpa'.*'alpha'"),
        (lambda: Box.around({"a": 1.0}, -0.1), "spread must be above 0 and below 1"),
        (lambda: Box.around({"a": 1.0}, float("nan")), "spread must be above 0 and below 1"),
        (lambda: Box.around({"a": 1.0}, 1.0), r"spread must be above 0.*got 1\.0.*Box\(name=\(lower, upper\)\)"),
    ],
)
def test_faults(make, message):
    refused(message, make)


def test_around():
    box = Box.around({"a": 2.0, "b": -1.0, "c": 0.0}, 0.1, names=["b", "a"])
    assert box.names == ("b", "a")
    np.testing.assert_allclose(box.bounds, [(-1.1, -0.9), (1.8, 2.2)])


def test_tolerances_in_percent_are_known():
    parameters = Parameters(k=(2.0, "N/mm"), l=(40.0, "mm"), m=1.0)
    box = Box.plus_minus(parameters, k="10%", l="0.5 mm") | Box(m="1 kg ±2%")
    assert box.percents == {"k", "m"}
    rest = box.without("k")
    assert rest is not None and rest.percents == {"m"}
    assert Box.around(parameters, 0.1).with_units({"k": "N/m", "l": "m"}).percents == {"k", "l", "m"}
    assert Box(k=(1.8, 2.2)) == Box.around({"k": 2.0}, 0.1) and not Box(k=(1.8, 2.2)).percents


def test_unit_box_and_back():
    box = Box(a=(0.1, 0.7), b=(-3, 5), fixed=(2, 2))
    unit = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    unit[:, 2] = 0
    np.testing.assert_allclose(box.to_unit(box.from_unit(unit)), unit, atol=1e-14)
    np.testing.assert_array_equal(box.from_unit([[-1, -1, -1], [1, 1, 1]]), [box.lower, box.upper])


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("way", ["to_unit", "from_unit"])
def test_points_that_are_not_finite_are_refused(way, value):
    refused("must be finite numbers", getattr(Box(a=(0.1, 0.7), b=(-3, 5)), way), [[0.2, value]])


def test_equal_by_value_and_picklable():
    assert Box(a=(0, 1)) == Box(a=(0.0, 1.0)) != Box(a=(0, 2))
    assert pickle.loads(pickle.dumps(Box(a=(0, 1)))) == Box(a=(0, 1))
    assert repr(Box(a=(0, 1), b=(0.95, 1.05))) == "Box(a=(0, 1), b=(0.95, 1.05))"


def test_constraints_are_pickled_by_name_and_lambdas_are_told():
    named = Box(a=(0, 1), constraints=[math.sin])
    assert pickle.loads(pickle.dumps(named)) == named
    own = Box(a=(0, 1), constraints=[lambda p: p.a < 0.5])
    refused("constraint <lambda> cannot be pickled. Use functions of a module", pickle.dumps, own)
    assert copy.deepcopy(own) == own == copy.copy(own)


def test_intervals_by_name():
    box = Box(l1=(0.95, 1.05), m=(2.0, 4.0))
    assert box["m"] == (2.0, 4.0) and "l1" in box and "q" not in box
    assert [*box] == list(box) == list(box.keys()) == np.array(box).tolist() == ["l1", "m"]
    first, second = box
    assert (first, second, len(box)) == ("l1", "m", 2)
    assert dict(box) == {"l1": (0.95, 1.05), "m": (2.0, 4.0)} and Box(**box) == box


@pytest.mark.parametrize("name", ["l2", 0, slice(None), None, np.zeros(2)], ids=repr)
def test_unknown_interval_is_told(name):
    box = Box(l1=(0.95, 1.05), m=(2.0, 4.0))
    refused(r"Box: no interval of .*\. (Did you mean 'l1'\?|Known are: l1, m\.)", lambda: box[name])


@pytest.mark.parametrize("values", [range(10**9), range(10**30), set(range(10_001))], ids=["many", "more", "set"])
def test_choices_of_too_many_values_are_refused_at_once(values):
    refused("'k' has more than 10000 values", mb.Box, k=values)
