"""Random assemblies of flexible beams against all their finite elements: what modes leave out is told, and no more."""

import re
import warnings

import numpy as np
import pytest
from flexible_scenes import random_assembly

import symmb as mb


@pytest.mark.parametrize("seed", [1, 6, 12, 16, 20, 25])
def test_wrong_deflections_and_frequencies_are_told(seed: int) -> None:
    assembly = random_assembly(seed)
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        run, lin = mb.simulate(assembly.scene, mb.CVODES()), mb.linearize(assembly.scene)
    off = abs(run["d"][0] / assembly.deflection - 1)
    told = any("neglect" in doubt for doubt in run.doubts)
    assert told or off < 0.1
    assert not told or off > 0.03
    high = lin.frequencies / assembly.frequencies[: len(lin.frequencies)] - 1
    assert high[0] < 0.1 or any("too high" in doubt for doubt in lin.doubts)
    for value in re.findall(r"([\d.]+) Hz by", " ".join(lin.doubts)):
        assert high[np.abs(lin.frequencies - float(value)).argmin()] > 0.03


@pytest.mark.parametrize(("count", "high"), [(3, 0.246), (6, 0.127), (10, 0.085)])
def test_a_welded_beam_of_free_modes_has_frequencies_that_are_too_high(count: int, high: float) -> None:
    """The share that the doubt tells is that over the closed form of a cantilever."""
    steel, section = mb.Material(E=210e9, density=7850.0, nu=0.3), mb.Section.rectangle(0.02, 0.01).without_shear()
    mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (1, 0, 0)], section, steel, elements=10))
    rod = mb.FlexibleBody("rod", mesh.modes(count=count, planar=True), mb.Planar())
    scene = mb.Scene(mb.System(rod, mb.Weld("A", mb.Ground().point(0, 0), rod.point(0, 0))), times=[0.0, 1.0])
    with pytest.warns(mb.SymmbWarning, match="'rod': its modes do not represent"):
        lin = mb.linearize(scene)
    exact = 1.8751040687**2 * np.sqrt(steel.E * section.Iz / steel.density / section.area) / (2 * np.pi)
    assert lin.frequencies[0] / exact - 1 == pytest.approx(high, abs=2e-3)
    assert float(re.findall(r"Hz by (\d+)%", lin.doubts[0])[0]) == pytest.approx(100 * high, abs=1.5)


@pytest.mark.parametrize(("planar", "options"), [(True, {"count": 4}), (False, {"count": 8}), (True, {"clamped": 0})])
def test_two_hinges_and_no_axial_mode_are_told(planar: bool, options: dict[str, int]) -> None:
    steel, section = mb.Material(E=210e9, density=7850.0, nu=0.3), mb.Section.rectangle(0.02, 0.01)
    mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (0.8, 0, 0)], section, steel, elements=8))
    rod = mb.FlexibleBody("rod", mesh.modes(**{"count": 3, **options}, planar=planar), mb.Planar() if planar else None)
    hinges = [mb.Revolute(f"h{x > 0:d}", mb.Ground().point(x, 0), rod.point(x, 0), axis=(0, 0, 1)) for x in (0, 0.8)]
    guess = {} if "clamped" in options else {"rod.x": 0.4}
    with pytest.raises(mb.AssemblyError, match=r"'rod': joints hold the nodes 0 and 8, but no mode changes"):
        mb.simulate(mb.Scene(mb.System(rod, *hinges), guess=guess, times=[0.0, 0.01]))
