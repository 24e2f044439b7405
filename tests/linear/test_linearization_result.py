"""What a linearisation prints, and its files."""

import json

import numpy as np
import pytest
from faults import refused
from scipy.signal import lsim
from small_scenes import pushing_oscillator

import symmb as mb


def test_lines_tell_amplitudes_and_phases():
    lin = mb.linearize(pushing_oscillator())
    eigenvalue = -0.2 + 1j * np.sqrt(3.96)
    b = 2 * eigenvalue / (eigenvalue**2 + 9)  # of b over a, from b'' + 9 b = 2 a'
    assert lin.modes[0].text == f"a.x, b.y {abs(b):.2g} at {np.degrees(np.angle(b)):.0f} deg"
    assert lin.modes[1].text == "b.y"
    np.testing.assert_allclose(lin.damping, [0.1, 0.0], atol=1e-12)  # 0.2 over the modulus 2 of the eigenvalue
    assert "<td" in lin._repr_html_() and "b.y" in lin._repr_html_()


def test_state_spaces_of_scipy_and_of_control():
    lin = mb.linearize(pushing_oscillator(), inputs=["k"])
    t = np.linspace(0.0, 2.0, 11)
    start = np.zeros(len(lin.states))
    start[lin.states.index("b.y")] = 0.1
    np.testing.assert_allclose(lsim(lin.to_scipy(), 0 * t, t, start)[1][:, 1], 0.1 * np.cos(3 * t), atol=1e-10)
    pytest.importorskip("control")
    system = lin.to_control()
    assert system.output_labels == ["x", "y"] and system.input_labels == ["k"] and "a_vx" in system.state_labels
    np.testing.assert_array_equal(system.A, lin.A)
    for method in (mb.Linearization.to_scipy, mb.Linearization.to_control):
        refused(r"has no inputs. Pass inputs=\[...\] to linearize", method, mb.linearize(pushing_oscillator()))


def test_a_damaged_file(tmp_path):
    path = tmp_path / "lin.json"
    mb.linearize(pushing_oscillator()).save(path)
    entries = json.loads(path.read_text())
    path.write_text(json.dumps(entries | {"A": entries["A"][1:]}))
    refused(r"does not hold a result of Linearization.save: A must be an array", mb.Linearization.load, path)
    refused("json", mb.linearize(pushing_oscillator()).save, tmp_path / "lin.csv")
