"""Frequencies and damping of a scene as a simulator."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from symmb._errors import DeclarationError, SimulationError
from symmb._interrupts import kept_interrupts
from symmb._options import whole
from symmb._types import Array
from symmb.connect import BlackBox
from symmb.equations.model import Box, Scene
from symmb.run.linear.family import LinearFamily
from symmb.run.linear.following import Followed, followed


class ModalSimulator(BlackBox):
    """Frequencies f1, f2, ... [Hz] and damping ratios zeta1, zeta2, ... [-] of a scene at its start, for samples.

    Modes are numbered by their frequencies at the nominal parameters. Each mode is followed to a sample by its shape,
    so that it keeps its number if frequencies cross.

    Parameters
    ----------
    scene : Scene
        a scene that starts in equilibrium, or in a steady motion
    count : int
        number of modes, from the lowest frequency on; if there are fewer modes, all modes

    Raises
    ------
    DeclarationError
        If the scene has no oscillation, or the equations have no derivative at the start

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> p = mb.Parameters(k=100.0)
    >>> mass = mb.Body("mass", mass=1.0, pose=mb.Particle())
    >>> spring = mb.Force("spring", mass.point(0, 0, 0), (-p.k * mass.x, -4 * p.k * mass.y, -9 * p.k * mass.z))
    >>> modal = mb.ModalSimulator(mb.Scene(mb.System(mass, spring, parameters=p)), count=2)
    >>> (2 * np.pi * modal.run(np.array([[100.0], [25.0]])).Y[:, 0, :2]).round(9)
    array([[10., 20.],
           [ 5., 10.]])
    """

    @kept_interrupts()
    def __init__(self, scene: Scene, count: int = 6) -> None:
        count = whole("ModalSimulator", "count", count, 1)
        self.family = LinearFamily(scene)
        self.doubts = self.family.doubts
        self._start = self.family.eigen(self.family.nominal)
        self._modes = np.flatnonzero(self._start[0].oscillating)[:count]
        if not len(self._modes):
            raise DeclarationError(f"ModalSimulator: {scene.name} has no oscillation at its nominal parameters.")
        numbers = range(1, len(self._modes) + 1)
        names = [f"{quantity}{k}" for quantity in ("f", "zeta") for k in numbers]
        found, modes = self._start[0], self._modes
        errors, sizes = found.errors[modes], np.abs(found.values[modes])
        noise = [*errors / (2 * np.pi), *np.where(np.abs(found.values[modes].real) <= errors, 0.0, errors / sizes)]
        self._declare(scene.system.parameters, [0.0], names, dict(zip(names, noise, strict=True)))
        self.units = tuple("Hz" if name.startswith("f") else "1" for name in names)
        self.name, self.scene, self.box = scene.name, self.family.scene, scene.box

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues of the modes (m,) at the nominal parameters, with positive imaginary parts [1/s]."""
        return self._start[0].values[self._modes]

    def response(self, values: Mapping[str, float]) -> Any:
        """Frequencies [Hz] and damping ratios [-], together (1, n_y)."""
        found = self._followed(np.array(list(values.values())))
        reached = found.values[: len(self._modes)]
        if np.isnan(reached).any():
            raise SimulationError(f"mode {int(np.isnan(reached).argmax()) + 1} does not oscillate at these parameters")
        sizes = np.abs(reached)
        return np.concatenate([sizes / (2 * np.pi), 0.0 - reached.real / sizes])[None]

    def crossings(self, box: Box) -> tuple[str, ...]:
        """Sentences about frequencies that cross on straight lines from the nominal parameters to corners of a box.

        A sentence names the first corner with this crossing. Frequencies that come close and separate again keep their
        order, although their modes exchange shapes. Sentences also name modes that exchange shapes in a shortest step.
        """
        nominal, told = self.family.nominal, {}
        names = list(self.parameters)
        numbers = [names.index(name) for name in box.names]
        for corner in corners(box):
            goal = nominal.copy()
            goal[numbers] = corner
            found = self._followed(goal)
            way = f"{self._text(nominal[numbers], box)} and {self._text(corner, box)}"
            for pairs, verb in ((found.crossings, "cross"), (found.veerings, "exchange their shapes")):
                for i, j in sorted(pairs):
                    if min(i, j) < len(self._modes):
                        told.setdefault((i, j, verb), f"f{i + 1} and f{j + 1} {verb} between {way}.")
        return tuple(told.values())

    @staticmethod
    def _text(values: Array, box: Box) -> str:
        return ", ".join(f"{name} = {value:g}" for name, value in zip(box.names, values, strict=True))

    def _followed(self, goal: Array) -> Followed:
        begin = self.family.nominal
        return followed(lambda share: self.family.eigen(begin + share * (goal - begin)), self._start)

    def __repr__(self) -> str:
        return f"ModalSimulator({self.name!r}, count={len(self._modes)})"


def corners(box: Box) -> Array:
    """The corners (n, d) of a box; 64 random corners if there are more than six parameters."""
    d = len(box.names)
    every = product((0, 1), repeat=d) if d <= _EVERY else np.random.default_rng(0).integers(0, 2, (2**_EVERY, d))
    lower, upper = np.array(box.bounds).T
    return np.array([np.where(which, upper, lower) for which in every])


_EVERY = 6
"""Maximum number of parameters for which all corners of a box are used. Each corner takes some linearisations."""
