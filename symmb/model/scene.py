"""A scene: a system with its start, output times, outputs and uncertain parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from importlib import import_module

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, SymmbError
from symmb._names import did_you_mean, name_fault, name_faults
from symmb._options import require_instance
from symmb._types import Array, Expr
from symmb.mechanics import Rotation, Spatial
from symmb.model.box import Box
from symmb.model.system import System
from symmb.model.typeset import scene_html
from symmb.model.units import units_of
from symmb.symbolic import reduction, t

_RATE_OF = {"x": "vx", "y": "vy", "z": "vz", "theta": "omega"}


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Listed start values: coordinates and velocities by index, and the displacements that they prescribe."""

    q: dict[int, ca.SX]
    v: dict[int, ca.SX]
    displacements: frozenset[int]
    drift: dict[str, ca.SX]


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """A system with its start, output times, outputs and uncertain parameters.

    Parameters
    ----------
    system : System
    start : mapping        "rod.theta", "rod.vx", "top.rotation", "top.omega" -> number or expression of parameters;
                           they hold exactly. The others follow from Phi = 0 and its rate. Relative rates of joints
                           that nothing determines are 0
    times : (n_t,) array   or a list; times of the outputs [s], increasing; the first is the start; default: 0 alone
    outputs : mapping      name -> expression of coordinates, velocities, multipliers, parameters and `t`; default: all
                           coordinates and velocities
    box : Box              intervals of the uncertain parameters
    guess : mapping        first guesses for coordinates that are not listed in start: they select the assembly. Modes
                           of flexible bodies start undeformed and at rest, unless they are listed in start or here
    name : str             for tables and files
    equilibrium : bool     start in static equilibrium: coordinates that are not listed in start, modes included, are
                           solved for, anew for each parameter value

    Raises
    ------
    DeclarationError       all faults at once
    """

    system: System
    start: Mapping[str, Expr] = field(default_factory=dict)
    times: Array = field(default_factory=lambda: np.zeros(1))
    outputs: Mapping[str, Expr] | None = None
    box: Box | None = None
    guess: Mapping[str, Expr] = field(default_factory=dict)
    name: str = "scene"
    equilibrium: bool = False

    def __post_init__(self) -> None:
        require_instance("Scene", self.system, System, "a System")
        untimely = _time_faults(self.times)
        faults = [*untimely, *self._box_faults()]
        faults += [f"name {self.name!r}: {fault}" for fault in [name_fault(self.name)] if fault]
        attempts = [lambda: self.prescribed, lambda: self.guesses]
        if not untimely:  # coordinates that move uniformly need the start time
            attempts.append(lambda: self._bound_outputs)
        for attempt in attempts:
            try:
                attempt()
            except DeclarationError as error:
                faults.extend(str(error).split("\n"))
        if faults:
            raise DeclarationError("\n".join(faults))
        object.__setattr__(self, "times", np.array(self.times, dtype=float))
        outputs = ca.vertcat(*self._bound_outputs.values()) if self._bound_outputs else ca.SX(0, 1)
        known = {s.sx.element_hash() for s in self.system.collected.states}
        extra = [s for s in self.system.bind.states(outputs) if s.sx.element_hash() not in known]
        if extra:
            object.__setattr__(self, "system", self.system.with_states(extra))

    def __reduce__(self) -> tuple:
        return reduction(Scene, *(getattr(self, f.name) for f in fields(self)))

    def _box_faults(self) -> list[str]:
        if self.box is None:
            return []
        if not isinstance(self.box, Box):
            return [f"box: {self.box!r} is not a Box. Write Box(l1=(0.95, 1.05)), or for a dict Box(**intervals)."]
        known = self.system.parameters
        unknown = [f"box: no parameter {n!r}.{did_you_mean(n, known)}" for n in self.box.names if n not in known]
        return unknown or self.system.sign_faults(self.box)

    @cached_property
    def prescribed(self) -> Prescribed:
        """The listed start. Modes of flexible bodies are at rest and undeformed, unless a guess is given for them."""
        return _with_modes(self, _resolve(self.system, self.start, "start"))

    @cached_property
    def guesses(self) -> dict[int, ca.SX]:
        """Guessed coordinates by index."""
        resolved = _resolve(self.system, self.guess, "guess")
        if resolved.v:
            raise DeclarationError("guess: velocities need no guess, their equations are linear. List them in start.")
        if resolved.drift:
            names = ", ".join(map(repr, resolved.drift))
            raise DeclarationError(f"guess: nothing touches {names}. List them in start.")
        return resolved.q

    @cached_property
    def _bound_outputs(self) -> dict[str, ca.SX]:
        outputs = self.outputs
        if outputs is None:
            c = self.system.collected
            pairs = zip((*c.q_names, *c.v_names), ca.vertsplit(ca.vertcat(c.q, c.v)), strict=True)
            return dict(pairs) if c.q_names else {}
        if not isinstance(outputs, Mapping):
            raise DeclarationError('outputs: expected a mapping from names to expressions, such as {"x": rod.x}.')
        bound, faults = {}, [f"output {fault}" for fault in name_faults([*outputs])]
        if not outputs:
            raise DeclarationError("outputs: give at least one, or leave them out for all coordinates and velocities.")
        for name, expression in outputs.items():
            try:
                bound[name] = self.expression(expression, f"output {name!r}")
                if bound[name].numel() != 1:
                    faults.append(f"output {name!r}: has {bound[name].numel()} components; give each its own name.")
            except DeclarationError as error:
                faults.append(str(error))
        if faults:
            raise DeclarationError("\n".join(faults))
        return bound

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return tuple(self._bound_outputs)

    @cached_property
    def y(self) -> ca.SX:
        """The outputs as expressions of q, v, v', s, lam, p and t, (n_y,)."""
        return ca.vertcat(*self._bound_outputs.values()) if self._bound_outputs else ca.SX(0, 1)

    def expression(self, expression: Expr, what: str = "expression") -> ca.SX:
        """Any expression of the scene as SX of q, v, v', s, lam, p and t. Decoupled coordinates move uniformly."""
        bound = self.system.bind(expression, what, also=self.system.solved_hashes, any_size=True)
        elapsed = t - float(np.asarray(self.times, dtype=float)[0])
        for x_name, x, v_name, vx in self.system.collected.decoupled:
            v0 = self.prescribed.drift.get(v_name, ca.SX(0))
            bound = ca.substitute(bound, vx, v0)
            bound = ca.substitute(bound, x, self.prescribed.drift.get(x_name, ca.SX(0)) + v0 * elapsed)
        return bound

    def __repr__(self) -> str:
        span = f"{self.times[0]:g} to {self.times[-1]:g} s"
        return f"Scene({self.name!r}, {len(self.output_names)} outputs at {len(self.times)} times, {span})"

    def _repr_html_(self) -> str:
        units = units_of(self.system, self.y)
        outputs = {
            name: (unit, expression)
            for (name, expression), unit in zip(self._bound_outputs.items(), units, strict=True)
        }
        intervals = {} if self.box is None else dict(zip(self.box.names, self.box.bounds, strict=True))
        # Drawings stand on scenes. Only a notebook that shows a scene asks for one.
        drawing = import_module("symmb.drawing")
        try:
            picture = drawing.start_picture(self)
        except SymmbError as error:
            picture = f"No picture: {error}"
        return scene_html(repr(self), outputs, self.start, self.system.parameters, intervals, picture)

    def with_box(self, box: Box) -> "Scene":
        """A copy with another box."""
        return replace(self, box=box)

    def with_times(self, times: Sequence[float] | Array) -> "Scene":
        """A copy with other times."""
        return replace(self, times=times)

    def with_outputs(self, outputs: Mapping[str, Expr]) -> "Scene":
        """A copy with other outputs."""
        return replace(self, outputs=outputs)

    def with_name(self, name: str) -> "Scene":
        """A copy with another name."""
        return replace(self, name=name)


