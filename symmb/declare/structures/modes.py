"""The modes of a flexible body: all data for its equations of motion, and the file of these data."""

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._magnitudes import NOTHING, SAME
from symmb._types import Array
from symmb.declare.structures.flexibility import Flexibility
from symmb.declare.structures.inertia_invariants import Invariants
from symmb.declare.structures.mass_samples import rigid_motions
from symmb.declare.structures.validation import numbers, positive
from symmb.results import files

LAYOUT = "symmb modes 1"
SHAPES: dict[str, tuple[int | str, ...]] = {
    "mass": (),
    "center": (3,),
    "J0": (3, 3),
    "J1": ("n", 3, 3),
    "J2": ("n", "n", 3, 3),
    "S": (3, "n"),
    "S2": (3, "n", "n"),
    "G0": (3, "n"),
    "G1": ("n", 3, "n"),
    "stiffness": ("n",),
    "damping": ("n",),
    "origin": (3,),
    "positions": ("k", 3),
    "shapes": ("k", 3, "n"),
    "rotations": ("k", 3, "n"),
    "shapes2": ("k", 3, "n", "n"),
}


def nearest(positions: Array, point: tuple[float, float, float]) -> int:
    """Index of the position nearest to a point; the first index if several are equally near."""
    return int(np.argmin(np.linalg.norm(positions - numbers(point, "nearest", "point", (3,)), axis=1)))


@dataclass(frozen=True, eq=False)
class Family:
    """The parts of `ParametricModes` that depend on parameters."""

    masses: tuple[tuple[ca.SX, Invariants], ...]  # the inertia is the sum of the products (factor, invariants)
    stiffness: ca.SX  # (n, n)
    damping: ca.SX  # (n,)
    box: dict[str, tuple[float, float]]  # valid intervals of parameters that change the shapes
    error: float  # see `Modes.error`


