"""Oscillations along the values of one parameter, also for samples of the other parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from symmb._errors import SimulationError
from symmb._names import ByName
from symmb._types import Array
from symmb._units import units_of_parameters
from symmb.connect import BlackBox
from symmb.run.linear.eigenvalues import Eigenvalues
from symmb.run.linear.family import LinearFamily
from symmb.run.linear.following import followed

QUANTITIES = ("f", "zeta", "re", "im")
"""Frequency [Hz], damping [-], and real and imaginary part [1/s] of an oscillation."""


@dataclass(frozen=True, eq=False)
class Locus:
    """Eigenvalues at n values of a parameter.

    Attributes
    ----------
    values : (n,)              values of the parameter
    points : n pairs           eigenvalues at a value, and the shapes of their modes
    numbers : n dicts          number of an eigenvalue -> number of its oscillation; oscillations that appear later have
                               larger numbers
    count : int                number of oscillations
    remarks : tuple of str     sentences about frequencies that cross, and modes that exchange their shapes
    """

    values: Array
    points: list[tuple[Eigenvalues, Array]]
    numbers: list[dict[int, int]]
    count: int
    remarks: tuple[str, ...]

    @property
    def modes(self) -> Array:
        """Complex eigenvalues (n, k) of the oscillations [1/s]; nan if an oscillation does not exist at a value."""
        modes = np.full((len(self.values), self.count), np.nan, dtype=complex)
        for i, own in enumerate(self.numbers):
            modes[i, list(own.values())] = self.points[i][0].damped[list(own)]
        return modes


def nominal_locus(family: LinearFamily, parameter: str, values: Array) -> Locus:
    """The locus at nominal values of the other parameters. SimulationError is raised if the scene does not start."""
    number = list(family.scene.system.parameters).index(parameter)
    P = np.tile(family.nominal, (len(values), 1))
    P[:, number] = values
    points = family.eigen_of(P)
    numbers = [{place: k for k, place in enumerate(_oscillations(points[0]))}]
    count, remarks = len(numbers[0]), {}
    for i in range(1, len(values)):
        before = numbers[-1]
        found = followed(_way(family, P[i - 1], P[i], points[i]), points[i - 1])
        now = {int(place): mode for place, mode in zip(found.places, before.values(), strict=True) if place >= 0}
        begun = [place for place in _oscillations(points[i]) if place not in now]
        now |= {place: count + k for k, place in enumerate(begun)}
        count += len(begun)
        numbers.append({place: now[place] for place in sorted(now)})
        known = list(before.values())
        for pairs, verb in ((found.crossings, "cross"), (found.veerings, "exchange their shapes")):
            for j, k in sorted(pairs):
                text = f"f{known[j] + 1} and f{known[k] + 1} {verb}"
                remarks.setdefault(text, f"{text} between {parameter} = {values[i - 1]:g} and {values[i]:g}.")
    return Locus(values, points, numbers, count, tuple(remarks.values()))


def _oscillations(point: tuple[Eigenvalues, Array]) -> list[int]:
    return np.flatnonzero(point[0].oscillating).tolist()


def _way(
    family: LinearFamily, begin: Array, end: Array, at_end: tuple[Eigenvalues, Array]
) -> Callable[[float], tuple[Eigenvalues, Array]]:
    """A function of a fraction of the line between two sets of parameters -> eigenvalues and shapes.

    `at_end` has the eigenvalues and shapes at the end, which are known already.
    """
    return lambda share: at_end if share == 1.0 else family.eigen(begin + share * (end - begin))


class LocusSimulator(BlackBox):
    """Frequencies, damping, real and imaginary parts of the oscillations of a locus, for samples of other parameters.

    The times of this simulator are values of the locus parameter. Each oscillation is followed from the nominal
    parameters to the sample.

    Attributes
    ----------
    known : (n, k)         mask of the oscillations that samples must have; results of other oscillations are 0
    """

    def __init__(self, family: LinearFamily, parameter: str, locus: Locus) -> None:
        names = list(family.scene.system.parameters)
        self._family, self._parameter, self._number = family, parameter, names.index(parameter)
        self._locus, self.known = locus, ~np.isnan(locus.modes)
        self.name = family.scene.name
        own = family.scene.system.parameters
        others = ByName({name: own[name] for name in own if name != parameter}, units_of_parameters(own))
        numbers = range(1, locus.count + 1)
        self._declare(others, locus.values, [f"{what}{k}" for what in QUANTITIES for k in numbers], None)
        self.units = tuple(unit for unit in ("Hz", "1", "1/s", "1/s") for _ in numbers)

    def restrict(self, P: Array) -> None:
        """Remove from `known` the oscillations that some sample of P (N, d) does not have."""
        for row in P:
            self.known &= ~np.isnan(self._followed(row))

    def response(self, values: Mapping[str, float]) -> Any:
        """Frequencies [Hz], damping [-], real and imaginary parts [1/s], together (n, 4 k)."""
        modes = self._followed(np.array(list(values.values())))
        lost = np.argwhere(self.known & np.isnan(modes))
        if len(lost):
            i, k = lost[0]
            raise SimulationError(f"mode {k + 1} does not oscillate at {self._parameter} = {self._locus.values[i]:g}")
        found: Array = np.where(self.known, modes, 0.0)
        sizes = np.abs(found)
        damping = np.divide(0.0 - found.real, sizes, out=np.zeros_like(sizes), where=self.known)
        return np.hstack([sizes / (2 * np.pi), damping, found.real, found.imag])

    def _followed(self, others: Array) -> Array:
        """Complex eigenvalues (n, k) [1/s]; nan if an oscillation ends between nominal parameters and the sample."""
        n = len(self._locus.values)
        begin = np.tile(self._family.nominal, (n, 1))
        end = np.tile(np.insert(others, self._number, 0.0), (n, 1))
        begin[:, self._number] = end[:, self._number] = self._locus.values
        points = self._family.eigen_of(end)
        modes = np.full(self.known.shape, np.nan, dtype=complex)
        for i, (start, own) in enumerate(zip(self._locus.points, self._locus.numbers, strict=True)):
            found = followed(_way(self._family, begin[i], end[i], points[i]), start)
            modes[i, list(own.values())] = found.values
        return modes
