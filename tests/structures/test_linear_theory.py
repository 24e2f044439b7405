"""Doubts about flexible bodies beyond linear theory or without the modes they need, and none where they follow it:
against closed forms, and random assemblies of beams against all their finite elements."""

import re
import warnings

import numpy as np
import pytest
from faults import refused, warned
from flexible_scenes import elastica, random_assembly
from machines import GROUND, run_of

import symmb as mb

STEEL = mb.Material(E=210e9, density=7850.0, nu=0.3)
SECTION, FLAT = mb.Section.circle(0.004).without_shear(), mb.Section.rectangle(0.02, 0.01)


def beam(length: float = 1.0, section: mb.Section = SECTION, elements: int = 10) -> tuple[mb.FiniteElements, float]:
    """A mesh and its bending stiffness [N m^2]."""
    mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (length, 0, 0)], section, STEEL, elements=elements))
    return mesh, STEEL.E * section.Iz


def quiet(scene: mb.Scene, of=mb.simulate, *options):
    """What a call, such as a run, returns without its warnings."""
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        return of(scene, *options)


def welded(modes: mb.Modes, load, at: float = 1.0, **options) -> mb.Scene:
    """A rod that is welded to the ground, in equilibrium under a load across its end [N]."""
    rod = mb.FlexibleBody("rod", modes, mb.Planar())
    tip = rod.point(at, 0)
    weld, force = mb.Weld("A", GROUND.point(0, 0), rod.point(0, 0)), mb.Force("F", tip, (0, load))
    system = mb.System(rod, weld, force, **options)
    return mb.Scene(system, times=[0, 0.01], outputs={"x": tip.x, "y": tip.y}, equilibrium=True)


@pytest.mark.parametrize("stiffening", [False, True])
@pytest.mark.parametrize("load", [0.05, 0.3, 0.8, 3.0, 10.0])
def test_deflections_that_are_too_large_are_told(load: float, stiffening: bool) -> None:
    length = 0.7
    mesh, EI = beam(length, mb.Section.circle(0.002).without_shear())
    modes = mesh.modes(clamped=0, interfaces=[10], count=6, planar=True, stiffening=stiffening)
    run = quiet(welded(modes, -load * EI / length**2, length))
    off = np.abs(np.array([run["x"][0], -run["y"][0]]) / length - np.abs(elastica(load))).max()
    told = any("'rod'" in doubt and "rad" in doubt for doubt in run.doubts)
    assert told == (load > 0.6)  # half of it is the rotation of the end
    assert told or off < 0.025
    assert len(run.doubts) == told


def test_a_study_of_solvers_tells_what_none_of_them_cures() -> None:
    mesh, EI = beam(elements=4)
    modes = mesh.modes(clamped=0, interfaces=[4], count=3, planar=True, damping=0.1)
    found = mb.stability(welded(modes, -2.0 * EI), seconds=1.0)
    assert found.advice.splitlines()[-1].startswith("FlexibleBody 'rod': its cross sections turn")


@pytest.mark.parametrize("share", [0.1, 0.18, 0.4, 1.5])
@pytest.mark.parametrize("stiffening", [False, True])
def test_spin_without_stiffening_is_told(share: float, stiffening: bool) -> None:
    mesh, _ = beam()
    modes = mesh.modes(clamped=0, count=2, planar=True, stiffening=stiffening, damping=0.02)
    rod = mb.FlexibleBody("rod", modes, mb.Planar())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, 0))
    drive = mb.Motion("drive", hinge.angle, share * 2 * np.pi * modes.frequencies[0] * mb.t)
    run = quiet(mb.Scene(mb.System(rod, hinge, drive), times=np.linspace(0, 0.1, 11)))
    told = any("Centrifugal" in doubt and "'rod'" in doubt for doubt in run.doubts)
    assert told == (share > 0.2 and not stiffening)


