"""Flexible bodies with parameters: against closed forms, dense eigenproblems, and bodies built in numbers."""

import pickle

import casadi as ca
import numpy as np
import pytest
from faults import refused
from scipy.linalg import eigh
from structures import lattice, squares

import symmb as mb
from symmb import Beam, Box, FiniteElements, Material, Section

P = mb.Parameters(E=7e10, rho=2700.0, h=0.01, zeta=0.01)
ALUMINIUM = Material(E=7e10, nu=0.3, density=2700)
LINE = [(0, 0, 0), (1, 0, 0)]
HEIGHT = Box(h=(0.01, 0.02))
BOX = Box(E=(6e10, 8e10), rho=(2500, 2900), h=(0.008, 0.015))
WIDTH = 0.03
PLANAR = (0, 0, 1)  # orientation: the width is normal to the plane, and the height is in it


def bar(E, rho, h, at=None, points=LINE, elements=8):
    section = Section.rectangle(WIDTH, h).without_shear()
    material = Material(E=E, nu=0.3, density=rho)
    return FiniteElements.beams(Beam(points, section, material, elements=elements, orientation=PLANAR), at=at)


def bending(E, rho, h):
    """Coefficient of ω = (βL)² sqrt(EI / ρA), length 1."""
    return np.sqrt(E * h**2 / (12 * rho))


def frequencies(modes: mb.Modes, at: dict[str, float], free: bool) -> np.ndarray:
    """Rising ω of the body with its modes, clamped or free."""
    return np.sqrt(squares(modes, ca.vertcat(*(getattr(P, name) for name in at)), free)([*at.values()]))


@pytest.mark.parametrize("case", [(3, 2.0), (6, 1.3)])
def test_frequencies_scale_with_modulus_and_density(case):
    """The modes are those of all moduli and densities, and their frequencies those of Euler and Bernoulli."""
    factor, spread = case
    slender = 0.002  # rotary inertia changes frequencies by less than 1e-5
    modes = bar(P.E, P.rho, slender, at=P, elements=24).modes(clamped=0, count=2, planar=True)
    assert modes.error == 0.0 and len(modes.stiffness) == 2
    at = {"E": 7e10 * factor, "rho": 2700.0 * spread}
    found = frequencies(modes, at, free=False)
    roots = np.array([1.875104068711961, 4.694091132974175])
    assert found == pytest.approx(roots**2 * bending(**at, h=slender), rel=1e-4)
    assert found == pytest.approx(np.sqrt(modes.stiffness * factor / spread), rel=1e-12)


