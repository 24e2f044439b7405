"""Typical sizes of a motion, by which solvers measure errors."""

from dataclasses import dataclass

from symmb._types import Array

_SHARE_OF_ENERGY = 1e-2
"""Share of the energy of a motion to which its work is integrated: works that cancel leave rounding of this energy."""


@dataclass(frozen=True)
class Scales:
    """Typical sizes of lengths, energies and rows of constraints. They make solvers independent of units."""

    length: float = 1.0  # [m]
    energy: float = 1.0  # of the unit of velocity: largest inertia times squared displacement [kg m^2]
    rows: Array | None = None  # (n_r,), rates of the rows at displacements of `length`; all 1 if not known
    states: Array | None = None  # (n_x,), those of each part that acts on no other one; `size` if not known
    rate: float = 1.0  # of the fastest part [1/s]

    @property
    def work(self) -> float:
        """Factor of the absolute tolerance of work."""
        energy = self.energy * self.rate**2
        return max(min(self.size, energy), _SHARE_OF_ENERGY * energy)

    @property
    def size(self) -> float:
        """Factor of absolute tolerances: the length, but at most 1."""
        return min(1.0, self.length)
