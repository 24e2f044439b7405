"""Linearisation of a scene at its start, or of a run at a time."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from symmb._errors import DeclarationError, warn_of
from symmb._labelled import Result
from symmb._names import did_you_mean
from symmb._table import aligned
from symmb._types import Array, Indices
from symmb.linear.eigenvalues import Eigenvalues, eigenvalues
from symmb.linear.inputs import with_inputs
from symmb.linear.linear_equations import Blocks, LinearEquations, independent, lifts
from symmb.linear.point import point_of, require_smooth, started, steadiness
from symmb.model import DAE, Scene
from symmb.simulation import Formulation, Trajectory, formulations


@dataclass(frozen=True, eq=False)
class Mode:
    """An oscillation of a linearised scene.

    Attributes
    ----------
    eigenvalue : complex       with positive imaginary part [1/s]
    frequency : float          |eigenvalue| / 2 pi [Hz], that of the undamped oscillation
    damping : float            share of the critical damping, negative if the oscillation grows [-]
    shape : dict               complex amplitudes of the bodies' displacements [m, rad] by name, as "rod.theta"; the
                               largest one is 1
    """

    eigenvalue: complex
    shape: dict[str, complex]

    @property
    def frequency(self) -> float:
        return abs(self.eigenvalue) / (2 * np.pi)

    @property
    def damping(self) -> float:
        return 0.0 if not self.eigenvalue.real else -self.eigenvalue.real / abs(self.eigenvalue)


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(Result):
    """Linear equations x' = A x + B u, y = C x + D u of small deviations from a state, and their eigenvalues.

    Attributes
    ----------
    A, B, C, D : (n, n), (n, n_u), (n_y, n), (n_y, n_u) arrays
    states : tuple of str          names of independent displacements, velocities and first-order states
    inputs, outputs : tuple of str
    eigenvalues : (n,) complex     by size [1/s]
    frequencies, damping           of the modes [Hz], [-]
    modes : tuple of Mode          oscillations by frequency
    time : float                   [s]
    parameters : dict              values
    doubts : tuple of str          what cannot be trusted
    shapes : (n_b, n) array        displacements of the bodies for the states
    displacements                  their n_b names
    """

    name: str
    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    time: float
    parameters: dict[str, float]
    doubts: tuple[str, ...]
    shapes: Array
    displacements: tuple[str, ...]

    @cached_property
    def _eigen(self) -> Eigenvalues:
        return eigenvalues(self.A)

    @property
    def eigenvalues(self) -> Array:
        """(n,) complex, by size [1/s]."""
        return self._eigen.values

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Oscillations by frequency."""
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
        """Of the modes [Hz]."""
        return np.array([mode.frequency for mode in self.modes])

    @property
    def damping(self) -> Array:
        """Of the modes, as shares of the critical one [-]."""
        return np.array([mode.damping for mode in self.modes])

    @property
    def stability(self) -> str:
        """ "unstable", "asymptotically stable", or what lies on the imaginary axis."""
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

    def __str__(self) -> str:
        eigen, lines = self._eigen, []
        real = eigen.values.real[(eigen.values != 0) & (np.abs(eigen.values.imag) <= eigen.errors)]
        rows = [["mode", "frequency [Hz]", "damping [-]", "moves most"]]
        for number, mode in enumerate(self.modes, 1):
            most = max(mode.shape, key=lambda name: abs(mode.shape[name]))
            rows.append([str(number), f"{mode.frequency:.6g}", f"{mode.damping:.4g}", most])
        lines += [f"{self.name}: linearised at {self.time:g} s, {len(self.states)} states, {self.stability}"]
        lines += aligned(rows, left=(0, 3)) if self.modes else []
        lines += [f"real eigenvalues [1/s]: {', '.join(f'{value:.6g}' for value in real)}"] if len(real) else []
        lines += [f"doubtful: {doubt}" for doubt in self.doubts]
        return "\n".join(lines)


