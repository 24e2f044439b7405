"""Typical sizes of a motion, by which solvers measure errors."""

from dataclasses import dataclass

from symmb._types import Array

_SHARE_OF_ENERGY = 1e-2
"""Share of the energy of a motion to which its work is integrated: works that cancel leave rounding of this energy."""


@dataclass(frozen=True)
class Scales:
    """Typical sizes of lengths, energies and rows of constraints. They make solvers independent of units.

    Attributes
    ----------
    length : float          [m]
    energy : float          of the unit of velocity: largest inertia times squared displacement [kg m^2]
    rows : (n_r,) array     rates of the rows at displacements of `of_length`, all 1 if not known
    states : (n_x,) array   of each state: parts of a scene that do not act on each other have their own; `size` if
                            not known
    rate : float            of the fastest part [1/s]
    """

    length: float = 1.0
    energy: float = 1.0
    rows: Array | None = None
    states: Array | None = None
    rate: float = 1.0

    @property
    def work(self) -> float:
        """Factor of the absolute tolerance of work."""
        energy = self.energy * self.rate**2
        return max(min(self.size, energy), _SHARE_OF_ENERGY * energy)

    @property
    def size(self) -> float:
        """Factor of absolute tolerances: the length, but at most 1."""
        return min(1.0, self.length)
