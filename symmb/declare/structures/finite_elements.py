"""Structures of finite elements and their reduction to modes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._magnitudes import ROUNDING, SLIGHT
from symmb._options import require_instance, require_truth, shown, whole
from symmb._types import Array, Expr, Indices
from symmb.declare.structures.beams import AxialForces, Beam
from symmb.declare.structures.families import with_parameters
from symmb.declare.structures.flexibility import Flexibility
from symmb.declare.structures.foreshortening import foreshortening
from symmb.declare.structures.inertia_invariants import Shapes, cleaned, rigid_inertia
from symmb.declare.structures.mass_samples import MassSamples, Sparse, at_nodes, joined, rigid_motions
from symmb.declare.structures.matrices import checked, loaded, lumped
from symmb.declare.structures.mode_reduction import chosen, reduced
from symmb.declare.structures.modes import Modes, nearest
from symmb.declare.structures.reduced_basis import spanning
from symmb.declare.structures.terms import OWNER, Ranges, Terms, beam_terms, numeric_terms, summed
from symmb.declare.structures.validation import is_law, numbers, positive


@dataclass(frozen=True, eq=False)
class FiniteElements:
    """A linear elastic structure that is free in space: K u + M ü = f.

    The degrees of freedom are ordered by node, in the axes of the mesh. Each node has three translations [m]. A node
    with six degrees of freedom also has three small rotations [rad]. `FiniteElements.beams` and
    `FiniteElements.matrices` create a structure.

    Parameters
    ----------
    positions : (k, 3)
        nodes [m]
    K, M : (d, d)
        stiffness and mass matrix (SciPy sparse), d = 3 k or 6 k
    samples : MassSamples
        point masses for the inertia of the deformed body
    axial : AxialForces
        axial forces of beams, for geometric stiffening
    terms : Terms
        K and M as sums, for structures with parameters. K, M and other fields are for the middles of the intervals

    Examples
    --------
    >>> import symmb as mb
    >>> steel = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
    >>> beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), steel, elements=8)
    >>> mesh = mb.FiniteElements.beams(beam)
    >>> mesh.positions.shape, mesh.K.shape
    ((9, 3), (54, 54))
    """

    positions: Array
    K: Sparse
    M: Sparse
    samples: MassSamples
    axial: AxialForces | None = None
    terms: Terms | None = None

    def __post_init__(self) -> None:
        require_instance("FiniteElements: samples", self.samples, MassSamples, "samples of beams(...) or matrices(...)")

    @classmethod
    def beams(cls, *beams: Beam, at: Mapping[str, Any] | None = None) -> "FiniteElements":
        """A mesh of beams. Coincident nodes are joined rigidly, and nodes are numbered along the beams in order.

        The elements are two-node Timoshenko or Euler-Bernoulli elements with consistent masses and the rotary inertia
        of the sections. Inertia is integrated exactly along the elements.

        Parameters
        ----------
        *beams : Beam
        at : mapping
            values of the parameters in sections and materials: a `Box`, `Parameters`, or numbers and pairs (lower,
            upper) by name. Parameters that change the shapes of modes need intervals

        Raises
        ------
        DeclarationError
            If there is no beam, if a parameter has no value, if a material or a section is not positive in all
            intervals, or if the shapes of elements change with parameters.

        Examples
        --------
        >>> import symmb as mb
        >>> steel = mb.Material(E=2.1e11, nu=0.3, density=7850)
        >>> elements = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.rectangle(0.02, 0.01), steel))
        >>> modes = elements.modes(clamped=0, count=2)
        >>> print(modes.frequencies.round(2))
        [ 8.35 16.71]

        A modulus and a height as parameters:

        >>> p = mb.Parameters(E=2.1e11, h=0.01)
        >>> bar = mb.Beam(
        ...     [(0, 0, 0), (1, 0, 0)],
        ...     mb.Section.rectangle(0.02, p.h).without_shear(),
        ...     mb.Material(E=p.E, nu=0.3, density=7850),
        ... )
        >>> elements = mb.FiniteElements.beams(bar, at=mb.Box(E=(2.0e11, 2.2e11), h=(0.008, 0.012)))
        >>> modes = elements.modes(clamped=0, count=2)
        >>> modes.error < 1e-5
        True
        """
        if not beams:
            raise DeclarationError("FiniteElements.beams: expected at least one Beam.")
        for beam in beams:
            require_instance("FiniteElements.beams", beam, Beam, "a Beam")
        owner = "FiniteElements.beams"
        meshed, terms = beam_terms(beams, Ranges.given(at, owner), owner)
        mass = meshed.samples.mass_matrix()
        return cls(meshed.positions, meshed.stiffness, mass, meshed.samples, meshed.axial, terms)

    @classmethod
    @kept_interrupts()
    def matrices(
        cls,
        positions: npt.ArrayLike | str | PathLike[str],
        K: Sparse | str | PathLike[str] | list[tuple[Expr, Sparse | str | PathLike[str]]],
        M: Sparse | str | PathLike[str] | list[tuple[Expr, Sparse | str | PathLike[str]]],
        at: Mapping[str, Any] | None = None,
    ) -> "FiniteElements":
        """A structure from another program: node positions (k, 3) [m], stiffness and mass matrix.

        The matrices have size 3 k or 6 k and belong to the body without supports. The degrees of freedom have the order
        of `FiniteElements`. Matrices are arrays, SciPy sparse matrices or paths of files. Files are Matrix Market
        files, or text files of Nastran with DMIG (.pch, .bdf, .dat, .nas). If a file has several matrices, the matrix
        with a name that starts with K or M is read. Positions are an array or the path of a mesh: a file of Nastran
        with GRID cards, or any file that the package meshio can read. Nodes of Nastran are matched by their numbers;
        all other nodes must have the order of the matrices.

        Mass, centre of mass, inertia, S and G0 of the `Modes` follow from M. J1, J2 and G1 describe how the inertia
        changes with the deformation. J1, J2 and G1 follow from node masses, the row sums of M. With parameters, K and M
        are sums: lists of pairs (factor, matrix), such as [(p.h, membrane), (p.h**3, plate)]. For `at`, see `beams`.

        Raises
        ------
        DeclarationError
            If a matrix has a wrong size, is not symmetric or is not positive, if rigid motions have strain energy, or
            if a file is not valid.
        """
        owner = "FiniteElements.matrices"
        pairs = {"K": _pairs(K, "K"), "M": _pairs(M, "M")}
        nodes, matrices = loaded(positions, {name: [A for _, A in some] for name, some in pairs.items()})
        factors = [[c for c, _ in some] for some in pairs.values()]
        ranges = Ranges.given(at, owner)
        nominal = [ranges.values(some, ranges.points([]), owner)[0] for some in factors]
        stiffness, mass = (summed(c, some) for c, some in zip(nominal, matrices, strict=True))
        checked(nodes, stiffness, mass)
        of_K, of_M = (zip(c, some, strict=True) for c, some in zip(factors, matrices, strict=True))
        terms = Terms(ranges, tuple(of_K), tuple((c, A, lumped(nodes, A)) for c, A in of_M))
        return cls(nodes, stiffness, mass, lumped(nodes, mass), terms=terms)

    @property
    def per_node(self) -> int:
        """Number of degrees of freedom per node: 3 or 6."""
        return self.K.shape[0] // len(self.positions)

    def nearest(self, x: float, y: float, z: float = 0.0) -> int:
        """Number of the node nearest to (x, y, z) [m]; the first node if several are equally near."""
        return nearest(self.positions, (x, y, z))

    def with_mass(self, node: int, mass: float, inertia: npt.ArrayLike = 0.0) -> "FiniteElements":
        """The structure with a rigid mass [kg] at a node. The inertia (3, 3), (3,) or 0 is about the node [kg m^2].

        Raises
        ------
        DeclarationError
            If the node does not exist, if the mass is not above 0, or if the mass has inertia but nodes cannot rotate.
        """
        owner = "FiniteElements.with_mass"
        where = np.array(chosen((node,), len(self.positions), owner))
        tensor = numbers(inertia, owner, "inertia", (), (3,), (3, 3))
        tensor = np.diag(tensor * np.ones(3)) if tensor.ndim < 2 else tensor
        if not np.allclose(tensor, tensor.T) or np.linalg.eigvalsh(tensor)[0] < -ROUNDING * np.abs(tensor).max():
            raise DeclarationError(f"{owner}: inertia must be symmetric positive semidefinite, got {shown(inertia)}.")
        if self.per_node == 3 and tensor.any():
            raise DeclarationError(
                f"{owner}: the nodes have no rotations, so inertia has no effect. Distribute the mass over several "
                "nodes."
            )
        added = at_nodes(where, np.array([positive(mass, owner, "mass")]), tensor[None], self.positions, self.per_node)
        M, samples, terms = self.M + added.mass_matrix(), joined([self.samples, added]), self._terms
        more = terms.with_mass(added) if terms.has_laws else numeric_terms(self.K, M, samples, terms.ranges)
        return replace(self, M=M, samples=samples, terms=more)

    @property
    def _terms(self) -> Terms:
        return self.terms or numeric_terms(self.K, self.M, self.samples, Ranges({}))

    @kept_interrupts()
    def modes(
        self,
        interfaces: Sequence[int] = (),
        count: int | None = None,
        cutoff: float | None = None,
        clamped: int | None = None,
        damping: npt.ArrayLike | Expr = 0.0,
        stiffening: bool = False,
        planar: bool = False,
    ) -> Modes:
        """Reduce the structure to a few mass-normalised modes.

        Without interfaces, the modes are the natural modes of the structure. With interfaces, the modes span two kinds
        of shapes: static shapes of unit motions of these nodes, and natural modes with these nodes fixed. Static loads
        at interfaces then deform the reduced body like the full structure. The modes are orthonormal in M.

        Parameters
        ----------
        interfaces : nodes
            nodes at which joints and forces act
        count : int
            total number of modes, the lowest first; 0 makes a rigid body. With interfaces there are 6 static shapes for
            each node (3 without rotations), minus 6 if the body is free. All other modes are fixed-interface modes. If
            `count` is smaller than the number of static shapes, the highest modes are left out. Static deformations
            are then approximate
        cutoff : float
            modes below this frequency [Hz] are used. With interfaces, these are the fixed-interface modes below the
            cutoff and all static shapes. `count` then limits the number of modes
        clamped : int
            node that is fixed in the frame of the body and is its origin. By default the body is free in a floating
            frame: the origin is the centre of mass, and the modes change neither this centre nor the angular momentum
            (S = 0, G0 = 0)
        damping : Expr, (n,)
            modal damping ratio ζ, one for all modes or one for each mode. An expression of parameters is for all modes
        stiffening : bool
            whether axial loads (centrifugal forces, gravity, forces at the ends) stiffen or soften beams. This option
            needs a clamped node. Without stiffening, a fast rotor is too soft
        planar : bool
            True: only motion in the xy plane, for bodies with the pose `Planar()`

        Raises
        ------
        DeclarationError
            If no number of modes is given, if the mesh has fewer modes, if no mode is below the cutoff, if a node is
            unknown, if the interfaces or the clamped node do not support the body, or if a body with stiffening is not
            clamped or has no beams.

        References
        ----------
        R. R. Craig, M. C. C. Bampton, Coupling of substructures for dynamic analyses, AIAA Journal 6 (1968) 1313-1319.
        O. Wallrapp, R. Schwertassek, Representation of geometric stiffening in multibody system simulation, Int. J.
        Numer. Methods Eng. 32 (1991) 1833-1850.
        """
        from scipy.sparse import diags_array

        require_truth(OWNER, "stiffening", stiffening)
        require_truth(OWNER, "planar", planar)
        fixed = chosen(() if clamped is None else (clamped,), len(self.positions), f"{OWNER}: clamped")
        interface_nodes = chosen(interfaces, len(self.positions), f"{OWNER}: interfaces")
        self._check(interface_nodes, fixed, count, cutoff, stiffening)
        locked = [2, 3, 4] * planar
        free, held = self._freedom(fixed, locked)
        distinct = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.0][: self.per_node], len(self.positions))
        axes = diags_array(distinct).tocsc()[free][:, free]  # distinguishes motions along x, y and z
        motions = rigid_motions(self.positions, self.per_node)
        moves = np.setdiff1d(np.arange(6), locked)
        rigid = motions[np.ix_(free, moves)] if clamped is None else np.zeros((free.size, 0))
        below = None if cutoff is None else (2 * np.pi * positive(cutoff, OWNER, "cutoff")) ** 2
        interface = np.flatnonzero(np.isin(free, self._dofs(interface_nodes)))

        def solve(K: Sparse, M: Sparse) -> tuple[Array, Array]:
            return reduced(K, M, rigid, axes, interface, count, below)

        terms = self._terms
        box = {} if count == 0 else terms.box(free)
        stiffness, inner, error = spanning(*terms.matrices(free, box), solve, rigid, axes)
        _require_modes(len(stiffness), count, cutoff, interface_nodes)
        X = np.zeros((self.K.shape[0], len(stiffness)))
        X[free] = inner * self._signs(inner, free)
        origin = rigid_inertia(motions.T @ (self.M @ motions)).center if clamped is None else self.positions[clamped]
        zeta: Any = damping if is_law(damping) else numbers(damping, OWNER, "damping", (), (len(X.T),))
        D = None
        if stiffening and self.axial is not None:
            D = foreshortening(self.K, free, self.samples, self.axial, X)
        of_structure = self.K, self.M, np.union1d(free, held), motions[:, moves], held
        of_interfaces = max(interface.size - rigid.shape[1], 0)
        flexibility = Flexibility(*of_structure, X, stiffness, self.per_node, of_interfaces)
        modes, shapes = self._modes(stiffness, X, origin, zeta, D, moves if clamped is None else moves[:0])
        if is_law(zeta) or terms.has_laws:
            modes = with_parameters(modes, terms, shapes, zeta, box, error)
        return modes.of_structure(flexibility)

    def _modes(
        self,
        stiffness: Array,
        X: Array,
        origin: Array,
        zeta: Array | ca.SX,
        D: tuple[Array, Array] | None,
        free: Indices,
    ) -> tuple[Modes, Shapes]:
        """Modes with the shapes X (d, n) in a frame at the origin, without their `free` rigid motions."""
        k, n, placed = len(self.positions), len(stiffness), self.positions - origin
        rigid = rigid_motions(placed, self.per_node)
        momentum = self.M @ rigid
        if free.size:
            gram = rigid[:, free].T @ momentum[:, free]
            X = X - rigid[:, free] @ np.linalg.solve(gram, momentum[:, free].T @ X)
        whole, length = rigid_inertia(rigid.T @ momentum), np.abs(placed).max(initial=0)
        placed_shapes = Shapes(X, rigid, origin, None if D is None else D[1], whole, length)
        own = placed_shapes.invariants(self.M, self.samples)
        nodal = X.reshape(k, self.per_node, n)
        shapes, rotations = nodal[:, :3], nodal[:, 3:] if self.per_node == 6 else np.zeros_like(nodal)
        nodal2 = np.zeros((k, 3, n, n)) if D is None else D[0].reshape(k, self.per_node, n, n)[:, :3]
        # Size of each mode. Values that are smaller by many digits are rounding errors.
        size = np.maximum(np.abs(shapes).max(axis=(0, 1)), length * np.abs(rotations).max(axis=(0, 1)))
        ratio = self._terms.middle(zeta) if is_law(zeta) else zeta
        modes = Modes(
            **{name: getattr(own, name) for name in ("mass", "J0", "J1", "J2", "S", "S2", "G0", "G1")},
            center=cleaned(whole.center, length),
            stiffness=stiffness,
            damping=np.asarray(2 * ratio * np.sqrt(stiffness)),
            origin=origin,
            positions=cleaned(placed, length),
            shapes=cleaned(shapes, size),
            rotations=cleaned(rotations, size / length),
            shapes2=cleaned(nodal2, np.abs(nodal2).max(initial=0)),
        )
        return modes, placed_shapes

    def _check(
        self, interfaces: list[int], fixed: list[int], count: int | None, cutoff: float | None, stiffening: bool
    ) -> None:
        if count is not None:
            whole(OWNER, "count", count, 0)
        if count is None and cutoff is None and not interfaces:
            raise DeclarationError(
                f"{OWNER}: the number of modes is missing. Pass count=10, or cutoff=500.0 for all modes below 500 Hz."
            )
        if set(fixed) & set(interfaces):
            raise DeclarationError(f"{OWNER}: node {fixed[0]} is clamped, so it cannot be an interface.")
        if fixed and self.per_node == 3:
            raise DeclarationError(
                f"{OWNER}: node {fixed[0]} has no rotations, so clamping this node does not hold the body. "
                "Omit clamped, and pass the nodes of the clamped face as interfaces."
            )
        if stiffening and not (fixed and self.axial):
            raise DeclarationError(f"{OWNER}: stiffening requires a structure of beams with a clamped node.")

    def _freedom(self, fixed: Sequence[int], locked: Sequence[int]) -> tuple[Indices, Indices]:
        """The free and the clamped degrees of freedom, without the `locked` directions (0 to 5) of all nodes."""
        every, held = np.arange(self.K.shape[0]), self._dofs(fixed)
        moving = every[~np.isin(every % self.per_node, locked)]
        return np.setdiff1d(moving, held), np.intersect1d(moving, held)

    def _dofs(self, nodes: Sequence[int]) -> Indices:
        return (self.per_node * np.array(nodes, dtype=int)[:, None] + np.arange(self.per_node)).ravel()

    def _signs(self, X: Array, dofs: Indices) -> Array:
        """Signs (n,) that make the largest translation in each column of X positive. `dofs` are the rows of X."""
        shapes = X[dofs % self.per_node < 3]
        size = np.abs(shapes)
        first = np.argmax(size >= (1 - SLIGHT) * size.max(axis=0), axis=0)
        return np.where(np.take_along_axis(shapes, first[None], axis=0)[0] < 0, -1.0, 1.0)


def _require_modes(found: int, count: int | None, cutoff: float | None, interfaces: list[int]) -> None:
    if count is not None and cutoff is None and found < count:
        raise DeclarationError(f"{OWNER}: count={count}, but the mesh has only {found} modes. Refine the mesh.")
    if count != 0 and not interfaces and not found:
        raise DeclarationError(f"{OWNER}: no mode is below cutoff={cutoff} Hz. Increase cutoff, or pass count=0.")


def _pairs(given: Any, name: str) -> list[tuple[Expr, Any]]:
    """Pairs (factor, matrix) of a sum of matrices, or of one matrix."""
    if not (isinstance(given, list) and given and all(isinstance(x, tuple) and len(x) == 2 for x in given)):
        return [(1.0, given)]
    owner = f"FiniteElements.matrices: a factor of {name}"
    return [
        (factor if is_law(factor) else float(numbers(factor, owner, "the value")), matrix) for factor, matrix in given
    ]
