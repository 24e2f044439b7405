"""The result of a linearisation: matrices, eigenvalues and modes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, WithWarnings
from symmb._names import look_up_by_name
from symmb._options import is_whole, optional_package
from symmb._table import aligned
from symmb._types import Array
from symmb.results.files import NAMES, NOT_KEPT, Record, Saved, entry, in_json
from symmb.run.linear.eigenvalues import Eigenvalues, eigenvalues
from symmb.run.linear.motion import Origin
from symmb.run.simulation import Trajectory

if TYPE_CHECKING:
    from scipy.signal import StateSpace

_MOST, _LEAST = 3, 0.1
"""Maximum number of printed displacements of a mode, and smallest printed displacement, divided by the largest one."""
_HEAD, _LEFT = ("mode", "frequency [Hz]", "damping [-]", "moves most"), (0, 3)


@dataclass(frozen=True, eq=False)
class Mode:
    """An oscillation of a linearised scene.

    Attributes
    ----------
    eigenvalue : complex       eigenvalue with positive imaginary part [1/s]
    frequency : float          |eigenvalue| / 2 pi [Hz], the frequency of the undamped oscillation
    damping : float            damping ratio, negative if the oscillation grows [-]
    shape : dict               name of a displacement of a body, such as "rod.theta" -> complex amplitude [m, rad]; the
                               largest amplitude is 1
    """

    eigenvalue: complex
    shape: dict[str, complex]

    __post_init__ = look_up_by_name

    @property
    def frequency(self) -> float:
        return abs(self.eigenvalue) / (2 * np.pi)

    @property
    def damping(self) -> float:
        return 0.0 if not self.eigenvalue.real else -self.eigenvalue.real / abs(self.eigenvalue)

    @property
    def text(self) -> str:
        """The largest displacements as text. The first has the amplitude 1; others have amplitude and phase."""
        largest = sorted(self.shape.items(), key=lambda item: -round(abs(item[1]), 9))  # equal ones keep their order
        words = [_displacement_text(*item) for item in largest[:_MOST] if abs(item[1]) >= _LEAST]
        return ", ".join([largest[0][0], *words[1:]])


def _displacement_text(name: str, amplitude: complex) -> str:
    phase = round(np.degrees(np.angle(amplitude)))
    return f"{name} {abs(amplitude):.2g}" + (f" at {phase:d} deg" if phase else "")


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(WithWarnings, Saved):
    """Linear equations x' = A x + B u, y = C x + D u of small deviations from a state, and their eigenvalues.

    `print` shows the modes. `save` writes a file, and `load` reads it.

    Attributes
    ----------
    name : str
        name of the scene
    A, B, C, D : (n, n), (n, n_u), (n_y, n), (n_y, n_u) arrays
    states : tuple of str
        names of independent displacements, velocities and first-order states
    inputs, outputs : tuple of str
    eigenvalues : (n,) complex
        eigenvalues, sorted by size [1/s]
    frequencies, damping
        frequencies [Hz] and damping ratios [-] of the modes
    modes : tuple of Mode
        oscillations, sorted by frequency
    time : float
        time of the state [s]
    parameters : dict
        values of the parameters by name
    doubts : tuple of str
        warnings, as sentences
    shapes : (n_b, n) array
        displacements of the bodies for unit states
    displacements
        names of the n_b displacements
    origin
        scene and state; None after `load`

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> found = mb.linearize(mb.Scene(system, {"bob.x": 0.0, "bob.y": 0.0, "bob.z": 0.0}))
    >>> found.frequencies.round(4)
    array([0.3183, 0.3183, 0.3183])
    """

    name: str = field(metadata=entry(name="scene"))
    A: Array = field(metadata=entry(Record.array, "states", "states"))
    B: Array = field(metadata=entry(Record.array, "states", "inputs"))
    C: Array = field(metadata=entry(Record.array, "names", "states"))
    D: Array = field(metadata=entry(Record.array, "names", "inputs"))
    states: tuple[str, ...] = field(metadata=NAMES)
    inputs: tuple[str, ...] = field(metadata=NAMES)
    outputs: tuple[str, ...] = field(metadata=entry(Record.names, name="names"))
    time: float
    parameters: dict[str, float]
    doubts: tuple[str, ...]
    shapes: Array = field(metadata=entry(Record.array, "displacements", "states"))
    displacements: tuple[str, ...] = field(metadata=NAMES)
    origin: Origin | None = field(default=None, metadata=NOT_KEPT)

    __post_init__ = look_up_by_name

    @cached_property
    def _eigen(self) -> Eigenvalues:
        return eigenvalues(self.A)

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues (n,), complex, sorted by size [1/s]."""
        return self._eigen.values

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """The oscillations, sorted by frequency."""
        modes, eigen = [], self._eigen
        for k in np.flatnonzero(eigen.oscillating):
            shape = self.shapes @ eigen.vectors[:, k]
            largest = shape[np.abs(shape).argmax()] if shape.any() else 1.0
            value = complex(eigen.values[k])
            if abs(value.real) <= eigen.errors[k]:
                value = complex(0.0, value.imag)
            modes.append(Mode(value, dict(zip(self.displacements, (shape / largest).tolist(), strict=True))))
        return tuple(modes)

    @property
    def frequencies(self) -> Array:
        """Frequencies (m,) of the modes [Hz]."""
        return np.array([mode.frequency for mode in self.modes])

    @property
    def damping(self) -> Array:
        """Damping ratios (m,) of the modes [-]."""
        return np.array([mode.damping for mode in self.modes])

    @property
    def stability(self) -> str:
        """ "unstable", "asymptotically stable", or "not asymptotically stable" with the undamped modes."""
        eigen = self._eigen
        if (eigen.values.real > eigen.errors).any():
            return "unstable"
        undamped = np.abs(eigen.values.real) <= eigen.errors
        if not undamped.any():
            return "asymptotically stable"
        zero = int(np.count_nonzero(eigen.values == 0))
        pairs = int(np.count_nonzero(undamped & eigen.oscillating))
        counted = ((pairs, "undamped oscillation"), (zero, "zero eigenvalue"))
        parts = [f"{count} {noun}{'s' * (count > 1)}" for count, noun in counted if count]
        return f"not asymptotically stable: {' and '.join(parts)}"

    def motion(self, number: int) -> Trajectory:
        """A mode as a motion that `view` can animate. The first mode has the number 0.

        The motion oscillates about the state without damping, with a visible amplitude. Joints remain closed.

        Raises
        ------
        DeclarationError
            If the mode does not exist, or the result was read from a file
        """
        if self.origin is None:
            raise DeclarationError(
                "This linearisation was read from a file, and its scene is not known. Call linearize again for motions."
            )
        modes = self.modes
        if not is_whole(number) or not 0 <= number < len(modes):
            known = f"0 to {len(modes) - 1}" if modes else "none"
            raise DeclarationError(f"{self.name} has no mode {number!r}. Numbers of modes: {known}.")
        k = np.flatnonzero(self._eigen.oscillating)[number]
        label = f"{self.name}, mode {number + 1}, {modes[number].frequency:.4g} Hz"
        vector = self._eigen.vectors[:, k]
        return self.origin.motion(label, complex(self._eigen.values[k]), vector, self.shapes @ vector)

    def to_scipy(self) -> "StateSpace":
        """The equations as a `scipy.signal.StateSpace`.

        Raises
        ------
        DeclarationError
            If there is no state, input or output
        """
        from scipy.signal import StateSpace  # loading takes a second, and few users need it

        self._require_all("to_scipy")
        return StateSpace(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """The equations as a `control.StateSpace` of the package control, with names of states, inputs and outputs.

        Raises
        ------
        DeclarationError
            If there is no state, input or output
        ImportError
            If control is not installed
        """
        control = optional_package("control", "to_control", "control")
        self._require_all("to_control")
        names = {kind: _plain(getattr(self, kind)) for kind in ("states", "inputs", "outputs")}
        return control.ss(self.A, self.B, self.C, self.D, name=_plain([self.name])[0], **names)

    def _require_all(self, owner: str) -> None:
        for kind in ("states", "inputs", "outputs"):
            if not getattr(self, kind):
                remedy = f" Pass {kind}=[...] to linearize." if kind != "states" else ""
                raise DeclarationError(f"{owner}: the linearisation of {self.name} has no {kind}.{remedy}")

    def __str__(self) -> str:
        table = aligned(self._rows(), left=_LEFT) if self.modes else []
        return "\n".join([self._head(), *table, *self._foot()])

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        table = html.table(self._rows(), _LEFT) if self.modes else ""
        return html.page(html.text(self._head()), table, html.text("\n".join(self._foot())))

    def _head(self) -> str:
        n = len(self.states)
        return f"{self.name}: linearised at {self.time:g} s, {n} state{'s' * (n != 1)}, {self.stability}"

    def _rows(self) -> list[list[str]]:
        lines = [
            [str(number), f"{mode.frequency:.6g}", f"{mode.damping:.4g}", mode.text]
            for number, mode in enumerate(self.modes, 1)
        ]
        return [[*_HEAD], *lines]

    def _foot(self) -> list[str]:
        eigen = self._eigen
        real = eigen.values.real[(eigen.values != 0) & (np.abs(eigen.values.imag) <= eigen.errors)]
        lines = [f"real eigenvalues [1/s]: {', '.join(f'{value:.6g}' for value in real)}"] if len(real) else []
        return [*lines, *(f"warning: {doubt}" for doubt in self.doubts)]

    def to_json(self) -> dict[str, Any]:
        """Matrices, eigenvalues and modes as lists, texts and numbers. Complex numbers are pairs (real, imaginary)."""
        modes = [
            {
                "frequency": mode.frequency,
                "damping": mode.damping,
                "eigenvalue": _pair(mode.eigenvalue),
                "shape": {name: _pair(amplitude) for name, amplitude in mode.shape.items()},
            }
            for mode in self.modes
        ]
        values = [_pair(value) for value in self.eigenvalues.tolist()]
        return in_json(self._named_record()) | {"eigenvalues": values, "modes": modes, "stability": self.stability}


def _plain(names: Sequence[str]) -> list[str]:
    """Names with "_" for each dot, because the package control does not allow dots in names."""
    return [name.replace(".", "_") for name in names]


def _pair(value: complex) -> list[float]:
    return [value.real, value.imag]
