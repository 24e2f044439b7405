"""Root loci against closed forms and published eigenvalues."""

import numpy as np
import pytest
from black_boxes import reloaded
from faults import refused
from machines import spring_mass
from matplotlib.figure import Figure
from small_scenes import two_masses

import symmb as mb
from models import bicycle


def oscillators() -> mb.Scene:
    """Two masses of 1 kg on springs and dampers that do not act on each other."""
    law = lambda p, a, b: ((-p.k1 * a.x - p.c1 * a.vx, 0, 0), (-p.k2 * b.x - p.c2 * b.vx, 0, 0))  # noqa: E731
    return two_masses(law, box=mb.Box(k1=(90.0, 110.0)), k1=100.0, c1=0.0, k2=104.0, c2=0.5)


def test_frequencies_cross_over_the_parameter():
    locus = mb.root_locus(oscillators(), "k2", (50.0, 150.0), mb.Vertex(), count=11)
    k2 = np.linspace(50.0, 150.0, 11)
    np.testing.assert_allclose(locus.values, k2)
    np.testing.assert_allclose(2 * np.pi * locus.frequencies, np.sqrt(np.stack([k2, 100 + 0 * k2], 1)), rtol=1e-12)
    np.testing.assert_allclose(locus.damping, np.stack([0.25 / np.sqrt(k2), 0 * k2], 1), atol=1e-14)
    assert len(locus.remarks) == 1 and locus.remarks[0].startswith("f1 and f2 cross between k2 = ")
    lower, upper = (2 * np.pi * end for end in locus.bands["f"])
    np.testing.assert_allclose(lower, np.sqrt(np.stack([k2, 90 + 0 * k2], 1)), rtol=1e-12)
    np.testing.assert_allclose(upper, np.sqrt(np.stack([k2, 110 + 0 * k2], 1)), rtol=1e-12)
    assert locus.evaluations == 2 and "bands over Box(k1=(90, 110)) by Vertex()" in str(locus)


def test_an_oscillation_that_ends_and_one_that_begins():
    """c1 passes the critical damping 2 sqrt(k1), from 19 on somewhere in the box; c1 < 0 is unstable."""
    locus = mb.root_locus(oscillators(), "c1", (-24.0, 24.0), mb.Vertex(), count=25)
    c1 = np.linspace(-24.0, 24.0, 25)
    (late,) = [k for k in range(locus.modes.shape[1]) if np.isnan(locus.modes[0, k])]
    np.testing.assert_array_equal(np.isnan(locus.modes[:, late]), np.abs(c1) >= 20)
    inside = np.abs(c1) < 20
    np.testing.assert_allclose(locus.damping[inside, late], c1[inside] / 20, atol=1e-12)
    least, most = (end[:, late] for end in locus.bands["zeta"])
    known = np.abs(c1) < 2 * np.sqrt(90)
    np.testing.assert_array_equal(~np.isnan(least), known)
    ends = np.sort(c1[known, None] / (2 * np.sqrt([90, 110])), axis=1)
    np.testing.assert_allclose(np.stack([least, most], 1)[known], ends, atol=1e-12)


def test_eigenvalues_of_the_bicycle():
    """Meijaard et al. (2007), table 2: eigenvalues at 0 and 5 m/s; weave begins at 0.684 m/s."""
    locus = mb.root_locus(bicycle.scene(), "v", (0.0, 10.0), box=mb.Box(v=(0.0, 10.0)), count=21)
    assert not locus.bands and locus.box is None  # the box names the parameter alone
    at_rest = locus.eigenvalues[0][locus.eigenvalues[0] != 0]
    np.testing.assert_allclose(np.sort(at_rest.real)[:2], [-5.53094371765393, -3.13164324790656], rtol=1e-9)
    assert np.isnan(locus.modes[:2]).all() and not np.isnan(locus.modes[2:]).any()
    assert locus.modes[10, 0] == pytest.approx(-0.77534188219585 + 4.46486771378823j, rel=1e-9)


