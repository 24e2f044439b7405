"""A scene: a system with its start, output times, outputs and uncertain parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal, TypeVar

import casadi as ca
import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, Faults, SymmbError
from symmb._interrupts import kept_interrupts
from symmb._magnitudes import SLIGHT
from symmb._names import counted, did_you_mean, name_fault, name_faults, normal_keys
from symmb._options import numbers_of, require_instance, require_names, require_truth, shown
from symmb._presentation import presentation
from symmb._types import Array, Expr
from symmb._units import dimensions, label, numbers_in, ratio_of, scaled, unit_of, units_of_parameters
from symmb.declare.mechanics import AxisJoint, Figure, Flywheel, Link
from symmb.declare.symbolic import reduction, t
from symmb.equations import model
from symmb.equations.model.box import Box
from symmb.equations.model.choices import hint
from symmb.equations.model.start_values import Prescribed, listed_values, with_modes
from symmb.equations.model.system import System
from symmb.equations.model.units import units_of

T = TypeVar("T")
Output = Expr | Figure | tuple[Expr | Figure, str]
"""An expression, or a pair of an expression and the requested unit."""


class _Fitting(str):
    """A unit that fits its output. This unit is not checked again, because fewer units are known after pickling:
    expressions in a pickle share no nodes."""


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """A system with its start, output times, outputs and uncertain parameters.

    Parameters
    ----------
    system : System
    start : mapping
        name -> number or expression of parameters. Names belong to bodies ("rod.theta", "rod.vx", "top.rotation",
        "top.omega"), to joints ("elbow.angle", "elbow.angle_rate", "slide.displacement", "slide.displacement_rate") and
        to `State`s. The start has exactly the listed values. Other values follow from the constraints. If the
        constraints do not determine the relative rate of a joint, the rate is 0
    times : (n_t,) array
        or a list; increasing times of the outputs [s], or a pair with a unit, such as ([0, 5], "ms"). The run starts at
        the first time. Default: 0 only
    outputs : mapping
        name -> expression of coordinates, velocities, multipliers, parameters and `t`, or a scalar output such
        as `maximum(expression)`; default: all coordinates and velocities, or the joint values of robots from files. A
        pair such as (expression, "mm") requests a unit: all values of this output in runs, bounds, limits, data,
        pictures and files are numbers in this unit
    box : Box
        intervals of the uncertain parameters
    guess : mapping
        first guesses for coordinates of bodies and joints that are not listed in start. Guesses select the assembly.
        Modes of flexible bodies start undeformed and at rest, unless they are listed in start or in guess
    name : str
        name in tables and files
    equilibrium : bool
        whether the scene starts in static equilibrium. All coordinates and modes that are not listed in start are then
        computed for each set of parameter values
    coordinates : str
        "joint" or "body", the coordinates of the equations of motion; default: the coordinates that need fewer
        operations
    restart : Restart
        the start state of a scene from `starting_at`

    Raises
    ------
    DeclarationError
        If the scene is not valid. The text lists all faults

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> print(scene)
    Scene('scene', 1 output at 3 times, 0 to 2 s)
    >>> mb.simulate(scene)["x"].round(4)
    array([ 1.    , -0.4161, -0.6536])
    """

    system: System
    start: Mapping[str, Expr] = field(default_factory=dict)
    times: Array = field(default_factory=lambda: np.zeros(1))
    outputs: Mapping[str, Output] | None = None
    box: Box | None = None
    guess: Mapping[str, Expr] = field(default_factory=dict)
    name: str = "scene"
    equilibrium: bool = False
    coordinates: Literal["joint", "body"] | None = None
    restart: "model.Restart | None" = None

    @kept_interrupts()
    def __post_init__(self) -> None:
        require_instance("Scene", self.system, System, "a System")
        require_truth("Scene", "equilibrium", self.equilibrium)
        if self.restart is not None:
            require_instance("Scene: restart", self.restart, model.Restart, "what starting_at gives")
        for named in ("start", "outputs", "guess"):
            object.__setattr__(self, named, normal_keys(f"Scene: {named}", getattr(self, named)))
        if isinstance(self.times, list | tuple):
            times = numbers_in("times", "a time", self.times, "s")
            object.__setattr__(self, "times", self.times if times is None else times)
        self._faults().raise_any()
        if asked := {name: (y, _Fitting(unit)) for name, (y, unit) in self.asked.items() if unit}:
            self._require_fitting_units()
            object.__setattr__(self, "outputs", {**(self.outputs or {}), **asked})
        # Inputs are 0 in runs. Only exports with inputs use `with_inputs`.
        object.__setattr__(self, "system", self.system.without_inputs)
        object.__setattr__(self, "box", self._own_box)
        object.__setattr__(self, "times", np.array(self.times, dtype=float))
        known = {s.sx.element_hash() for s in self.system.collected.states}
        along = ca.vertcat(self.y, *(part for figure in self.figures.values() for part in figure.parts))
        extra = [s for s in self.system.bind.states(along) if s.sx.element_hash() not in known]
        if extra:
            object.__setattr__(self, "system", self.system.with_states(extra))

    def _faults(self) -> Faults:
        untimely = _time_faults(self.times)
        faults = Faults(untimely)
        coordinates = self.coordinates
        if coordinates is not None and not (isinstance(coordinates, str) and coordinates in ("joint", "body")):
            faults.append(f'coordinates: {shown(coordinates)} is neither "joint" nor "body".')
        if self.restart is not None and not untimely and float(np.asarray(self.times)[0]) != self.restart.time:
            faults.append(
                f"times: the first time must be {self.restart.time!r} s, the end of the run that the scene continues."
            )
        if self.restart is not None and self.equilibrium:
            faults.append("equilibrium: a scene that continues a run already has a start state. Omit equilibrium.")
        faults += [f"name {shown(self.name)}: {fault}" for fault in [name_fault(self.name)] if fault]
        # Coordinates that move uniformly need the start time.
        for attribute in ("_own_box", "prescribed", "guesses", *(() if untimely else ("_bound_outputs", "figures"))):
            with faults.noted():
                getattr(self, attribute)
        return faults

    def __reduce__(self) -> tuple:
        return reduction(Scene, *(getattr(self, f.name) for f in fields(self)))

    @cached_property
    def memory(self) -> dict[Any, Any]:
        """The prepared parts of this scene by key. Copies and pickles start without prepared parts."""
        return {}

    def remembered(self, key: Any, prepare: Callable[[], T]) -> T:
        """The prepared part of this scene with this key. The first call prepares the part."""
        if key not in self.memory:
            self.memory[key] = prepare()
        return self.memory[key]

    @cached_property
    def _own_box(self) -> Box | None:
        """The box in the units of the parameters."""
        if self.box is None:
            return None
        if not isinstance(self.box, Box):
            raise DeclarationError(f"box: {self.box!r} is not a Box. Write Box(l1=(0.95, 1.05)), or Box(**intervals).")
        known = self.system.parameters
        unknown = [
            f"box: no parameter {n!r}.{did_you_mean(n, known)}{hint(self.box.choices, n)}"
            for n in self.box.names
            if n not in known
        ]
        box = self.box if unknown else self.box.with_units(units_of_parameters(known))
        Faults(unknown or self.system.sign_faults(box)).raise_any()
        return box

    @cached_property
    def prescribed(self) -> Prescribed:
        """The start values, listed by name. Modes of flexible bodies without a guess are at rest and undeformed."""
        listed = listed_values(self.system, self.start, "start")
        if self.restart is not None:
            going_on = {name: ca.SX(value) for name, value in self.restart.drift.items()}
            return replace(listed, drift=going_on | listed.drift)
        return with_modes(self.system, listed, self.guess, self.equilibrium)

    @cached_property
    def guessed(self) -> Prescribed:
        """Guessed coordinates of bodies and of joints."""
        resolved = listed_values(self.system, self.guess, "guess")
        if resolved.v or any(value.is_rate for value in resolved.joints):
            raise DeclarationError(
                "guess: velocities need no guess, because their equations are linear. List them in start."
            )
        if resolved.states:
            names = ", ".join(map(repr, resolved.states))
            raise DeclarationError(f"guess: {names} is a first-order state and needs no guess. List it in start.")
        if resolved.drift:
            names = ", ".join(map(repr, resolved.drift))
            raise DeclarationError(f"guess: no element acts on {names}. List the value in start.")
        return resolved

    @property
    def guesses(self) -> dict[int, ca.SX]:
        """Guessed coordinates of bodies by index."""
        return self.guessed.q

    @cached_property
    def _bound_outputs(self) -> dict[str, ca.SX]:
        outputs = self.outputs
        if outputs is None:
            return self._default_outputs
        if not isinstance(outputs, Mapping):
            raise DeclarationError('outputs: expected a mapping from names to expressions, such as {"x": rod.x}.')
        bound: dict[str, ca.SX] = {}
        faults = Faults(f"output {fault}" for fault in name_faults([*outputs]))
        if not outputs:
            raise DeclarationError("outputs: expected at least one output. Omit outputs for the default outputs.")
        for name, (expression, unit) in self.asked.items():
            if isinstance(expression, Figure):
                continue
            with faults.noted():
                own = self.expression(expression, f"output {name!r}")
                bound[name] = scaled(own, unit_of(f"output {name!r}", unit), inverse=True)
                if own.numel() != 1:
                    faults.append(f"output {name!r} has {own.numel()} components. Give each component its own name.")
        faults.raise_any()
        return bound

    @property
    def _default_outputs(self) -> dict[str, ca.SX]:
        """Joint values of robots, positions of links without a hinge or slider, and states of other bodies."""
        c = self.system.collected
        links = [body for body in self.system.bodies if isinstance(body, Link)]
        axes = [
            e for e in self.system.elements if isinstance(e, AxisJoint) and e.coordinate and e.point_b.body in links
        ]
        free = [link for link in links if all(joint.point_b.body is not link for joint in axes)]
        chosen = {joint.name: getattr(joint, str(joint.coordinate)) for joint in axes}
        chosen |= {f"{link.name}.{x}": getattr(link, x) for link in free for x in "xyz"}
        own = {body.name for body in self.system.bodies if isinstance(body, Link | Flywheel)}
        states = zip((*c.q_names, *c.v_names), ca.vertsplit(ca.vertcat(c.q, c.v)), strict=True)
        rest = {name: x for name, x in states if name.rpartition(".")[0] not in own} if c.q_names else {}
        return {name: self.expression(x, f"output {name!r}") for name, x in chosen.items()} | rest

    @cached_property
    def asked(self) -> dict[str, tuple[Any, str]]:
        """The given outputs, each with its requested unit ('' without a request)."""
        given: Any = self.outputs.items() if isinstance(self.outputs, Mapping) else ()
        return {name: output if _has_unit(output) else (output, "") for name, output in given}

    def _require_fitting_units(self) -> None:
        """Raise DeclarationError if a requested unit does not fit the unit of the output. Unknown units are allowed."""
        for name, (_, asked) in self.asked.items():
            what, known = f"output {name!r}", self._inferred[name] if asked and type(asked) is str else ""
            if known and dimensions(what, known) != dimensions(what, asked):
                ratio_of("outputs", what, asked, known)

    @cached_property
    def figures(self) -> "dict[str, model.BoundFigure]":
        """The scalar outputs by name."""
        bound, faults = {}, Faults()
        for name, (output, unit) in self.asked.items():
            if isinstance(output, Figure):
                with faults.noted():
                    own = model.bound_figure(output, f"output {name!r}", self.expression, np.asarray(self.times))
                    if unit and own.kind in ("psd", "probability"):
                        faults.append(f"output {name!r}: {own.kind} accepts no unit. Scale the expression instead.")
                    ratio, y = unit_of(f"output {name!r}", unit), own.expression
                    per_second = scaled(1.0, ratio, inverse=True) if y is None and unit else 1.0
                    y = y if y is None else scaled(y, ratio, inverse=True)
                    bound[name] = replace(own, expression=y, per_second=per_second)
        faults.raise_any()
        return bound

    @cached_property
    def curves(self) -> "Scene":
        """A copy without scalar outputs. The expressions of the scalar outputs become outputs over time."""
        named = {f"{name}: {k}": part for name, figure in self.figures.items() for k, part in enumerate(figure.parts)}
        own = {name: pair for name, pair in self.asked.items() if pair[1] and name in self._bound_outputs}
        return self.with_outputs(self._bound_outputs | own | named) if self.figures else self

    @property
    def curve_names(self) -> tuple[str, ...]:
        """Names of the outputs over time, in order."""
        return tuple(self._bound_outputs)

    @property
    def curve_units(self) -> tuple[str, ...]:
        """Units of the outputs over time, including outputs of coordinates that move uniformly."""
        return tuple(self._unit_of(name) for name in self.curve_names)

    def _unit_of(self, name: str) -> str:
        return self.asked.get(name, ("", ""))[1] or self._inferred[name]

    @cached_property
    def _inferred(self) -> dict[str, str]:
        """The units of outputs that follow from their expressions."""
        given = {name: (y, "") for name, y in self._bound_outputs.items()} if self.outputs is None else self.asked
        whole = ca.vertcat(*(self._bound(given[name][0], name) for name in self.curve_names), ca.SX(0, 1))
        known = dict(zip(self.curve_names, units_of(self.system, whole), strict=True))
        for name in self.figures:
            own, kind = self.asked[name][0].expression, self.asked[name][0].kind
            known[name] = "s" if own is None else units_of(self.system, self.expression(own, name))[0]
            known[name] = "" if kind in ("psd", "probability") else known[name]
        return known

    def _bound(self, expression: Expr, what: str) -> ca.SX:
        """An expression as SX, before coordinates that move uniformly are replaced by functions of time."""
        return self.system.bind(expression, what, also=self.system.solved_hashes, any_size=True)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return self.curve_names if self.outputs is None else tuple(self.outputs)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the outputs, '' for units that do not follow from the expression."""
        return tuple(self._unit_of(name) for name in self.output_names)

    @cached_property
    def y(self) -> ca.SX:
        """The outputs over time as expressions of q, v, v', s, lam, p and t, (n_y,)."""
        return ca.vertcat(*self._bound_outputs.values()) if self._bound_outputs else ca.SX(0, 1)

    def expression(self, expression: Expr, what: str = "expression") -> ca.SX:
        """Any expression of the scene as SX of q, v, v', s, lam, p and t. Unforced coordinates move uniformly."""
        require_instance("expression: what", what, str, "a text")
        bound = self._bound(expression, what)
        elapsed = t - float(np.asarray(self.times, dtype=float)[0])
        for x_name, x, v_name, vx in self.system.collected.decoupled:
            v0 = self.prescribed.drift.get(v_name, ca.SX(0))
            bound = ca.substitute(bound, vx, v0)
            bound = ca.substitute(bound, x, self.prescribed.drift.get(x_name, ca.SX(0)) + v0 * elapsed)
        return bound

    def __repr__(self) -> str:
        span = f"{self.times[0]:g} to {self.times[-1]:g} s"
        outputs, times = counted(len(self.output_names), "output"), counted(len(self.times), "time")
        return f"Scene({self.name!r}, {outputs} at {times}, {span})"

    def _repr_html_(self) -> str:
        declared = self._bound_outputs | {name: self.asked[name][0] for name in self.figures}
        outputs = [
            [name, unit, _cell(declared[name])] for name, unit in zip(self.output_names, self.units, strict=True)
        ]
        tables = [html.table([["output", "unit", "expression"], *outputs], (0, 1, 2))]
        if self.start:
            values = ([name, _cell(value)] for name, value in self.start.items())
            tables.append(html.table([["start", "value"], *values], (0, 1)))
        intervals = {} if self.box is None else dict(zip(self.box.names, self.box.bounds, strict=True))
        if self.system.parameters:
            rows = []
            units = units_of_parameters(self.system.parameters)
            for name, value in self.system.parameters.items():
                row = [label(name, units.get(name, "")), f"{value:g}", *(f"{end:g}" for end in intervals.get(name, ()))]
                rows.append([*row, *[""] * (4 - len(row))])
            tables.append(html.table([["parameter", "nominal", "lower", "upper"], *rows]))
        try:
            picture = html.picture(presentation("start_picture")(self))
        except SymmbError as error:
            picture = html.text(f"No picture: {error}")
        return html.page(html.text(repr(self)), picture, *tables)

    def with_box(self, box: Box) -> "Scene":
        """A copy with another box."""
        return replace(self, box=box)

    def with_times(self, times: Sequence[float] | Array) -> "Scene":
        """A copy with other times."""
        return replace(self, times=times)

    def with_outputs(self, outputs: Mapping[str, Output]) -> "Scene":
        """A copy with other outputs."""
        return replace(self, outputs=outputs)

    def with_nominal(self, values: Mapping[str, float]) -> "Scene":
        """A copy with other nominal values of all parameters."""
        return replace(self, system=self.system.with_elements((), self.system.parameters.with_nominal(values)))

    def with_inputs(self, names: Sequence[str]) -> "Scene":
        """A copy in which the inputs with these names are the last parameters, so that other programs can set them."""
        inputs = self.system.inputs
        symbols = [inputs[name] for name in require_names("with_inputs", "input", names, inputs)]
        if not symbols:
            return self
        return replace(self, system=self.system.with_elements((), self.system.parameters.with_inputs(symbols)))

    @kept_interrupts()
    def starting_at(self, run: "model.EndedRun") -> "Scene":
        """A copy that continues a run. The parameters of the run become the nominal parameters.

        Positions, velocities, states, turns of angles, held values and closed contacts are taken from the end of the
        run. The times are shifted to start at the end of the run, so functions of `t` continue. If a new run has other
        parameter values, coordinates and velocities change by the smallest amount that satisfies the constraints.

        Parameters
        ----------
        run : Trajectory
            a run of this scene, or of another scene with the same elements

        Raises
        ------
        DeclarationError
            If the run is of another system or has failed

        Examples
        --------
        >>> import symmb as mb
        >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
        >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), times=[0.0, 1.0])
        >>> longer = fall.starting_at(mb.simulate(fall))
        >>> longer.times.tolist(), float(mb.simulate(longer)["ball.y"][-1].round(6))
        ([1.0, 2.0], -19.62)
        """
        end, times = model.restart_of(self.system, run), np.asarray(self.times)
        times = end.time + (times - times[0])
        system = self.system.with_elements((), self.system.parameters.with_nominal(run.parameters))
        return replace(self, system=system, start={}, guess={}, equilibrium=False, times=times, restart=end)

    def with_name(self, name: str) -> "Scene":
        """A copy with another name."""
        return replace(self, name=name)


