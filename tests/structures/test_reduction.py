"""Reduction to modes: natural frequencies, static exactness at interfaces, selection, stiffening by rotation."""

from functools import partial

import numpy as np
import pytest
from problems import read
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from structures import STEEL, cantilever, dofs, frame, frequencies, lattice

from symmb import Beam, FiniteElements, Section

TAU = 2 * np.pi
TUBE = Section.circle(0.02, 0.01)


def of_dofs(modes):
    """Shapes (6 k, n) in all degrees of freedom."""
    return np.hstack([modes.shapes, modes.rotations]).reshape(-1, len(modes.stiffness))


def rigid(positions):
    """(6 k, 6) rigid motions of nodes with rotations, by the cross product."""
    columns = [np.hstack([np.tile(e, (len(positions), 1)), np.zeros_like(positions)]).ravel() for e in np.eye(3)]
    turns = [np.hstack([np.cross(e, positions), np.tile(e, (len(positions), 1))]).ravel() for e in np.eye(3)]
    return np.stack(columns + turns, axis=1)


@pytest.mark.parametrize("elements", [8, 70], ids=["all modes", "Lanczos"])
@pytest.mark.parametrize("held", [None, 0], ids=["free", "clamped"])
def test_natural_frequencies_are_those_of_the_whole_structure(elements, held):
    """A round tube, every bending frequency of which is double."""
    beam = cantilever(elements, TUBE, STEEL)
    exact = frequencies(beam, dofs([] if held is None else [held]))[6 if held is None else 0 :]
    modes = beam.modes(clamped=held, count=13)
    assert np.sqrt(modes.stiffness) == pytest.approx(exact[:13], rel=1e-7)
    below = beam.modes(clamped=held, cutoff=(exact[8] + exact[9]) / 2 / TAU)
    assert below.frequencies == pytest.approx(exact[:9] / TAU, rel=1e-7)


@pytest.mark.parametrize("elements", [8, 70], ids=["all modes", "Lanczos"])
def test_modes_of_one_frequency_lie_along_the_axes(elements):
    modes = cantilever(elements, TUBE, STEEL).modes(clamped=0, count=4)
    assert (np.abs(modes.shapes[-1]) > 1e-3).tolist() == [[False] * 4, [True, False] * 2, [False, True] * 2]
    assert not modes.shapes[:, 1, 1].any()  # exactly
    assert not modes.shapes[:, 2, 0].any()


def test_modes_are_orthonormal_and_positive_where_largest():
    structure = frame(elements=16)
    modes = structure.modes(count=15)
    X = of_dofs(modes)
    assert X.T @ structure.M @ X == pytest.approx(np.eye(15), abs=1e-10)
    assert X.T @ structure.K @ X == pytest.approx(np.diag(modes.stiffness), abs=1e-7 * modes.stiffness[-1])
    flat = modes.shapes.reshape(-1, 15)
    assert (flat[np.abs(flat).argmax(axis=0), range(15)] > 0).all()


def test_a_free_body_moves_neither_its_centre_nor_its_momentum():
    structure = frame()
    modes = structure.modes(interfaces=[0, 8], count=12)
    assert not modes.S.any() and not modes.G0.any() and not modes.center.any()
    momenta = rigid(modes.positions).T @ structure.M @ of_dofs(modes)
    assert momenta == pytest.approx(np.zeros((6, 12)), abs=1e-12)


def test_static_loads_at_interfaces_of_a_clamped_body():
    structure = frame()
    modes = structure.modes(clamped=0, interfaces=[8, 12], cutoff=100.0)
    force = np.zeros(structure.K.shape[0])
    force[dofs([8, 12])] = np.arange(1.0, 13.0) * (-1) ** np.arange(12)
    whole = np.linalg.solve(structure.K.toarray()[6:, 6:], force[6:])
    X = of_dofs(modes)
    assert X[6:] @ ((X.T @ force) / modes.stiffness) == pytest.approx(whole, rel=1e-9, abs=1e-9 * np.abs(whole).max())


def test_static_loads_in_balance_at_interfaces_of_a_free_body():
    structure = frame()
    modes = structure.modes(interfaces=[0, 8, 12], count=12)
    place, load = rigid(modes.positions), np.zeros(structure.K.shape[0])
    load[dofs([0, 8, 12])] = np.cos(np.arange(18.0))
    load[dofs([0])] -= np.linalg.solve(place[dofs([0])].T, place.T @ load)  # what balances the rest
    assert place.T @ load == pytest.approx(np.zeros(6), abs=1e-12)
    whole = np.zeros(len(load))
    whole[6:] = np.linalg.solve(structure.K.toarray()[6:, 6:], load[6:])
    X = of_dofs(modes)
    difference = X @ ((X.T @ load) / modes.stiffness) - whole
    left = difference - place @ np.linalg.lstsq(place, difference)[0]
    assert np.abs(left).max() < 1e-9 * np.abs(whole).max()


