"""Boxes from SSV files and FMUs with the uncertainty records of the Credibility library."""

import zipfile
from pathlib import Path

import pytest
from faults import refused

import symmb as mb
from symmb._errors import FileError

SSV = '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters>'


def write(path: Path, *parameters: tuple[str, str, str], head: str = "") -> Path:
    rows = [f'<ssv:Parameter name="{n}"><ssv:Real value="{v}" {u}/></ssv:Parameter>' for n, v, u in parameters]
    path.write_text(head + SSV + "".join(rows) + "</ssv:Parameters></ssv:ParameterSet>")
    return path


def test_records_of_ssv_give_intervals_in_the_units_of_the_parameters(tmp_path: Path) -> None:
    u = "data.arm.uncertainty"
    arm = [
        (f"{u}.lower", "0.19", 'unit="m"'),
        (f"{u}.upper", "0.22", 'unit="m"'),
        ("data.arm.value", "0.2", 'unit="m"'),
    ]
    load = [
        ("load.uncertainty.nominal", "-4", ""),
        ("load.uncertainty.relTol", "0.05", ""),
        ("load.uncertainty.absTol", "0.1", ""),
        ("other", "7", ""),
    ]
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
        "no nominal value": [(low, "1", ""), (up, "2", "")],
        "must be between lower": [(n, "1", ""), (low, "2", ""), (up, "0", "")],
        "needs lower and upper": [(n, "1", ""), (low, "0", "")],
        "must be at least 0": [(n, "1", ""), ("k.uncertainty.absTol", "-1", "")],
        "must be a number": [(n, "x", ""), (low, "0", ""), (up, "2", "")],
        "unknown parameter 'k'": [(n, "1", ""), (low, "0", ""), (up, "2", "")],
        "has no rows": [("k", "1", "")],
    }.items():
        refused(why, mb.Box.read, write(path, *rows), {"arm": 1.0})
    refused("entities are not supported", mb.Box.read, write(path, head='<!DOCTYPE a [<!ENTITY b "c">]>'))
    with pytest.raises(FileError, match="cannot be read"):
        mb.Box.read(tmp_path / "none.ssv")
    (tmp_path / "a.fmu").write_text("no archive")
    refused("is not an FMU", mb.Box.read, tmp_path / "a.fmu")


def test_names_and_values_of_the_published_drive_are_read(tmp_path: Path) -> None:
    """DataVariant001 of DLR's SimpleControlledDriveNonlinear: Ja is 2 kg.m2 +- 5 %; the stiffness is a table."""
    u, unit = "data.Ja.uncertainty", 'unit="kg.m2"'
    rows = [("data.Ja.value", "2", unit), (f"{u}.nominal", "2", unit), (f"{u}.relTol", "0.05", "")]
    table = [("data.stiffness.table[1,1]", "0", ""), ("data.stiffness.uncertainty.relTol", "0.1", "")]
    box = mb.Box.read(write(tmp_path / "a.ssv", *rows, *table), mb.Parameters(Ja=(2, "kg m^2")))
    assert box.names == ("Ja",) and box["Ja"] == pytest.approx((1.9, 2.1))