def _has_unit(output: Any) -> bool:
    return isinstance(output, tuple) and len(output) == 2 and isinstance(output[1], str)


def _cell(value: object, longest: int = 80) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= longest else f"{text[:longest]} ..."


def _time_faults(times: Sequence[float] | Array) -> list[str]:
    array = numbers_of(times)
    if array is None or array.ndim != 1 or array.size == 0:
        return [f"times: expected a list of times in s, such as numpy.linspace(0, 10, 1001), got {shown(times)}."]
    if not np.all(np.isfinite(array)):
        return ["times: some times are NaN or infinite."]
    if np.any(np.diff(array) <= 0):
        return ["times: each time must be larger than the time before. Sort the times and remove repetitions."]
    begin, end = array[0], array[-1]
    # Steps are at least 1e-14 of the horizon, and their fourth powers must be finite.
    shortest, longest = 1e-60, 1e60
    with np.errstate(over="ignore"):
        horizon, rounding = float(end - begin), float(np.spacing(np.abs(array).max()))
    if array.size > 1 and not shortest <= horizon <= longest:
        return [f"times: from {begin:g} to {end:g} s, but a run must last {shortest:g} to {longest:g} s."]
    # Solvers take small steps between two times.
    if array.size > 1 and rounding > SLIGHT * horizon:
        return [
            f"times: floating-point numbers near {end:g} are {rounding:.1g} apart, which is too coarse for a run of "
            f"{horizon:g} s. Start the times at 0."
        ]
    return []