def test_what_count_and_cutoff_choose():
    structure, shapes = frame(), 2 * 6 - 6
    modes = partial(structure.modes, interfaces=[0, 8])
    between = frequencies(structure, dofs([0, 8]))[2:4].mean() / TAU
    assert len(modes(cutoff=1e-3).stiffness) == shapes
    assert len(modes(cutoff=between).stiffness) == shapes + 3
    assert modes(count=shapes + 3).stiffness == pytest.approx(modes(cutoff=between).stiffness)
    assert len(modes(cutoff=between, count=4).stiffness) == 4
    few, natural = modes(count=4), structure.modes(count=4)
    assert len(few.stiffness) == 4
    assert few.frequencies == pytest.approx(natural.frequencies, rel=0.02)
    assert (few.frequencies >= natural.frequencies * (1 - 1e-9)).all()


def test_a_single_interface_adds_rigid_motions_only():
    """Ritz's method in the rigid motions and the modes with that node held, by a dense solver."""
    structure = frame(8)
    K, M = structure.K.toarray(), structure.M.toarray()
    held = np.vstack([np.zeros((6, 5)), eigh(K[6:, 6:], M[6:, 6:])[1][:, :5]])
    span = np.hstack([rigid(structure.positions), held])
    exact = np.sqrt(eigh(span.T @ K @ span, span.T @ M @ span, eigvals_only=True)[6:])
    assert np.sqrt(structure.modes(interfaces=[0], count=5).stiffness) == pytest.approx(exact, rel=1e-7)
    assert not structure.modes(interfaces=[0]).stiffness.size


def test_all_nodes_may_be_interfaces():
    structure = frame(elements=1)
    nodes = range(len(structure.positions))
    exact = frequencies(structure)[6:]
    assert np.sqrt(structure.modes(interfaces=nodes).stiffness) == pytest.approx(exact, rel=1e-5)


def test_nodes_without_rotations_hold_a_body_by_three():
    positions, K, M, _ = lattice()
    structure = FiniteElements.matrices(positions, K, M)
    modes = structure.modes(interfaces=[0, 5, 10], count=3 * 3 - 6 + 27)
    assert np.sqrt(modes.stiffness) == pytest.approx(frequencies(structure)[6:], rel=1e-7)


def test_damping_by_mode():
    shares = [0.01, 0.02, 0.03]
    modes = frame().modes(count=3, damping=shares)
    assert modes.damping == pytest.approx(2 * np.array(shares) * np.sqrt(modes.stiffness))
    assert frame().modes(count=3, damping=0.01).damping[2] == pytest.approx(modes.damping[2] / 3)


@pytest.fixture(scope="module")
def spun():
    return cantilever(16).modes(clamped=0, count=24, stiffening=True)


@pytest.mark.parametrize("speed", list(read("rotating_cantilever")["speeds"]))
def test_rotating_cantilever(spun, speed):
    """About z: stiffness less Ω² J2_zz, out of plane where J2_zz holds no mass, in plane where it does."""
    stiffness = np.diag(spun.stiffness) - float(speed) ** 2 * spun.J2[:, :, 2, 2]
    for axis, name in ((2, "flap"), (1, "lag")):
        kept = np.flatnonzero(np.abs(spun.shapes[-1, axis]) > 1e-3)
        found = np.sqrt(np.linalg.eigvalsh(stiffness[np.ix_(kept, kept)]))[:4]
        assert found == pytest.approx(read("rotating_cantilever")["speeds"][speed][name], rel=2e-4)


def test_stiffening_turns_with_the_body():
    """All six products of angular velocities: the same beam in other axes has the tensor J2 in those axes."""
    Q = Rotation.from_quat([-0.3, 0.7, 0.4, 0.5]).as_matrix()
    points, section = np.array([(0, 0, 0), (1, 0.2, 0), (1.2, 1, 0.3)]), Section.rectangle(0.02, 0.03)

    def stiffened(turn):
        beam = Beam(points @ turn.T, section, STEEL, elements=6, orientation=turn @ [0.1, 0.2, 1.0])
        return FiniteElements.beams(beam).with_mass(6, 2.0).modes(clamped=0, count=5, stiffening=True)

    here, there = stiffened(np.eye(3)), stiffened(Q)
    turned = np.einsum("ab,kbj->kaj", Q, here.shapes)
    signs = np.sign((turned * there.shapes).sum(axis=(0, 1)))
    expected = np.einsum("i,j,ac,bd,ijcd->ijab", signs, signs, Q, Q, here.J2)
    assert there.J2 == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())


def test_a_tip_mass_pulls_at_the_beam():
    """A light beam under the tension N = m Ω² L holds its tip with N/(L - tanh(μL)/μ), μ² = N/EI, out of plane."""
    mass, tension = 1e4, 9.0
    modes = cantilever(12).with_mass(12, mass).modes(clamped=0, count=20, stiffening=True)
    stiffness = np.diag(modes.stiffness) - tension / mass * modes.J2[:, :, 2, 2]
    kept = np.flatnonzero(np.abs(modes.rotations[:, 1]).max(axis=0) > 1e-3)
    exact = tension / (1 - np.tanh(3) / 3) / mass
    assert np.linalg.eigvalsh(stiffness[np.ix_(kept, kept)])[0] == pytest.approx(exact, rel=1e-3)
    assert modes.stiffness[0] == pytest.approx(3 / mass, rel=1e-3)
