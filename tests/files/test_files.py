"""Files of results: what is written is read, damage is told, and a file is replaced whole or not at all."""

import json
import os
import random
import re
import stat
import tomllib
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import saving
from black_boxes import reloaded
from faults import refused, told_in_a_line
from machines import spring_mass
from mechanisms import double_pendulum
from oscillators import BOX, Wave

import symmb as mb
from symmb.results.files import formats, replacement

BEAM = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), mb.Material(2e11, 7800.0, nu=0.3), elements=3)
SPRUNG, T = spring_mass(stiffness=40.0, damping=0.3), np.linspace(0.0, 1.0, 6)
OUTPUTS = {"x": SPRUNG.ball.x, "force": SPRUNG.p.stiffness * SPRUNG.ball.x}
REST, SWING = mb.Scene(SPRUNG.system, outputs=OUTPUTS), SPRUNG.scene(OUTPUTS, T, {"ball.x": 0.1})
RESULTS = {
    "Trajectory": lambda: mb.simulate(double_pendulum(np.linspace(0.0, 0.1, 4))),
    "Bounds": lambda: mb.propagate(Wave(), mb.PolynomialChaos(order=3), BOX),
    "Comparison": lambda: mb.compare(Wave(), [mb.Vertex(), mb.PolynomialChaos()], BOX),
    "Moments": lambda: result_of("Bounds").moments(),
    "Modes": lambda: mb.FiniteElements.beams(BEAM).modes(clamped=0, count=3),
    "Contributions": lambda: result_of("Bounds").contributions(),
    "LimitCheck": lambda: result_of("Tolerances").bounds.check({"x": (None, 1.1)}),
    "Tolerances": lambda: mb.tolerances(Wave(), {"x": (None, 1.2)}, BOX),
    "Sensitivities": lambda: mb.sensitivities(SWING),
    "Sweep": lambda: mb.sweep(SWING, {"stiffness": [30.0, 40.0], "damping": [0.1, 0.2, 0.3]}),
    "Calibration": lambda: mb.calibrate(SWING, {"x": 0.1 * np.cos(6.3 * T)}, ["stiffness", "damping"]),
    "ConsistentSet": lambda: result_of("Calibration").consistent("1%"),
    "Linearization": lambda: mb.linearize(REST, inputs=["stiffness"]),
    "RootLocus": lambda: mb.root_locus(REST, "damping", (0.1, 0.5), mb.Vertex(), mb.Box(stiffness=(38, 42)), count=3),
}
SUFFIXES = {suffix[1:]: form.source == "table" for suffix, form in formats.FORMATS.items()}
"""Of all formats, and whether they are tables, which hold two kinds of results."""
FORMATS = [(name, own) for name in RESULTS for own in SUFFIXES if name in ("Trajectory", "Bounds") or not SUFFIXES[own]]


NOT_IN_TABLES = (
    "inner failed expansion surrogate box x lam work drift position_drift velocity_drift energy energy_drift parameters"
    " statistics nominal_parameters seconds setup_seconds run_seconds"
).split()


@cache
def result_of(kind):
    return RESULTS[kind]()


def attributes(result):
    """Attributes of a result by name, without equations and what makes more runs."""
    names = ("scene", "simulator", "program", "_text", "run_examination", "attaining", "study", "origin", "bounds")
    return {name: value for name, value in vars(result).items() if name not in names}


def same(one, other):
    """Whether two values are equal, nan to nan."""
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return [*one] == [*other] and same([*one.values()], [*other.values()])
    if hasattr(one, "__dict__"):
        return same([*attributes(one).values()], [*attributes(other).values()])
    return one == other or (one != one and other != other)


@pytest.mark.parametrize(("kind", "suffix"), FORMATS)
def test_what_is_saved_is_loaded(tmp_path, kind, suffix):
    result, path = result_of(kind), tmp_path / f"result.{suffix}"
    again = reloaded(result, path)
    for name, value in attributes(again).items():
        if (suffix != "csv" or name not in NOT_IN_TABLES) and not isinstance(value, str | tuple):
            assert same(value, getattr(result, name)), name
    if suffix != "csv":
        assert str(again) == str(result) and again.__class__ is result.__class__
        assert kind != "Bounds" or (again.attaining is None and str(again.worst("x")) == str(result.worst("x")))
        second = tmp_path / f"second.{suffix}"
        again.save(second)
        assert suffix != "json" or second.read_text() == path.read_text()
    if suffix == "json" and kind != "Modes":
        without = {name: {"times", "outputs"} for name in ("Calibration", "ConsistentSet", "RootLocus", "Tolerances")}
        without |= {"Linearization": {"times"}, "LimitCheck": {"outputs"}}
        assert {"times", "outputs", "version"} - without.get(kind, set()) <= json.loads(path.read_text()).keys()


