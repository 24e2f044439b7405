"""Beams along polylines and their mesh."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from symmb._errors import DeclarationError
from symmb._magnitudes import SAME
from symmb._options import require_instance, require_whole
from symmb._types import Array, Expr, Indices
from symmb.declare.structures.beam_element import GAUSS, XI, Line, elements, properties
from symmb.declare.structures.mass_samples import MassSamples, Sparse, joined
from symmb.declare.structures.section import Material, Section, is_rigid
from symmb.declare.structures.validation import numbers


@dataclass(frozen=True, eq=False)
class Beam:
    """A straight or polygonal beam.

    Parameters
    ----------
    points : (p, 3)
        corners of the axis through the sections' centroids [m]
    section : Section
        section of the whole beam, or p sections, one at each corner. Between corners √A and I^¼ are linear, which is
        exact for similar sections, such as the sections of a cone
    material : Material
        material of the whole beam
    elements : int
        number of elements between two neighbouring corners
    orientation : (3,)
        vector whose component normal to the beam is the section's y axis. The default vector is z × axis (horizontal),
        or y for a beam along z

    Raises
    ------
    DeclarationError
        If there are fewer than two points, if neighbouring points coincide, if the orientation is along the beam, if
        the number of sections is wrong, or if only some sections have shear deformation.

    Examples
    --------
    >>> import symmb as mb
    >>> steel = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
    >>> beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), steel, elements=8)
    >>> mb.FiniteElements.beams(beam).positions.shape
    (9, 3)
    """

    points: npt.ArrayLike
    section: Section | Sequence[Section]
    material: Material
    elements: int = 8
    orientation: npt.ArrayLike | None = None

    def __post_init__(self) -> None:
        points = numbers(self.points, "Beam", "points", ("p", 3))
        object.__setattr__(self, "points", points)
        if len(points) < 2 or not np.linalg.norm(np.diff(points, axis=0), axis=1).all():
            raise DeclarationError("Beam: expected at least two points. Neighbouring points must not coincide.")
        # Maximum number of elements between two corners. With more elements, rounding affects the slow modes.
        require_whole(self, "elements", 1, 10_000)
        require_instance("Beam: material", self.material, Material, "a Material")
        sections = [self.section] if isinstance(self.section, Section) else self.section
        for section in sections if isinstance(sections, list | tuple) else [sections]:
            require_instance("Beam: section", section, Section, "a Section, or one for each point")
        sections = self.sections
        if len(sections) != len(points):
            raise DeclarationError(
                f"Beam: got {len(sections)} sections for {len(points)} points. Give one Section, or one for each point."
            )
        if len({(is_rigid(s.shear_y), is_rigid(s.shear_z)) for s in sections}) > 1:
            raise DeclarationError(
                "Beam: some sections are rigid in shear, but other sections are not. Give all sections shear areas, "
                "or use section.without_shear() for all."
            )
        self.axes()

    @property
    def corners(self) -> Array:
        """The points (p, 3) [m]."""
        return np.asarray(self.points, dtype=float)

    @property
    def sections(self) -> list[Section]:
        """The p sections at the corners."""
        return [self.section] * len(self.corners) if isinstance(self.section, Section) else [*self.section]

    def nodes(self) -> Array:
        """The nodes (spans * elements + 1, 3) in their order along the beam [m]."""
        share = np.arange(self.elements)[:, None] / self.elements
        inner = self.corners[:-1, None] * (1 - share) + self.corners[1:, None] * share
        return np.vstack([inner.reshape(-1, 3), self.corners[-1]])

    def axes(self) -> Array:
        """The section axes (spans, 3, 3) of each span, with unit vectors x, y, z as rows."""
        x = np.diff(self.corners, axis=0)
        x /= np.linalg.norm(x, axis=1)[:, None]
        if self.orientation is None:
            y = np.cross([0.0, 0.0, 1.0], x)
            y[np.linalg.norm(y, axis=1) < SAME] = [0.0, 1.0, 0.0]
        else:
            y = np.tile(numbers(self.orientation, "Beam", "orientation", (3,)), (len(x), 1))
        normal = y - (x * y).sum(axis=1)[:, None] * x
        size = np.linalg.norm(normal, axis=1)
        if (size <= SAME * np.linalg.norm(y, axis=1)).any():
            raise DeclarationError(f"Beam: orientation {self.orientation!r} is along the beam. Give another direction.")
        normal /= size[:, None]
        return np.stack([x, normal, np.cross(x, normal)], axis=1)

    def line(self) -> Line:
        """The matrices of the elements of the beam."""
        length = np.linalg.norm(np.diff(self.corners, axis=0), axis=1) / self.elements
        return elements(
            np.repeat(length, self.elements),
            np.repeat(self.axes(), self.elements, axis=0),
            self.sections_at_ends(),
            self.material.E,
            self.material.shear_modulus,
        )

    @property
    def numbers(self) -> list[Expr]:
        """E, density and G of the material, and the properties of each section: numbers or expressions."""
        material = [self.material.E, self.material.density, self.material.shear_modulus]
        return [*material, *(value for section in self.sections for value in properties_of(section))]

    def with_numbers(self, values: Array) -> "Beam":
        """The beam with these values in place of its `numbers`."""
        (E, density, G), properties = values[:3].tolist(), values[3:].reshape(len(self.sections), -1).tolist()
        sections = [Section(*some) for some in properties]
        one = isinstance(self.section, Section)
        return replace(self, section=sections[0] if one else sections, material=Material(E=E, density=density, G=G))

    def laws(self) -> list[list[Expr]]:
        """Stiffness EA, GA_y, GA_z, GJ, EI_y, EI_z [N, N m^2] and mass ρA, ρI_y, ρI_z [kg/m, kg m] of each section.

        For a section that is rigid in shear, the bending stiffness replaces the shear stiffness.
        """
        E, G, density = self.material.E, self.material.shear_modulus, self.material.density
        return [
            [
                E * s.area,
                E * s.Iz if is_rigid(s.shear_y) else G * s.shear_y,
                E * s.Iy if is_rigid(s.shear_z) else G * s.shear_z,
                G * s.J,
                *(E * s.Iy, E * s.Iz, density * s.area, density * s.Iy, density * s.Iz),
            ]
            for s in self.sections
        ]

    def sections_at_ends(self) -> Array:
        """The section properties (e, 2, 6) at both ends of the elements."""
        sections = np.array([properties_of(section) for section in self.sections])
        along = properties(
            np.stack([sections[:-1], sections[1:]], axis=1), np.arange(self.elements + 1) / self.elements
        )
        return np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2, 6)


def properties_of(section: Section) -> list[Expr]:
    """The properties area, Iy, Iz, J, shear_y, shear_z of a section."""
    return [getattr(section, field.name) for field in fields(section)]


@dataclass(frozen=True, eq=False)
class AxialForces:
    """Axial forces in beams and their effect. The g Gauss points of the e elements are the first e g mass samples."""

    dofs: Indices  # (e, 12)
    axis: Array  # (e, 3), unit vectors along the elements
    force: Array  # (e, 12), axial force for unit nodal displacements [N/m, N/rad]
    weights: Array  # (e, g) [m]
    slopes: Array  # (e, g, 2, 12), slopes in both planes for unit nodal displacements

    def forces(self, displacements: Array, loads: Array) -> Array:
        """Axial forces (e, g) [N] under loads (e g, 3) [N] on the samples. The loads are linear along an element.

        The load of an element has the parts p₁ and p₂ at both ends. By equilibrium, the load changes the uniform force
        by p₁ at the first end and by -p₂ at the second end.
        """
        along = np.einsum("ega,ea->eg", loads.reshape(len(self.axis), -1, 3), self.axis)
        first, second = (along @ (1 - XI))[:, None], (along @ XI)[:, None]
        own = first * (1 - 4 * XI + 3 * XI**2) + second * (2 * XI - 3 * XI**2)
        return (self.force * displacements[self.dofs]).sum(axis=1)[:, None] + own


@dataclass(frozen=True, eq=False)
class Mesh:
    """Assembled beams."""

    positions: Array
    stiffness: Sparse
    samples: MassSamples
    axial: AxialForces


def mesh(beams: Sequence[Beam], shares: Array | None = None) -> Mesh:
    """Assemble beams. Coincident nodes of beams are joined rigidly.

    `shares` (b, 9) multiply the stiffness and mass of the 9 `laws` of each beam. By default they are 1.
    """
    from scipy.sparse import csc_array

    positions, numbering = _merged([beam.nodes() for beam in beams])
    d = 6 * len(positions)
    lines, samples, dofs, stiffnesses = [], [], [], []
    shares = np.ones((len(beams), 9)) if shares is None else shares
    for beam, nodes, share in zip(beams, numbering, shares, strict=True):
        place = np.stack([nodes[:-1], nodes[1:]], axis=1)
        columns = (6 * place[:, :, None] + np.arange(6)).reshape(-1, 12)
        line = beam.line()
        lines.append(line)
        stiffnesses.append(np.einsum("s,seij->eij", share[:6], line.stiffness))
        samples.append(_samples(beam, line, positions[place], columns, d, share[6:]))
        dofs.append(columns)
    where = np.concatenate(dofs)
    stiffness = np.concatenate(stiffnesses)
    rows, columns = np.broadcast_arrays(where[:, :, None], where[:, None, :])
    K = csc_array((stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=(d, d))
    axial = AxialForces(
        where,
        np.concatenate([beam.axes()[:, 0].repeat(beam.elements, axis=0) for beam in beams]),
        np.concatenate([line.axial for line in lines]),
        np.concatenate([line.weights for line in lines]),
        np.concatenate([line.slopes for line in lines]),
    )
    return Mesh(positions, (K + K.T) / 2, joined(samples), axial)


def _samples(beam: Beam, line: Line, ends: Array, columns: Indices, d: int, shares: Array) -> MassSamples:
    """Mass samples at the Gauss points of the elements between `ends` (e, 2, 3)."""
    from scipy.sparse import csr_array

    section = properties(beam.sections_at_ends(), XI)[..., :3] * shares
    density = beam.material.density * line.weights
    s = density.size
    where = np.repeat(columns, 3 * GAUSS, axis=0).ravel()

    def field(matrices: Array) -> Sparse:
        matrix = csr_array((matrices.ravel(), where, np.arange(0, 36 * s + 1, 12)), shape=(3 * s, d), copy=True)
        matrix.eliminate_zeros()
        return matrix

    Iy, Iz = section[..., 1], section[..., 2]
    principal = density[..., None] * np.stack([Iy + Iz, Iy, Iz], axis=-1)
    axes = np.repeat(beam.axes(), beam.elements, axis=0)
    rotary = np.einsum("ega,eai,eaj->egij", principal, axes, axes)
    positions = ends[:, None, 0] * (1 - XI[:, None]) + ends[:, None, 1] * XI[:, None]
    return MassSamples(
        (density * section[..., 0]).ravel(),
        positions.reshape(-1, 3),
        field(line.translation),
        rotary.reshape(-1, 3, 3),
        field(line.rotation),
    )


def _merged(nodes: list[Array]) -> tuple[Array, list[Indices]]:
    """Distinct nodes in the order of their first appearance, and the indices of each beam's nodes."""
    every = np.vstack(nodes)
    near = SAME * np.ptp(every, axis=0).max()
    first = np.array([(np.abs(every - node) <= near).all(axis=1).argmax() for node in every])
    unique = np.unique(first)
    return every[unique], np.split(np.searchsorted(unique, first), np.cumsum([len(x) for x in nodes])[:-1])