def linearize(
    subject: Scene | Trajectory,
    time: float | None = None,
    parameters: Mapping[str, float] | None = None,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] | None = None,
) -> Linearization:
    """Linearise a scene at its start, or a run at one of its times.

    Derivatives are exact. The constraints are eliminated: the states are independent displacements and velocities, and
    first-order states.

    Parameters
    ----------
    subject : Scene or Trajectory      a scene that starts in equilibrium or in a steady motion, or a run
    time : float, optional             an output time of the run [s]; default: its last one
    parameters : mapping, optional     values in place of the nominal ones, of a scene
    inputs : names                     of actuators, which get an additional force or torque, or of parameters
    outputs : names, optional          of outputs; default: all of the scene

    Raises
    ------
    DeclarationError       if a name is unknown, an input moves constraints, or the equations have no derivative there
    AssemblyError, SimulationError     if the scene does not start

    Examples
    --------
    >>> import symmb as mb
    >>> rod = mb.Body("rod", mass=3.0, inertia=1.0)
    >>> pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, 1))
    >>> scene = mb.Scene(mb.System(rod, pin, mb.Gravity(0, -9.81)), equilibrium=True)
    >>> lin = linearize(scene)
    >>> float((2 * np.pi * lin.frequencies[0]) ** 2 * 4 / 3 / 9.81)  # inertia 4 kg m^2 about the pin
    1.0
    """
    scene, values, t, of_bodies = point_of(subject, time, parameters)
    chosen = _numbers(scene.output_names if outputs is None else outputs, scene.output_names)
    extended, input_numbers = with_inputs(scene, inputs)
    formulation = formulation_of(extended)
    p = np.array([*values.values(), *[0.0] * (len(extended.system.parameters) - len(values))])
    point = started(extended, formulation, p, t, of_bodies)
    equations = LinearEquations(formulation, input_numbers)
    require_smooth(formulation, point, equations)
    blocks = equations.blocks(point.x[None], p[None], t)
    _require_free_inputs(inputs, blocks)
    free = free_states(equations, blocks)
    lift = lifts(blocks, free)[0]
    A = (blocks.A[0] @ lift)[free]
    result = Linearization(
        name=scene.name,
        A=A,
        B=blocks.B[0][free],
        C=(blocks.C[0] @ lift)[chosen],
        D=blocks.D[0][chosen],
        states=tuple(state_names(formulation.dae)[k] for k in free),
        inputs=tuple(inputs),
        outputs=tuple(scene.output_names[k] for k in chosen),
        time=t,
        parameters=values,
        doubts=steadiness(equations, point, A, free),
        shapes=blocks.bodies[0] @ lift,
        displacements=displacement_names((formulation.bodies or formulation).dae),
    )
    warn_of(result.doubts, f"linearize({scene.name})")
    return result


def formulation_of(scene: Scene) -> Formulation:
    """The scene in coordinates of its joints if it has some: these do not turn with bodies that spin in a joint."""
    if scene.coordinates is None and scene.system.joint_space().joints.names:
        with suppress(DeclarationError):
            scene = replace(scene, coordinates="joint")
            return cast(Formulation, formulations(scene)[1])
    bodies, joints, _ = formulations(replace(scene, coordinates="body") if scene.coordinates is None else scene)
    return joints or bodies


def _numbers(names: Sequence[str], known: Sequence[str]) -> list[int]:
    if isinstance(names, str):
        raise DeclarationError(f'outputs: expected a list of names, got the text {names!r}. Write ["{names}"].')
    for name in names:
        if name not in known:
            raise DeclarationError(f"outputs: no output {name!r}.{did_you_mean(str(name), known)}")
    return [list(known).index(name) for name in names]


def _require_free_inputs(inputs: Sequence[str], blocks: Blocks) -> None:
    """DeclarationError if an input moves constraints: states would depend on its rate."""
    moved = np.abs(blocks.row_inputs[0]).max(axis=0, initial=0.0)
    for name, size in zip(inputs, moved, strict=True):
        if size > _MOVED * np.abs(blocks.rows[0]).max(initial=0.0):
            raise DeclarationError(
                f"linearize: input {name!r} moves constraints, such as a length or a place. Inputs are forces, or "
                "parameters of forces."
            )


def free_states(equations: LinearEquations, blocks: Blocks) -> Indices:
    """Numbers of independent displacements, velocities and first-order states, without the flags of closed impacts.

    Raises
    ------
    DeclarationError       if there are none
    """
    dae = equations.dae
    flags = 2 * dae.n_v + dae.impacts.closed if dae.impacts is not None else np.zeros(0, dtype=np.intp)
    free = np.setdiff1d(independent(blocks, equations.sizes), flags)
    if not len(free):
        raise DeclarationError("linearize: the scene has no state that can deviate: nothing in it moves freely.")
    return free


def state_names(dae: DAE) -> tuple[str, ...]:
    """Names of displacements, velocities and first-order states."""
    return (*displacement_names(dae), *dae.v_names, *dae.s_names)


def displacement_names(dae: DAE) -> tuple[str, ...]:
    """Names of displacements along velocities: "rod.x" for "rod.vx", "top.rotation_x" for "top.omega_x"."""
    return tuple(_displacement(name) for name in dae.v_names)


def _displacement(v_name: str) -> str:
    owner, _, part = v_name.rpartition(".")
    part = _DISPLACEMENTS.get(part, part.removesuffix("_rate").removesuffix("_dot").replace("omega_", "rotation_"))
    return f"{owner}.{part}"


_DISPLACEMENTS = {"vx": "x", "vy": "y", "vz": "z", "omega": "theta"}
_MOVED = 1e-12
"""Share of the slopes of constraints below which those with respect to an input are rounding."""