@pytest.mark.parametrize("suffix", ["npz", "json"])
def test_a_loaded_check_draws_the_same_picture(tmp_path, suffix):
    tolerances, path = result_of("Tolerances"), tmp_path / f"tolerances.{suffix}"
    again = reloaded(tolerances, path)
    pictures = [own.check.plot(legend=True) for own in (tolerances, again)]
    lines = [[line.get_xydata() for line in picture.axes[0].lines] for picture in pictures]
    assert same(*lines) and again.check["x"].high == 1.2 and again.check["x"].low == -np.inf
    assert same(again.bounds["x"], tolerances.bounds["x"]) and again.check["x"].row == tolerances.check["x"].row
    assert again.bounds.check({"x": (None, 1.1)}).kept is False


def test_a_loaded_run_knows_its_names_and_with_its_scene_any_expression(tmp_path):
    scene = double_pendulum(np.linspace(0.0, 0.1, 4))
    run = mb.simulate(scene)
    loaded = reloaded(run, tmp_path / "run.npz")
    for name in (*run.names, *run.state_names[0], *run.row_names):
        np.testing.assert_array_equal(loaded[name], run[name])
    assert loaded.q.shape == run.q.shape and loaded.v.shape == run.v.shape and loaded.s.shape == run.s.shape
    assert loaded.energy_drift == run.energy_drift
    refused(r"the file holds a result of Trajectory\.save", mb.Bounds.load, tmp_path / "run.npz")
    refused(r"Pass the scene: Trajectory\.load", loaded.reaction, "shoulder")
    whole = mb.Trajectory.load(tmp_path / "run.npz", scene)
    np.testing.assert_allclose(whole.reaction("elbow")[0], run.reaction("elbow")[0])
    refused("of another scene", mb.Trajectory.load, tmp_path / "run.npz", SWING)


@pytest.mark.parametrize(("kind", "suffix"), FORMATS)
def test_a_damaged_file_is_one_error(tmp_path, kind, suffix):
    """Cut, with changed bytes, and with values of another type or size: one error, or a result like the first."""
    result, path = result_of(kind), tmp_path / f"result.{suffix}"
    result.save(path)
    whole, choice = path.read_bytes(), random.Random(f"{kind} {suffix}")
    contents = [b"", b"\0" * 100, b"[" * 100_000, b'{"t": 1}', whole + whole]
    contents += [whole[: choice.randrange(len(whole))] for _ in range(15)]
    for _ in range(40):
        damaged = bytearray(whole)
        for _ in range(choice.choice((1, 5, 100))):
            damaged[choice.randrange(len(damaged))] = choice.randrange(256)
        contents.append(bytes(damaged))
    if suffix == "json":
        contents += [json.dumps(changed).encode() for changed in changes(json.loads(whole), choice)]
    for content in contents:
        path.write_bytes(content)
        try:
            loaded = getattr(mb, kind).load(path)
        except mb.DeclarationError as error:
            assert str(path) in str(error) and len(str(error).splitlines()) == 1
        else:
            str(loaded), loaded.save(tmp_path / "again.json")
            assert suffix != "csv" or content.endswith((b"\r", b"\n"))


def changes(layout, choice):
    """Layouts in which one value, at any depth, is missing or of another kind."""
    for _ in range(60):
        changed = json.loads(json.dumps(layout))
        holder = changed
        while True:
            key = choice.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
            inner = holder[key]
            if not isinstance(inner, dict | list) or not inner or choice.random() < 0.3:
                break
            holder = inner
        holder[key] = choice.choice([None, "no", -1, 1e400, [], {}, [[]], [1, 2], {"a": 1}, True, [None], "nan"])
        yield changed


def change_archive(path, entry, value):
    """Write an archive again with another array, or with another entry beside its arrays."""
    with np.load(path) as archive:
        arrays = dict(archive)
    if entry in arrays:
        arrays[entry] = value
    else:
        arrays["about"] = np.array(json.dumps(json.loads(str(arrays["about"])) | {entry: value}))
    np.savez(path, **arrays)


@pytest.mark.parametrize("entry", ["lower", "upper", "t", "names", "estimate", "kind", "evaluations"])
def test_nonsense_is_refused(tmp_path, entry):
    column, path = np.ones((61, 1)), tmp_path / "bounds.npz"
    nonsense = {"lower": 9 * column, "upper": np.nan * column, "estimate": -column, "t": np.zeros(61)}
    nonsense |= {"names": ["x", "x"], "kind": "proved", "evaluations": -3}
    mb.propagate(Wave(), mb.PolynomialChaos(), BOX).save(path)
    change_archive(path, entry, nonsense[entry])
    refused(f"bounds.npz does not hold a result of Bounds.save: .*{entry}", mb.Bounds.load, path)


