"""`symmb linearize`: what it prints and writes, and its exit status."""

import json
import warnings

import numpy as np
import pytest

from symmb.show.cli.main import main

OSCILLATORS = """
import symmb as mb

def scene():
    p = mb.Parameters(k=4.0, c=0.4)
    a, b = (mb.Body(name, 1.0, pose=mb.Particle()) for name in "ab")
    springs = [
        mb.Force("on_a", a.point(0, 0, 0), (-p.k * a.x - p.c * a.vx, 0, 0)),
        mb.Force("on_b", b.point(0, 0, 0), (0, -9 * b.y, 0)),
    ]
    return mb.Scene(mb.System(a, b, *springs, parameters=p), {"b.y": 0.1}, [0.0, 1.0], {"x": a.x}, name="oscillators")
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "oscillators.py"
    path.write_text(OSCILLATORS.replace('{"b.y": 0.1}', "{}"))
    return str(path)


def test_prints_modes_and_writes_matrices(file, tmp_path, capsys):
    json_file = tmp_path / "l.json"
    assert main(["linearize", file, "--set", "k=16", "--json", str(json_file)]) == 0
    head, _, first, second = capsys.readouterr().out.splitlines()[:4]
    assert head == "oscillators: linearised at 0 s, 4 states, not asymptotically stable: 1 undamped oscillation"
    assert first.split() == ["1", "0.477465", "0", "b.y"]
    assert second.split() == ["2", "0.63662", "0.05", "a.x"]
    layout = json.loads(json_file.read_text())
    assert layout["parameters"] == {"k": 16.0, "c": 0.4} and layout["outputs"] == ["x"]
    A = np.array(layout["A"])
    values = np.array(layout["eigenvalues"]) @ [1, 1j]
    np.testing.assert_allclose(np.sort_complex(values), np.sort_complex(np.linalg.eigvals(A)), atol=1e-12)
    np.testing.assert_allclose(layout["modes"][1]["eigenvalue"], [-0.2, np.sqrt(16 - 0.04)], rtol=1e-12)
    assert layout["modes"][1]["shape"]["a.x"] == pytest.approx([1.0, 0.0]) and layout["doubts"] == []


def test_a_state_out_of_equilibrium_exits_with_3(tmp_path, capsys):
    path = tmp_path / "moving.py"
    path.write_text(OSCILLATORS.replace("-9 * b.y", "-9 * b.y**3"))
    with warnings.catch_warnings(action="always"):
        assert main(["linearize", str(path)]) == 3
    told = capsys.readouterr()
    assert "warning: The state is neither an equilibrium" in told.out
    assert "symmb linearize: linearize(oscillators): The state is neither" in told.err


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--set", "q=1"], "No parameter 'q'"),
        (["--set", "k"], "--set takes name=number"),
        (["--time", "0.5"], "one of the run's 2 output times, 0 to 1 s, got 0.5"),
        (["--json", "l.csv"], ".json"),
    ],
)
def test_refusals(file, options, text, capsys):
    assert main(["linearize", file, *options]) == 2
    told = capsys.readouterr()
    assert text in told.err and not told.out


def test_a_run_at_a_time(file, capsys):
    assert main(["linearize", file, "--time", "1"]) == 0
    assert capsys.readouterr().out.startswith("oscillators: linearised at 1 s")