@dataclass(frozen=True, eq=False)
class Modes:
    """Inertia invariants, stiffness and shapes of n mass-normalised modes at k nodes.

    In the floating frame a material point is at x = s + u(s). The displacement is u = Σ φ_j η_j + Σ η_i η_j D_ij. D is
    the foreshortening of beams in bending, if requested, else 0. With the frame's velocity v and angular velocity ω in
    its own axes, the energies are

        T = ½ m v² + v·(ω × f(η)) + v·df(η)/dt + ½ ω·J(η) ω + ω·(G0 + Σ η_i G1_i) η̇ + ½ η̇·η̇
        V = ½ Σ stiffness_j η_j²

        f(η) = m c + S η + Σ η_i η_j S2_ij        J(η) = J0 + Σ η_j J1_j + Σ η_i η_j J2_ij

    All arrays are in SI units and in axes of the frame; η is in m √kg. The modal masses are 1.

    Parameters
    ----------
    mass : float
        mass of the body [kg]
    center : (3,)
        centre of mass of the undeformed body, from the frame's origin [m]
    J0 : (3, 3)
        inertia of the undeformed body about the frame's origin [kg m^2]
    J1 : (n, 3, 3)
        first derivative of the inertia by η [kg^½ m]
    J2 : (n, n, 3, 3)
        second-order part of the inertia [1], J2[i, j] = J2[j, i]
    S, S2 : (3, n), (3, n, n)
        linear and quadratic part of the first moment [kg^½], [1/m]; S is 0 in the floating frame
    G0, G1 : (3, n), (n, 3, n)
        angular momentum about the origin for unit η̇ [kg^½ m], [1]
    stiffness : (n,)
        squared circular frequencies ω_j² [1/s^2]
    damping : (n,)
        damping coefficients 2 ζ_j ω_j [1/s]
    origin : (3,)
        origin of the frame, in the axes of the mesh [m]
    positions : (k, 3)
        nodes of the undeformed body, from the frame's origin [m]
    shapes : (k, 3, n)
        translations of the nodes [kg^-½]
    rotations : (k, 3, n)
        small rotations of the nodes [1/(kg^½ m)]; 0 if the source has no rotations
    shapes2 : (k, 3, n, n)
        foreshortening D of the nodes [1/(kg m)]

    Raises
    ------
    DeclarationError
        If an array has a wrong shape or is not finite, if J0 or J2 is not symmetric, or if mass, stiffness or damping
        has the wrong sign.

    Examples
    --------
    >>> import symmb as mb
    >>> steel = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
    >>> beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), steel, elements=8)
    >>> modes = mb.FiniteElements.beams(beam).modes(count=2)
    >>> (modes.stiffness**0.5).round(0)
    array([1152., 1152.])

    References
    ----------
    A. A. Shabana, Dynamics of Multibody Systems, 4th ed., Cambridge 2013, ch. 5.
    """

    mass: float
    center: Array
    J0: Array
    J1: Array
    J2: Array
    S: Array
    S2: Array
    G0: Array
    G1: Array
    stiffness: Array
    damping: Array
    origin: Array
    positions: Array
    shapes: Array
    rotations: Array
    shapes2: Array

    family: ClassVar[Family | None] = None
    """The expressions of `ParametricModes`; None if the modes have no parameters."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", positive(self.mass, "Modes", "mass"))
        for name, shape in _shapes(self.stiffness, self.positions).items():
            if shape:
                object.__setattr__(self, name, numbers(getattr(self, name), "Modes", name, shape))
        for name, other in (("J0", self.J0.T), ("J2", self.J2.swapaxes(0, 1)), ("J2", self.J2.swapaxes(2, 3))):
            array = getattr(self, name)
            if not np.allclose(array, other, rtol=0, atol=SAME * np.abs(array).max(initial=0)):
                raise DeclarationError(f"Modes: {name} must be symmetric. Use the mean of matrix and transpose.")
        if (self.stiffness <= 0).any():
            raise DeclarationError(
                f"Modes: stiffness must be above 0, got {self.stiffness.min():g}. "
                "Remove rigid modes, because the frame already describes rigid motions."
            )
        if (self.damping < 0).any():
            raise DeclarationError(f"Modes: damping must not be negative, got {self.damping.min():g}.")

    @property
    def frequencies(self) -> Array:
        """Natural frequencies in the frame (n,) [Hz]."""
        return np.sqrt(self.stiffness) / (2 * np.pi)

    def _repr_html_(self) -> str:
        omega, nodes = np.sqrt(self.stiffness), len(self.positions)
        pairs = zip(self.frequencies.tolist(), (self.damping / (2 * omega)).tolist(), strict=True)
        rows = [[str(k), f"{f:.6g}", f"{zeta:.4g}"] for k, (f, zeta) in enumerate(pairs, 1)]
        head = html.text(f"Modes of a body of {self.mass:g} kg at {nodes} node{'s' * (nodes != 1)}")
        return html.page(head, html.table([["mode", "frequency [Hz]", "damping [-]"], *rows]))

    @property
    def error(self) -> float:
        """Relative error of squared frequencies, and of deflections under loads at interfaces, caused by parameters.

        The modes are compared with modes that are computed at points of the box. The error is twice the largest
        difference. A frequency below the frequency of these modes is not an error, because the frequency of the full
        structure is even lower. The error is 0 if no parameter changes the shapes.
        """
        return 0.0 if self.family is None else self.family.error

    @property
    def masses(self) -> tuple[tuple[ca.SX, Invariants], ...]:
        """Pairs (expression, Invariants). The inertia is the sum of the products of the pairs."""
        if self.family is not None:
            return self.family.masses
        same = {name: getattr(self, name) for name in ("mass", "J0", "J1", "J2", "S", "S2", "G0", "G1")}
        return ((ca.SX(1), Invariants(**same, moment=self.mass * self.center, modal=np.eye(len(self.stiffness)))),)

    @property
    def flexibility(self) -> Flexibility | None:
        """The structure, for checks of deformations that the modes leave out; None for modes from a file."""
        return _STRUCTURES.get(self)

    def of_structure(self, structure: Flexibility) -> "Modes":
        """The same modes, with the structure as `flexibility`. Files of modes do not contain the structure."""
        _STRUCTURES[self] = structure
        return self

    @property
    def is_stiffening(self) -> bool:
        """Whether the modes have foreshortening, so axial loads stiffen the body."""
        return bool(self.S2.any() or self.shapes2.any())

    def turns(self, eta: Array) -> Array:
        """Largest rotation (m,) of a node relative to the frame [rad] for modal coordinates (m, n).

        If nodes have no rotations, the rotation is estimated from the chords of the body.
        """
        if self.rotations.any() or len(self.positions) < 2:
            turned = np.einsum("kan,mn->mka", self.rotations, eta)
        else:
            turned = np.einsum("kan,mn->mka", self._turning_lines, eta)
        return np.linalg.norm(turned, axis=2).max(axis=1, initial=0.0)

    def carried(self, nodes: list[int], eta: Array) -> Array:
        """Motions (N, m, 6, 6) of m nodes for unit motions of the frame, at modal coordinates (N, n)."""
        positions = self.positions[nodes] + np.einsum("kan,Nn->Nka", self.shapes[nodes], eta)
        return rigid_motions(positions.reshape(-1, 3), 6).reshape(*positions.shape[:2], 6, 6)

    @cached_property
    def _turning_lines(self) -> Array:
        """Estimated rotations (k, 3, n) of nodes without rotations, from the chord of each node to a far end."""
        s, first = self.positions, int(np.argmax(np.linalg.norm(self.positions - self.positions.mean(axis=0), axis=1)))
        ends = np.array([first, int(np.argmax(np.linalg.norm(s - s[first], axis=1)))])
        other = ends[np.linalg.norm(s[:, None] - s[ends], axis=2).argmax(axis=1)]
        line, moved = s[other] - s, self.shapes[other] - self.shapes
        squared = np.maximum((line**2).sum(axis=1), NOTHING)
        # If a load acts at the end of a cantilever, this end rotates 1.5 times as far as the chord.
        return 1.5 * np.cross(line[:, :, None], moved, axis=1) / squared[:, None, None]

    @cached_property
    def lively(self) -> Array:
        """Projection (6, 6) of the force and moment at a node onto the directions in which modes move nodes."""
        projection = np.zeros((6, 6))
        for shapes, at in ((self.shapes, slice(0, 3)), (self.rotations, slice(3, 6))):
            sizes, axes = np.linalg.eigh(np.einsum("kan,kbn->ab", shapes, shapes))
            # `sizes` are squared motions. Smaller values are rounding errors.
            moving = axes[:, sizes > 1e-18 * sizes.max(initial=NOTHING)]
            projection[at, at] = moving @ moving.T
        return projection

    def nearest(self, x: float, y: float, z: float = 0.0) -> int:
        """Number of the undeformed node nearest to (x, y, z) [m] in the frame; the first of equally near nodes."""
        return nearest(self.positions, (x, y, z))

    def save(self, path: str | PathLike[str]) -> None:
        """Write an .npz or .json file with one array for each field, by name, and the text `layout`.

        Raises
        ------
        DeclarationError
            If the name of the file does not end with .npz or .json.
        """
        record = {"layout": LAYOUT, **{name: getattr(self, name) for name in SHAPES}}
        files.save(path, {"record": lambda: record, "entries": lambda: files.in_json(record)})

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Modes":
        """Read a file in the layout of `save`. Another program may have written the file.

        Raises
        ------
        DeclarationError
            If the file is damaged, an array is missing or unknown, or the arrays do not fit together.
        """
        return files.load(path, "saved Modes", cls._of_record)

    @classmethod
    def _of_record(cls, record: files.Record) -> "Modes":
        record.text("layout", LAYOUT)
        arrays = {name: value for name, value in record.plain.items() if name != "layout"}
        if arrays.keys() != SHAPES.keys():
            missing, unknown = sorted(SHAPES.keys() - arrays.keys()), sorted(arrays.keys() - SHAPES.keys())
            raise DeclarationError(
                f"missing arrays: {missing}; unknown arrays: {unknown}. The file must have one array "
                f"for each of {', '.join(SHAPES)}."
            )
        shapes = _shapes(arrays["stiffness"], arrays["positions"])
        values: dict[str, Any] = {name: record.array(name, *shapes[name]) for name in list(SHAPES)[1:]}
        return cls(mass=float(record.array("mass")), **values)


def _shapes(stiffness: Any, positions: Any) -> dict[str, tuple[int, ...]]:
    sizes = {"n": np.size(stiffness), "k": len(np.atleast_1d(positions))}
    return {
        name: tuple(sizes[size] if isinstance(size, str) else size for size in shape) for name, shape in SHAPES.items()
    }


_STRUCTURES: WeakKeyDictionary[Modes, Flexibility] = WeakKeyDictionary()
"""The structures of modes. A structure is not part of the data of its modes."""