@pytest.mark.parametrize("kind", RESULTS)
def test_another_suffix_is_the_same_error_everywhere(tmp_path, kind):
    for action in (result_of(kind).save, getattr(mb, kind).load):
        long = tmp_path / f"{'result' * 250}.txt"  # of which the begin and the end are told
        refused(r"^The .* must end in \.npz or \.json.* here, got '.* \.\.\. .*\.txt'\.$", action, long)
    if hasattr(result_of(kind), "plot"):
        refused(r"file must end in \.png or .* got '.*\.qqq'", result_of(kind).plot, tmp_path / "picture.qqq")
    assert not list(tmp_path.iterdir())


def test_a_file_of_an_earlier_version(tmp_path):
    """Arrays without rows and columns stood for None, and failed runs were lists."""
    path, about = tmp_path / "bounds.npz", {"names": ["x"], "kind": "sampled", "method": "Vertex()", "evaluations": 4}
    about |= {"seconds": 0.1, "parameters": [], "failed": [[{"k": 1.0}, 0.5, "blew up"]]}
    arrays = dict.fromkeys(("estimate", "inner_lower", "inner_upper", "alpha", "coefficients"), np.empty((0, 0)))
    arrays |= {"t": np.zeros(1), "lower": np.zeros((1, 1)), "upper": np.ones((1, 1))}
    np.savez_compressed(path, about=np.array(json.dumps(about)), **arrays)
    bounds = mb.Bounds.load(path)
    assert bounds.estimate is bounds.inner is bounds.expansion is None
    assert bounds.failed[0].message == "blew up" and bounds.failed[0].parameters == {"k": 1.0}


# --- replacement ---------------------------------------------------------------------


def test_the_previous_file_stays_until_the_new_one_is_complete(tmp_path):
    path = tmp_path / "file"
    path.write_text("previous")
    with pytest.raises(KeyboardInterrupt), replacement(path) as file:
        file.write(b"half")
        raise KeyboardInterrupt
    assert path.read_text() == "previous" and list(tmp_path.iterdir()) == [path]
    with replacement(path) as file:
        file.write(b"new")
        assert path.read_text() == "previous"
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]
    missing = tmp_path / "no" / "file.npz"  # its folder is told by the name that was given
    refused(r"no/file\.npz", result_of("Bounds").save, missing, error=FileNotFoundError)


def test_links_and_permissions_stay(tmp_path):
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("previous")
    real.chmod(0o640)
    link.symlink_to(real)
    with replacement(link) as file:
        file.write(b"new")
    assert link.is_symlink() and real.read_text() == "new" and stat.S_IMODE(real.stat().st_mode) == 0o640
    old = os.umask(0o027)
    try:
        with replacement(tmp_path / "fresh") as file:
            file.write(b"new")
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "fresh").stat().st_mode) == 0o640


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_kill_or_a_full_disk_leaves_the_previous_file(suffix):
    choice = random.Random(suffix)
    assert saving.damaged(suffix, choice.uniform(0.0, 0.1), 0) == ""
    assert saving.damaged(suffix, 0.0, choice.randrange(1, saving.LARGEST)) == ""


@pytest.mark.parametrize("size", [10**7, 3 * 10**7])
def test_an_archive_that_becomes_far_more_than_it_is(size, tmp_path):
    path = tmp_path / "small.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("t.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (size,)})
        for _ in range(8 * size // 10**6):
            member.write(bytes(10**6))
    assert path.stat().st_size < 10**6
    refused(r"bytes, but [\d.]+e\+0\d bytes", mb.Bounds.load, path)


def test_what_the_readme_names_is_in_the_source_distribution():
    root = Path(__file__).parents[2]
    kept = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    for name in re.findall(r"`([\w./-]+\.md)`", (root / "README.md").read_text()):
        assert (root / name).is_file() and any(name == part or name.startswith(f"{part}/") for part in kept), name


@pytest.mark.parametrize("version", [99, 0, 2, "1", True, -1])
@pytest.mark.parametrize(("kind", "suffix"), [pair for pair in FORMATS if pair[1] in ("npz", "json")])
def test_files_of_another_version_are_refused(version, kind, suffix, tmp_path):
    path = tmp_path / f"result.{suffix}"
    result_of(kind).save(path)
    if suffix == "json":
        path.write_text(json.dumps(json.loads(path.read_text()) | {"version": version}))
    else:
        change_archive(path, "version", version)
    with told_in_a_line("version"):
        getattr(mb, kind).load(path)
