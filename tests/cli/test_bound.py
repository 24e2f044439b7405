"""The command `symmb bound`: bounds, limits and exit status."""

import json

import numpy as np
import pytest

import symmb as mb
from symmb.show.cli.main import main

SCENE = """
import numpy as np
import symmb as mb

p = mb.Parameters(speed=1.0, height=2.0)
ball = mb.Body("ball", 1.0, pose=mb.Particle())
scene = mb.Scene(
    mb.System(ball, parameters=p), {"ball.vx": p.speed, "ball.y": p.height}, np.linspace(0, 2, 5),
    {"x": ball.x, "y": ball.y}, box=mb.Box(speed=(0.9, 1.1)),
)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "roll.py").write_text(SCENE)
    (tmp_path / "t.csv").write_text("name,nominal,plus\nspeed,1.0,0.2\n")
    return tmp_path


@pytest.mark.parametrize(
    ("words", "status", "upper"),
    [
        ([], 0, 2.2), (["--limit", "x=:2.3", "y=1:3"], 0, 2.2), (["--limit", "x=:2.1"], 1, 2.2),
        (["--box", "speed=1:1.5"], 0, 3.0), (["--tolerances", "t.csv"], 0, 2.4),
        (["--tolerances", "t.csv", "--box", "height=1:4", "--limit", "y=:3.9"], 1, 2.4),
        (["--method", "vertex", "--limit", "x=:2.3"], 3, 2.2),
    ],
)  # fmt: skip
def test_bounds_and_limits(folder, capsys, words, status, upper):
    assert main(["bound", "roll.py", *words, "--json", "b.json", "--csv", "b.csv"]) == status
    text = capsys.readouterr().out
    assert text.startswith("Bounds by ") and ("Limits by " in text) == ("--limit" in words)
    assert json.loads((folder / "b.json").read_text())["upper"][-1][0] == pytest.approx(upper)
    assert np.genfromtxt(folder / "b.csv", delimiter=",", skip_header=1)[-1, 2] == pytest.approx(upper)


@pytest.mark.parametrize("words, fixed", [([], ""), (["--box", "speed=1:2"], ""), (["--box", "height=1:3"], "speed ")])
def test_parameters_that_an_option_fixes_are_told(folder, capsys, words, fixed):
    main(["bound", "roll.py", *words])
    told = f"{fixed}keep their nominal values, because --box and --tolerances replace the scene's box."
    assert (told in capsys.readouterr().out) == bool(fixed)


def test_limits_stand_in_the_file(folder):
    main(["bound", "roll.py", "--limit", "x=:2.3", "y=1:1.5", "--json", "b.json"])
    limits = json.loads((folder / "b.json").read_text())["limits"]
    assert [*limits] == ["x", "y"] and limits["y"]["result"] == "violated"
    assert limits["y"]["why"] == "The nominal run is beyond the limit."
    assert limits["x"] == {**limits["x"], "result": "satisfied", "time": 2.0, "low": None, "high": 2.3}
    assert limits["x"]["margin"] == pytest.approx(0.1) and limits["y"]["margin"] == pytest.approx(-0.5)
    assert mb.Bounds.load("b.json")["x"][1][-1] == pytest.approx(2.2)


def test_pictures_are_written(folder):
    assert main(["bound", "roll.py", "--limit", "x=:2.3", "--plot", "b.png", "--view", "b.svg"]) == 0
    assert (folder / "b.png").stat().st_size > 5000 and (folder / "b.svg").stat().st_size > 500


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--limit", "x"], "name=low:high"), (["--limit", "x=:"], "has no number"), (["--limit", "x=a:1"], "low:high"),
        (["--limit", "x=2:1"], "above"), (["--limit", "q=:1"], "no output 'q'"), (["--box", "speed=1:"], "both ends"),
        (["--box", "speed=1:2", "speed=1:2"], "twice"), (["--box", "sped=1:2"], ": Box: no parameter 'sped'. Did you"),
        (["--box", "speed=:"], "both ends"), (["--limit", "x=-inf:inf"], "must be finite"),
        (["--tolerances", "none.csv"], "cannot be read"), (["--method", "magic"], "magic"), (["--csv", "b.png"], "csv"),
    ],
)  # fmt: skip
def test_wrong_words_are_told_in_one_sentence(folder, capsys, words, why):
    assert main(["bound", "roll.py", *words]) == 2
    error = capsys.readouterr().err
    assert why in error and error.startswith("symmb bound: ") and error.count("\n") == 1


def test_limits_are_checked_before_the_study(folder, capsys, monkeypatch):
    monkeypatch.setattr(mb, "propagate", None)
    assert main(["bound", "roll.py", "--limit", "yy=:3"]) == 2
    assert capsys.readouterr().err == "symmb bound: --limit: no output 'yy'. Did you mean 'y'?\n"


def test_table_of_other_nominal_values_is_refused(folder, capsys):
    (folder / "t.csv").write_text("name,nominal,plus\nspeed,1.1,0.2\n")
    assert main(["bound", "roll.py", "--tolerances", "t.csv"]) == 2
    assert "the nominal value of 'speed' is 1.1 in the table, but 1 in the model" in capsys.readouterr().err


def test_a_scene_without_a_box_needs_one(folder, capsys):
    (folder / "roll.py").write_text(SCENE.replace(", box=mb.Box(speed=(0.9, 1.1))", ""))
    assert main(["bound", "roll.py"]) == 2 and "--box NAME=1:2" in capsys.readouterr().err


def test_numbers_with_units(folder, capsys):
    text = SCENE.replace("speed=1.0", 'speed=(1000, "mm/s")').replace('"x": ball.x', '"x": (ball.x, "cm")')
    (folder / "roll.py").write_text(text.replace("(0.9, 1.1)", '(0.9, 1.1, "m/s")'))
    assert main(["bound", "roll.py", "--box", "speed=1m/s:1500mm/s", "--limit", "x=:3.1m", "--json", "b.json"]) == 0
    bounds = mb.Bounds.load("b.json")
    assert bounds["x"][1][-1] == pytest.approx(300) and bounds.box == mb.Box(speed=(1000, 1500, "mm/s"))
    assert "speed = 1500 mm/s" in capsys.readouterr().out
    assert main(["simulate", "roll.py", "--set", "speed=2 m/s", "--csv", "run.csv"]) == 0
    assert np.genfromtxt(folder / "run.csv", delimiter=",", skip_header=1)[-1, 1] == pytest.approx(400)
    for words in ("speed=1:1.5m/s", "speed=1m/s:1.5"):
        assert main(["bound", "roll.py", "--box", words, "--limit", "x=2:3.1m", "--json", "b.json"]) == 1
        assert mb.Bounds.load("b.json").box == bounds.box
        assert "200 <= x <= 310 cm" in capsys.readouterr().out
    for words in (["--box", "speed=1kg:2kg"], ["--limit", "x=:3.1s"], ["--limit", "x=:3.1mmm"]):
        assert main(["bound", "roll.py", *words]) == 2
        assert "unit" in (error := capsys.readouterr().err) or "does not fit" in error