@pytest.mark.parametrize(("count", "told"), [(3, True), (6, True), (10, True), (None, False)])
def test_modes_without_static_shapes_are_told_with_what_they_lack(count: int | None, told: bool) -> None:
    """A cantilever of free modes: the share that the doubt tells is that by which its deflection is too small."""
    mesh, EI = beam()
    modes = mesh.modes(count=count, planar=True) if count else mesh.modes(interfaces=[0, 10], planar=True)
    scene = welded(modes, -0.1)
    run = quiet(scene)
    off = 1 - run["y"][0] / (-0.1 / 3 / EI)
    (doubt,) = run.doubts if told else ("",)
    assert told == (off > 0.05)
    assert not told or "of the deflections by loads at its nodes 0, 10" in doubt
    assert not told or float(doubt.split("neglect ")[1].split("%")[0]) == pytest.approx(100 * off, abs=1.1)
    assert mb.prepare(scene).doubts == run.doubts


def test_a_study_tells_what_only_its_corners_ask() -> None:
    mesh, EI = beam()
    p, modes = mb.Parameters(load=0.3), mesh.modes(clamped=0, interfaces=[10], count=2, planar=True)
    scene = welded(modes, -p.load * EI, parameters=p)
    wide = quiet(scene, mb.propagate, mb.Vertex(), mb.Box(load=(0.2, 0.9)))
    assert not mb.propagate(scene, mb.Vertex(), mb.Box(load=(0.2, 0.4))).doubts
    assert any("At load = 0.9: FlexibleBody 'rod'" in doubt for doubt in wide.doubts)


@pytest.mark.parametrize("elements", [1, 3, 5])
def test_points_between_nodes_are_refused(elements: int) -> None:
    mesh, _ = beam(elements=elements)
    rod = mb.FlexibleBody("rod", mesh.modes(clamped=0, count=2, planar=True), mb.Planar())
    refused(r"\(0\.48, 0, 0\) is between the nodes", rod.point, 0.48, 0)
    assert rod.point(1, 0.1).body is rod.node(elements).body
    assert rod.point(1.2, 0).body is rod.node(elements).body


@pytest.mark.parametrize("seed", [1, 6, 12, 16, 20, 25])
def test_wrong_deflections_and_frequencies_are_told(seed: int) -> None:
    assembly = random_assembly(seed)
    run, lin = quiet(assembly.scene, mb.simulate, mb.CVODES()), quiet(assembly.scene, mb.linearize)
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
    mesh, EI = beam(section=FLAT.without_shear())
    scene = welded(mesh.modes(count=count, planar=True), 0.0)
    lin = warned("'rod': its modes do not represent", mb.linearize, scene)
    exact = 1.8751040687**2 * np.sqrt(EI / STEEL.density / FLAT.area) / (2 * np.pi)
    assert lin.frequencies[0] / exact - 1 == pytest.approx(high, abs=2e-3)
    assert float(re.findall(r"Hz by (\d+)%", lin.doubts[0])[0]) == pytest.approx(100 * high, abs=1.5)


@pytest.mark.parametrize(("planar", "options"), [(True, {"count": 4}), (False, {"count": 8}), (True, {"clamped": 0})])
def test_two_hinges_and_no_axial_mode_are_told(planar: bool, options: dict[str, int]) -> None:
    mesh, _ = beam(0.8, FLAT, 8)
    rod = mb.FlexibleBody("rod", mesh.modes(**{"count": 3, **options}, planar=planar), mb.Planar() if planar else None)
    hinges = [mb.Revolute(f"h{x > 0:d}", GROUND.point(x, 0), rod.point(x, 0), axis=(0, 0, 1)) for x in (0, 0.8)]
    guess = {} if "clamped" in options else {"rod.x": 0.4}
    told = "'rod': joints hold the nodes 0 and 8, but no mode changes"
    refused(told, run_of, rod, *hinges, guess=guess, times=[0.0, 0.01], error=mb.AssemblyError)