def test_pictures_and_files(tmp_path):
    locus = mb.root_locus(oscillators(), "c1", (-24.0, 24.0), mb.Vertex(), count=9)
    assert isinstance(locus.plot(tmp_path / "locus.png"), Figure) and "<table" in locus._repr_html_()
    assert (tmp_path / "locus.png").read_bytes().startswith(b"\x89PNG")
    axes = Figure().subplots(1, 2)
    assert locus.plot(ax=list(axes)) is axes[0].figure and axes[1].get_ylabel() == "frequency [Hz]"
    refused("there are three diagrams, got 4 axes", locus.plot, ax=list(Figure().subplots(1, 4)))
    reloaded(locus, tmp_path / "locus.json").plot()
    refused(r"does not hold a result of Linearization.save", mb.Linearization.load, tmp_path / "locus.json")


def test_faults():
    scene = oscillators()
    refused(r"root_locus: no parameter 'k3'", mb.root_locus, scene, "k3", (0, 1))
    refused("range must be two numbers", mb.root_locus, scene, "k1", (0, float("nan")))
    refused("lower end of the range must be below", mb.root_locus, scene, "k1", (2, 1))
    for study in (mb.root_locus, mb.critical):
        refused("wider than the largest number", study, scene, "c1", (-1.7e308, 1.7e308))
    refused("count must be an integer of at least 2", mb.root_locus, scene, "k1", (1, 2), count=1)
    refused("Expected a Scene, got System", mb.root_locus, scene.system, "k1", (1, 2))
    refused("the box has 'q', which is not a parameter", mb.root_locus, scene, "k1", (1, 2), box=mb.Box(q=(1, 2)))
    refused("root_locus: box: expected a Box", mb.root_locus, scene, "k1", (1, 2), box={"k2": (1, 2)})


def test_scenes_without_oscillations():
    p = mb.Parameters(rate=2.0)
    decay = mb.Scene(mb.System(mb.State("z", rate=lambda z: -p.rate * z), parameters=p), box=mb.Box(rate=(1.0, 3.0)))
    locus = mb.root_locus(decay, "rate", (1.0, 3.0), count=3)
    np.testing.assert_allclose(locus.eigenvalues, [[-1], [-2], [-3]])
    assert str(locus) == "scene: 0 oscillations over 3 values, rate = 1 to 3"
    assert isinstance(locus.plot(), Figure)
    refused("scene has no oscillation", mb.ModalSimulator, decay)


@pytest.mark.parametrize(
    ("name", "given", "why"),
    [
        ("mass", (-1.0, 1.0), "mass is -1, not positive at mass = -1"),
        ("stiffness", (1.0, 1e307), r"matrix A are infinite or undefined at stiffness = 1e\+307"),
    ],
)
def test_scenes_that_do_not_start_and_matrices_beyond_the_largest_number_are_refused(name, given, why):
    scene = mb.Scene(spring_mass(mass=1e-3).system)
    refused(why, mb.root_locus, scene, name, given, count=2, error=mb.SimulationError)


@pytest.mark.parametrize("end", [5e-324, 1e-320, 1e-300, 1e-200, 1e-100, 1e100, 1e200, 1e300])
def test_stiffnesses_and_dampings_of_any_size(end):
    """A stiffness without normal digits counts as zero, so that the mass moves freely."""
    locus = mb.root_locus(oscillators(), "k1", (0.0, end), count=2)
    own = np.abs(locus.eigenvalues[-1].imag).min() if end < 1 else np.abs(locus.eigenvalues[-1].imag).max()
    assert own == pytest.approx(np.sqrt(end) if end > 1e-307 else 0.0, rel=1e-9)
    locus = mb.root_locus(oscillators(), "c1", (0.0, 1.7e308), count=3)
    np.testing.assert_allclose(locus.eigenvalues[1:, -1].real, [-0.85e308, -1.7e308], rtol=1e-9)