def whole(mesh, held=()):
    """Rising ω² of a structure in the plane without its rigid motions, by a dense solver."""
    free = [k for k in range(mesh.K.shape[0]) if k % 6 in (0, 1, 5) and k // 6 not in held]
    squares = eigh(*(A.toarray()[np.ix_(free, free)] for A in (mesh.K, mesh.M)), eigvals_only=True)
    return squares if held else squares[3:]


@pytest.mark.parametrize("options", [{"clamped": 0, "count": 3}, {"count": 3}, {"interfaces": [0, 8], "count": 5}])
@pytest.mark.parametrize("h", [0.008, 0.0111, 0.015])
def test_a_height_is_within_the_stated_error_of_numbers(options, h):
    """Frequencies of a reduced body lie above those of the whole one, and hardly above those of its modes there."""
    symbolic = bar(P.E, P.rho, P.h, at=BOX).modes(**options, planar=True)
    mesh = bar(6.5e10, 2800.0, h)
    numbers = mesh.modes(**options, planar=True).stiffness
    found = frequencies(symbolic, {"E": 6.5e10, "rho": 2800.0, "h": h}, "clamped" not in options)[: len(numbers)] ** 2
    assert symbolic.error < 3e-5
    assert (found <= numbers * (1 + symbolic.error + 1e-8)).all()
    assert (found >= whole(mesh, [0] if "clamped" in options else [])[: len(numbers)] * (1 - 1e-8)).all()


def loaded(arm, joint, force, parameters):
    """A system of an arm, a joint at its start, its weight and a force at its tip; and the tip."""
    joint, force = joint("joint", mb.Ground().point(0, 0), arm.point(0, 0)), mb.Force("push", arm.node(8), force)
    return mb.System(arm, joint, force, mb.Gravity(0, -9.81), parameters=parameters), arm.node(8)


def swing(E, rho, h, zeta, at=None, parameters=None, stiffening=True, pose=None):
    planar = pose is None
    options = {"clamped": 0, "stiffening": True} if stiffening else {}
    modes = bar(E, rho, h, at).modes(count=4 if planar else 6, planar=planar, damping=zeta, **options)
    joint, push = mb.Revolute if planar else mb.Spherical, (0.0, ca.sin(3 * mb.t), *([] if planar else [0.5]))
    system, tip = loaded(mb.FlexibleBody("arm", modes, pose or mb.Planar()), joint, push, parameters)
    return mb.Scene(system, times=np.linspace(0, 0.3, 31), outputs={"x": tip.x, "y": tip.y})


@pytest.mark.parametrize(
    ("stiffening", "pose", "height", "tolerance"),
    [
        (True, None, False, 1e-9), (False, None, False, 1e-9), (False, mb.Spatial(), False, 1e-9),
        (True, None, True, 1e-7), (False, None, True, 1e-7),
    ],
)  # fmt: skip
def test_a_run_is_that_of_the_body_in_numbers(stiffening, pose, height, tolerance):
    values = {"E": 7.7e10, "rho": 2620.0, "h": 0.014 if height else 0.01, "zeta": 0.03}
    solver = mb.CVODES(rtol=1e-10, atol=1e-12)
    h = P.h if height else 0.01
    run = mb.simulate(swing(P.E, P.rho, h, P.zeta, {**P, **BOX}, P, stiffening, pose), solver, values)
    other = mb.simulate(swing(**values, stiffening=stiffening, pose=pose), solver)
    for name in ("x", "y"):
        assert run[name] == pytest.approx(other[name], abs=tolerance)


def cantilever(box, **options):
    modes = bar(P.E, P.rho, P.h, at=box).modes(clamped=0, interfaces=[8], planar=True, **options)
    system, tip = loaded(mb.FlexibleBody("arm", modes, mb.Planar()), mb.Weld, (0.0, -20.0), P)
    return mb.Scene(system, times=np.linspace(0, 0.01, 3), outputs={"tip": tip.y}, box=box, equilibrium=True)


def sag(E, rho, h):
    second = WIDTH * h**3 / 12
    return -20 / (3 * E * second) - rho * WIDTH * h * 9.81 / (8 * E * second)


@pytest.mark.long
def test_bounds_of_a_deflection_and_of_a_frequency_are_those_of_closed_forms():
    box = Box(E=(6e10, 8e10), rho=(2500, 2900), h=(0.01, 0.013))
    scene = cantilever(box, count=6)
    grid = [np.linspace(*box[name], 9) for name in box]
    scan = sag(*np.meshgrid(*grid))
    bounds = mb.propagate(scene, mb.PolynomialChaos())
    assert not bounds.doubts
    frequency = 1.875104068711961**2 * bending(*np.meshgrid(*grid)) / (2 * np.pi)
    of_modes = mb.propagate(mb.ModalSimulator(scene, count=1), mb.PolynomialChaos(), box=box)
    for found, row, known in ((bounds, -1, scan), (of_modes, 0, frequency)):
        edges = [found.lower[row, 0], found.upper[row, 0]]
        assert edges == pytest.approx([known.min(), known.max()], abs=1e-2 * np.ptp(known))


def test_a_sum_of_matrices_is_that_of_the_beam():
    """Stretching and bending of a beam as two matrices of another program, with the factors h and h^3."""
    thin, thick = (bar(7e10, 2700.0, h) for h in (0.01, 0.02))
    # K = h A + h³ B and M = h C + h³ D at both heights
    parts = []
    for name in "KM":
        one, two = (getattr(mesh, name).toarray() for mesh in (thin, thick))
        cubic = (two - 2 * one) / (0.02**3 - 2 * 0.01**3)
        parts.append([(P.h, (one - 0.01**3 * cubic) / 0.01), (P.h**3, cubic)])
    mesh = FiniteElements.matrices(thin.positions, *parts, at={"h": (0.01, 0.02)})
    modes = mesh.modes(clamped=0, count=3, planar=True)
    known = whole(bar(7e10, 2700.0, 0.013), held=[0])[:3]
    assert frequencies(modes, {"h": 0.013}, free=False)[:3] ** 2 == pytest.approx(known, rel=modes.error + 1e-7)


def test_a_mass_at_a_node_changes_the_shapes_with_the_density():
    mesh = bar(P.E, P.rho, 0.01, at={**P, "rho": (2000.0, 3500.0)}).with_mass(8, 0.4, 1e-3)
    modes = mesh.modes(count=3, planar=True)
    assert modes.family.box == {"rho": (2000.0, 3500.0)}
    numbers = bar(7e10, 2100.0, 0.01).with_mass(8, 0.4, 1e-3).modes(count=3, planar=True)
    found = frequencies(modes, {"E": 7e10, "rho": 2100.0}, free=True)[:3]
    assert found**2 == pytest.approx(numbers.stiffness, rel=modes.error + 1e-8)


def test_a_run_outside_the_box_of_the_modes_is_told():
    scene = swing(P.E, P.rho, P.h, 0.01, {**P, "h": (0.008, 0.012)}, P)
    with pytest.warns(mb.SymmbWarning, match=r"h = 0\.014 is outside of \(0\.008, 0\.012\). Its modes were"):
        mb.simulate(scene, parameters={"h": 0.014})
    inside = mb.simulate(scene, parameters={"h": 0.012, "E": 1e11})
    assert not inside.doubts


def test_modes_that_rise_above_the_cutoff_leave_it():
    """The second mode is below it at the lower heights only."""
    modes = bar(7e10, 2700.0, P.h, at=BOX).modes(cutoff=130.0, planar=True)
    whole_there = whole(bar(7e10, 2700.0, 0.008))
    assert np.sqrt(whole_there[1]) / (2 * np.pi) < 130
    assert len(modes.stiffness) >= 2 and modes.error < 3e-5


def test_structures_in_numbers_and_scenes_survive_a_pickle():
    mesh = bar(7e10, 2700.0, 0.01)
    again = pickle.loads(pickle.dumps(mesh))
    assert again.modes(count=2).stiffness == pytest.approx(mesh.modes(count=2).stiffness)
    scene = swing(P.E, P.rho, P.h, P.zeta, {**P, **BOX}, P)
    again = pickle.loads(pickle.dumps(scene))
    assert mb.simulate(again)["y"] == pytest.approx(mb.simulate(scene)["y"], abs=1e-12)


def high(lowest):
    """A bar of an uncertain height."""
    return bar(7e10, 2700, P.h, at=Box(h=(lowest, 0.02)))


def springs(factor, **at):
    """Point masses on springs with a factor of their stiffness."""
    positions, K, M, _ = lattice()
    return FiniteElements.matrices(positions, [(factor, K)], M, at=at or None)


OTHER = mb.Parameters()
AREA = "Section: area must be above 0"
ROUND = Section.circle(P.h)
TAPERED = [section.without_shear() for section in (ROUND, Section.circle(0.01))]
FAULTS = {
    "negative height": (lambda: high(-0.01), rf"{AREA}, got -0\.0003\. The parameters are h = -0\.01\."),
    "no height at an end": (lambda: high(0), rf"{AREA}, got 0\. The parameters are h = 0\."),
    "no value": (lambda: bar(P.E, 2700, P.h, at=HEIGHT), "'E' has no value. Give its interval, at=mb.Bo"),
    "a number where an interval is needed": (
        lambda: bar(P.E, P.rho, P.h, at=P).modes(count=3),
        r"'h' changes the shapes of the modes, but has only the value 0\.01\. Give its interval",
    ),
    "shear": (
        lambda: FiniteElements.beams(Beam(LINE, ROUND, ALUMINIUM), at=HEIGHT),
        r"parameters change the proportions .* Use one section for the whole beam, and section\.without_shear\(\)",
    ),
    "one end": (
        lambda: FiniteElements.beams(Beam(LINE, TAPERED, ALUMINIUM), at=HEIGHT),
        "parameters change the proportions along a beam",
    ),
    "at": (lambda: bar(P.E, 2700, 0.01, at=[7e10]), "'at' must be a Box, Parameters, or a dictionary of values, got"),
    "reversed": (lambda: bar(P.E, 2700, 0.01, at={"E": (2.0, 1.0)}), r"at\['E'\] has lower 2 above upper 1. Exchange"),
    "no interval": (lambda: bar(P.E, 2700, 0.01, at={"E": None}), r"at\['E'\] must be a number or a pair"),
    "saved": (lambda: bar(P.E, 2700, 0.01, at=P).modes(count=2).save("modes.npz"), "these modes contain expressions"),
    "damping": (
        lambda: bar(7e10, 2700, 0.01, at={"zeta": -0.1}).modes(count=2, damping=P.zeta),
        "damping must not be negative",
    ),
    "another system's": (
        lambda: mb.System(mb.FlexibleBody("rod", bar(P.E, 2700, 0.01, at=P).modes(count=2)), parameters=OTHER),
        "Body 'rod': stiffness or damping: symbol 'E' belongs to Parameters that the System does not have",
    ),
    "factor that is a text": (lambda: springs("h"), "a factor of K: the value must be a number, got 'h'"),
    "infinite factor": (lambda: springs(1 / P.h, h=0.0), "is not finite at h = 0"),
    "no mode below": (lambda: bar(7e10, 2700, P.h, at=BOX).modes(cutoff=1.0), "no mode is below cutoff"),
    "negative factor": (
        lambda: springs(P.h, h=(-1.0, 2.0)).modes(count=2),
        "the stiffness matrix gives no strain energy .* The parameters are h = -1",
    ),
}


@pytest.mark.parametrize(("declare", "message"), FAULTS.values(), ids=FAULTS)
def test_faults(declare, message):
    refused(message, declare)
