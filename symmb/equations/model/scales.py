"""Typical magnitudes of a motion. Solvers measure errors relative to these magnitudes."""

from dataclasses import dataclass

from symmb._types import Array


@dataclass(frozen=True)
class Scales:
    """Typical magnitudes of lengths, energies and constraint rows, so that solvers do not depend on units."""

    length: float = 1.0  # [m]
    energy: float = 1.0  # at unit velocity: largest inertia times squared displacement [kg m^2]
    rows: Array | None = None  # (n_r,), change of the rows for displacements of `length`; None if not known: all 1
    states: Array | None = None  # (n_x,), by independent part of the scene; None if not known: `size`
    rate: float = 1.0  # rate of the fastest part [1/s]

    @property
    def work(self) -> float:
        """Factor of the absolute tolerance of work."""
        energy = self.energy * self.rate**2
        # Positive and negative work may cancel except for rounding of the energy, so the scale is at least 1 % of it.
        return max(min(self.size, energy), 0.01 * energy)

    @property
    def size(self) -> float:
        """Factor of absolute tolerances: the length, but at most 1."""
        return min(1.0, self.length)
