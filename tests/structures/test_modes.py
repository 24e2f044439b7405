"""The modal file and the checks of its arrays."""

from dataclasses import fields, replace

import numpy as np
import pytest
from faults import refused
from structures import frame

from symmb import Modes

MODES = frame().modes(clamped=0, count=3, damping=0.01)
ARRAYS = {field.name: getattr(MODES, field.name) for field in fields(MODES)}


@pytest.mark.parametrize("count", [0, 3])
def test_file_round_trip(tmp_path, count):
    modes = frame().modes(clamped=0, count=count)
    for name in ("frame.npz", "frame.json"):
        modes.save(tmp_path / name)
        again = Modes.load(tmp_path / name)
        for field in fields(modes):
            assert np.array_equal(getattr(again, field.name), getattr(modes, field.name))


def test_a_file_by_others_needs_arrays_and_layout_only(tmp_path):
    np.savez(tmp_path / "own.npz", layout="symmb modes 1", **ARRAYS)
    assert Modes.load(tmp_path / "own.npz").frequencies == pytest.approx(MODES.frequencies)


def test_the_nearest_node_is_found_and_values_cannot_be_changed():
    assert MODES.nearest(*(MODES.positions[7] + 1e-3)) == 7
    refused("read-only", MODES.J0.fill, 1.0, error=ValueError)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"S": np.zeros((3, 2))}, r"S must be an array \(3, 3\), got the shape \(3, 2\)"),
        ({"shapes": MODES.shapes[1:]}, r"shapes must be an array \(13, 3, 3\), got the shape \(12, 3, 3\)"),
        ({"stiffness": np.array([0.0, 1, 2])}, "stiffness must be above 0, got 0. Remove rigid modes"),
        ({"damping": np.array([-1.0, 1, 2])}, "damping must not be negative, got -1"),
        ({"mass": 0.0}, "mass must be above 0, got 0"),
        ({"J0": np.triu(np.ones((3, 3)))}, "J0 must be symmetric"),
        ({"J2": MODES.J2 + np.arange(3.0)[:, None, None, None] * np.eye(3)}, "J2 must be symmetric"),
        ({"center": [0.0, np.nan, 0.0]}, "center must be finite"),
    ],
)
def test_wrong_arrays(change, message):
    refused(message, replace, MODES, **change)


LAYOUT = {"layout": "symmb modes 1"}
FILES = {
    "no layout": (ARRAYS, "layout is missing"),
    "another layout": (ARRAYS | {"layout": "symmb modes 0"}, "layout must be 'symmb modes 1', got 'symmb modes 0'"),
    "names": (LAYOUT | {"mass": 1.0, "extra": 2.0}, r"missing arrays: \['G0', .*\]; unknown arrays: \['extra'\]\. The"),
    "shape": (ARRAYS | LAYOUT | {"J0": np.eye(2)}, r"J0 must be an array of the shape \(3, 3\)"),
}


@pytest.mark.parametrize("kind", FILES)
def test_wrong_files(tmp_path, kind):
    content, message = FILES[kind]
    np.savez(tmp_path / "wrong.npz", **content)
    refused(message, Modes.load, tmp_path / "wrong.npz")


def test_a_file_that_is_no_archive(tmp_path):
    (tmp_path / "text.npz").write_text("modes", encoding="utf-8")
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    for name in ("text.npz", "array.npz"):
        refused("does not hold saved Modes", Modes.load, tmp_path / name)
    refused(None, Modes.load, tmp_path / "none.npz", error=FileNotFoundError)