def _time_faults(times: Sequence[float] | Array) -> list[str]:
    try:
        array = np.asarray(times, dtype=float)
    except (TypeError, ValueError):
        return [f"times: expected numbers, got {times!r}. Use numpy.linspace(0, 10, 1001)."]
    if array.ndim != 1 or array.size == 0:
        return [f"times: expected a list of at least one time, got shape {array.shape}."]
    if not np.all(np.isfinite(array)):
        return ["times: contains NaN or infinity."]
    if np.any(np.diff(array) <= 0):
        return ["times: must increase from one to the next; sort them and leave out repetitions."]
    return []


def _resolve(system: System, listed: Mapping[str, Expr], what: str) -> Prescribed:
    """Indices of listed names; see `Scene` for the names."""
    c = system.collected
    if not isinstance(listed, Mapping):
        raise DeclarationError(f'{what}: expected values by name, such as {{"rod.theta": 0.3}}, got {listed!r}.')
    q_at = {name: i for i, name in enumerate(c.q_names)}
    v_at = {name: i for i, name in enumerate(c.v_names)}
    decoupled = {name for x, _, vx, _ in c.decoupled for name in (x, vx)}
    spatial = {b.name for b in c.bodies if isinstance(b.pose, Spatial)}
    known = [n for n in (*q_at, *v_at) if not _is_quaternion(n, spatial)]
    known += [f"{b}.{part}" for b in spatial for part in ("rotation", "omega")] + sorted(decoupled)
    q: dict[int, ca.SX] = {}
    v: dict[int, ca.SX] = {}
    displacements: set[int] = set()
    drift: dict[str, ca.SX] = {}
    faults = []

    def bind(value: Expr, name: str, size: int = 1) -> ca.SX:
        bound = system.bind(value, f"{what} {name!r}", any_size=True)
        if bound.numel() != size:
            raise DeclarationError(f"{what} {name!r}: expected one number or expression, got {value!r}.")
        if any(not system.bind.is_parameter(s) for s in ca.symvar(bound)):
            raise DeclarationError(f"{what} {name!r}: may depend on parameters only.")
        return bound

    for name, value in listed.items():
        if not isinstance(name, str):
            faults.append(f"{what}: the name of a coordinate is a text, got {name!r}.")
            continue
        body, _, part = name.rpartition(".")
        try:
            if body in spatial and part == "rotation":
                if not isinstance(value, Rotation):
                    raise DeclarationError(f"{what} {name!r}: expected rotation(axis=..., angle=...), got {value!r}.")
                e = bind(value.quaternion, name, 4)
                q.update({q_at[f"{body}.e{k}"]: e[k] for k in range(4)})
                displacements.update(v_at[f"{body}.omega_{c}"] for c in "xyz")
            elif body in spatial and part == "omega":
                v.update({v_at[f"{body}.omega_{c}"]: bind(w, name) for c, w in zip("xyz", value, strict=True)})
            elif name in decoupled:
                drift[name] = bind(value, name)
            elif name in q_at and not _is_quaternion(name, spatial):
                q[q_at[name]] = bind(value, name)
                displacements.add(v_at[f"{body}.{_RATE_OF.get(part, f'{part}_dot')}"])
            elif name in v_at:
                v[v_at[name]] = bind(value, name)
            else:
                faults.append(f"{what}: no coordinate or velocity {name!r}.{did_you_mean(name, known)}")
        except DeclarationError as error:
            faults.append(str(error))
        except (TypeError, ValueError):
            faults.append(f"{what} {name!r}: expected three numbers or expressions, got {value!r}.")
    if faults:
        raise DeclarationError("\n".join(faults))
    return Prescribed(q, v, frozenset(displacements), drift)


def _with_modes(scene: Scene, prescribed: Prescribed) -> Prescribed:
    c, zero = scene.system.collected, ca.SX(0)
    modes = [f"{b.name}.{x}" for b in c.bodies for x in b.pose.coordinates[len(b.pose.rigid_coordinates) :]]
    fixed = [name for name in modes if name not in scene.guess]
    rates = {c.v_names.index(f"{name}_dot"): zero for name in fixed}
    prescribed = replace(prescribed, v={**rates, **prescribed.v})
    if scene.equilibrium:
        return prescribed
    undeformed = {c.q_names.index(name): zero for name in fixed}
    return replace(prescribed, q={**undeformed, **prescribed.q}, displacements=prescribed.displacements | rates.keys())


def _is_quaternion(name: str, spatial: set[str]) -> bool:
    body, _, part = name.rpartition(".")
    return body in spatial and part in ("e0", "e1", "e2", "e3")
