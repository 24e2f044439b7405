"""The trajectory of one run."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError, WithWarnings
from symmb._labelled import ByOutput, Labelled, Result
from symmb._names import did_you_mean, normal
from symmb._options import require_instance
from symmb._table import over_times, time_text
from symmb._types import Array, Expr
from symmb._units import headings, with_units
from symmb.declare.symbolic import batch
from symmb.equations.model import Scene
from symmb.equations.start import Singularity
from symmb.results import files, plot
from symmb.run import simulation
from symmb.run.events import Event, event_doubts
from symmb.run.formulations import Program, output_function, program_of
from symmb.run.verification import Drift, Energy, Examination, drift, energy, linear_theory_doubts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROUNDING = 1e-12, 1e-30
"""A number is printed as 0 if it is smaller than the first factor times the largest value of its output, or than the
second factor times the largest value of all outputs."""
_NAMED = 12
"""Maximum number of printed coordinates and velocities of the start."""
_START = {"held": "held", "solved": "solved for", "free": "left free"}


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(plot.OverTime, Result, ByOutput, WithWarnings, files.Saved):
    """One run of a scene.

    `traj["x1"]` returns an output, a coordinate, a velocity or a multiplier (n_t,) by name. A scalar output is one
    number. If an output has the name of a coordinate, `traj[name]` is the output. `traj(expression)` evaluates any
    expression of the scene. `save` writes a file, and `load` reads it.

    Attributes
    ----------
    scene : Scene
        None if the run was read from a file without a scene
    parameters : dict
        values of the parameters in this run, by name
    solver, reason : str
        text of the solver, and why symmb chose it; `reason` is empty if the solver was given
    t : (n_t,)
        times [s]
    x : (n_t, n_x)
        states (q, v, s)
    work : (n_t,)
        work since the start by forces without potential, drives and impacts [J]
    statistics : dict
        counts of the integrator, and a report on the start
    setup_seconds, run_seconds : float
        time of the preparation, and time of the run [s]
    events : tuple of Event
        ordered events: impacts, and contacts and joints that close or open
    error : (n_t, n_y)
        estimated error of the outputs; None without check=True
    run_doubts : tuple of str
        warnings about the start and the solver, as sentences; `warnings` (or `doubts`) contains all warnings
    figures : dict
        scalar outputs by name; `values` repeats them at all times
    run_examination
        the examination of the run, also between its output times; None if the run was read from a file

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(k=4.0)
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), p.k)
    >>> system = mb.System(bob, spring, parameters=p)
    >>> scene = mb.Scene(system, {"bob.x": 1.0}, [0.0, 1.0, 2.0], {"x": bob.x}, mb.Box(k=(3.9, 4.1)))
    >>> run = mb.simulate(scene)
    >>> run["x"].round(4), run(bob.x**2).round(4), run.parameters
    (array([ 1.    , -0.4161, -0.6536]), array([1.    , 0.1732, 0.4272]), {'k': 4.0})
    """

    scene: Scene | None
    program: Program | None
    parameters: dict[str, float]
    solver: str
    reason: str
    t: Array
    x: Array
    work: Array
    statistics: dict[str, Any]
    setup_seconds: float
    run_seconds: float
    events: tuple[Event, ...] = ()
    error: Array | None = None
    run_doubts: tuple[str, ...] = ()
    run_examination: Examination | None = None
    figures: Mapping[str, float] = field(default_factory=dict)

    @property
    def _p(self) -> Array:
        return np.array(list(self.parameters.values()))

    @property
    def _model(self) -> tuple[Scene, Program]:
        if self.scene is None or self.program is None:
            raise DeclarationError(
                "This run was read from a file, and its equations are not known. Pass the scene: "
                "Trajectory.load(path, scene)."
            )
        return self.scene, self.program

    @cached_property
    def name(self) -> str:
        """The name of the scene."""
        return self._model[0].name

    @cached_property
    def state_names(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Names of coordinates, velocities and first-order states."""
        dae = self._model[1].bodies.start.dae
        return dae.q_names, dae.v_names, dae.s_names

    @cached_property
    def row_names(self) -> tuple[str, ...]:
        """Names of all constraint rows, in the order of their multipliers."""
        return self._model[1].bodies.start.dae.row_names

    @property
    def q(self) -> Array:
        """Coordinates, (n_t, n_q)."""
        return self.x[:, : len(self.state_names[0])]

    @property
    def v(self) -> Array:
        """Velocities, (n_t, n_v)."""
        q, v, _ = self.state_names
        return self.x[:, len(q) : len(q) + len(v)]

    @property
    def s(self) -> Array:
        """First-order states, (n_t, n_s)."""
        return self.x[:, self.x.shape[1] - len(self.state_names[2]) :]

    @cached_property
    def lam(self) -> Array:
        """Multipliers, (n_t, n_r) [N, N m]."""
        return self._along(ca.SX(self._model[0].system.lam))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        scene, _ = self._model
        return scene.output_names if self.figures else scene.curve_names

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the outputs, '' if the unit is not known."""
        scene, _ = self._model
        return scene.units if self.figures else scene.curve_units

    @cached_property
    def values(self) -> Array:
        """Outputs, (n_t, n_y)."""
        curves = self._of(self._model[1].bodies.y)
        if not self.figures:
            return curves
        columns = iter(curves.T)
        own = [np.full(len(self.t), self.figures[n]) if n in self.figures else next(columns) for n in self.names]
        return np.stack(own, axis=1)

    def _along(self, y: ca.SX) -> Array:
        scene, program = self._model
        return self._of(output_function(program.bodies.dae, scene, y))

    def _of(self, f: ca.Function) -> Array:
        """The values (n_t, n) of a Function (x, p, t) along the run."""
        if not f.numel_out(0):
            return np.zeros((len(self.t), 0))
        return batch(f, self.x, self._p, self.t[:, None])[0].reshape(len(self.t), -1)

    def __call__(self, expression: Expr) -> Array:
        """The values (n_t,) or (n_t, n) of an expression of coordinates, velocities, multipliers, parameters and `t`.

        Raises
        ------
        DeclarationError       if the expression contains a symbol that the scene does not know
        """
        scene, _ = self._model
        bound = ca.vec(scene.expression(expression))
        known = {state.sx.element_hash() for state in scene.system.collected.states}
        for state in scene.system.bind.states(bound):
            if state.sx.element_hash() not in known:
                raise DeclarationError(
                    f"{state.name!r} counts turns during the run, so it must be an output of the Scene. Add it to "
                    "outputs=."
                )
        values = self._along(bound)
        return values[:, 0] if bound.numel() == 1 else values

    def __getitem__(self, name: str) -> Any:
        require_instance("Trajectory", name, str, "the name of an output, a state or a multiplier")
        name = normal(name)
        if name in self.figures:
            return self.figures[name]
        if name in self.names:
            return self.values[:, self.names.index(name)]
        states = tuple(chain.from_iterable(self.state_names))
        if name in states:
            return self.x[:, states.index(name)]
        if name in self.row_names:
            return self.lam[:, self.row_names.index(name)]
        raise DeclarationError(
            f"No output or state {name!r}.{did_you_mean(str(name), (*self.names, *states, *self.row_names))}"
        )

    def reaction(self, joint: str) -> tuple[Array, Array]:
        """Reaction of a joint on its second body, in world axes: force (n_t, 3) [N], torque (n_t, 3) [N m]."""
        reaction = self._model[0].system.reaction(joint)
        return self._along(reaction.force), self._along(reaction.torque)

    @cached_property
    def examination(self) -> Examination:
        """The examination of the run: drifts, singular positions and warnings."""
        return self.run_examination or Examination.of(self._model[1], self._p, self.t, self.x, self.work)

    @cached_property
    def drift(self) -> Drift:
        """Violation of the constraints at the output times, with arrays (n_t,)."""
        return drift(self._model[1].bodies, self.x, self._p, self.t)

    @cached_property
    def energy(self) -> Energy:
        """Kinetic energy, potential energy, and work since the start, at the output times, each (n_t,) [J]."""
        return energy(self._model[1].bodies, self.x, self._p, self.t, self.work)

    @property
    def singularity(self) -> Singularity | None:
        """The singular position to which the run comes closest; None if the run is not close to any."""
        return self.examination.singularity

    @cached_property
    def position_drift(self) -> float:
        """Largest violation of a position row."""
        return float(self.examination.drift.position.max(initial=0.0))

    @cached_property
    def velocity_drift(self) -> float:
        """Largest violation of a velocity row."""
        return float(self.examination.drift.velocity.max(initial=0.0))

    @cached_property
    def energy_drift(self) -> float:
        """Largest drift of energy |T + V - W - E_0|, divided by the largest kinetic energy; nan if nothing moves."""
        return self.examination.energy_drift

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about the run, as sentences; empty if no problem is known."""
        scene, program = self._model
        doubts = (
            *program.bodies.start.doubts,
            *event_doubts(self.events),
            *self.run_doubts,
            *self.examination.doubts,
            *linear_theory_doubts(scene, program.bodies.dae, self.x, self._p, self.t),
        )
        longest, step = program.longest_step, program.solver.step_taken(self.t)
        if step <= longest:  # 0 for step control
            return doubts
        pulse = f"Steps of {step:.2g} s may miss a pulse in a function of time. Use steps below {longest:.2g} s."
        return (*doubts, pulse)

    def _head(self) -> str:
        return self._text

    def _rows(self, names: Sequence[str]) -> list[list[str]]:
        return _extremes(self.t, self.values, names)

    @cached_property
    def _text(self) -> str:
        own = self.parameters
        energy = "nothing moves" if math.isnan(self.energy_drift) else f"energy {self.energy_drift:.1e}"
        drifts = f"position {self.position_drift:.1e}, velocity {self.velocity_drift:.1e}, {energy}"
        return "\n".join(
            [
                f"{self.name}: {len(self.t)} times from {self.t[0]:g} to {self.t[-1]:g} s by {self.solver}",
                *([f"  solver      chosen: {self.reason}"] if self.reason else []),
                f"  parameters  {', '.join(with_units({n: f'{v:g}' for n, v in own.items()}, own)) or 'none'}",
                *_start_lines(self.statistics["start"]),
                *_pulse_lines(self._model[1]),
                *_event_lines(self.events),
                *([f"  drift       {drifts}"] if self.x.shape[1] else []),
                *([f"  singular    {self.singularity}"] if self.singularity else []),
                *(f"  warning     {doubt}" for doubt in self.doubts),
                f"  seconds     setup {self.setup_seconds:.3g}, run {self.run_seconds:.3g}",
            ]
        )

    @classmethod
    def load(cls, path: str | Path, scene: Scene | None = None) -> "Trajectory":
        """Read a file that `save` has written. A .csv file contains times and outputs only.

        Parameters
        ----------
        scene : Scene
            the scene of the run; without it, expressions and reactions cannot be evaluated

        Raises
        ------
        DeclarationError
            If the file is damaged, has other contents, or belongs to another scene
        """
        known, derived = files.load(path, "a result of Trajectory.save", simulation.of_record, simulation.of_table)
        program = None
        if scene is not None:
            require_instance("Trajectory.load: scene", scene, Scene, "a Scene")
            scene = scene.with_times(known["t"])
            program = program_of(scene)
            dae = program.bodies.start.dae
            names = (dae.q_names, dae.v_names, dae.s_names), list(dae.p_names)
            if (derived["state_names"], list(known["parameters"])) != names:
                raise DeclarationError(
                    f"{path} contains a run of another scene: its states or parameters differ from those of "
                    f"{scene.name!r}. Pass the scene of this run."
                )
        run = cls(scene=scene, program=program, **known)
        vars(run).update(derived)  # replaces the values that cached properties would compute
        return run

    def _record(self) -> dict[str, Any]:
        q_names, v_names, s_names = self.state_names
        return {name: getattr(self, name) for name in simulation.PLAIN} | {
            "scene": self.name,
            "names": np.array(self.names, dtype=str),
            "q_names": q_names,
            "v_names": v_names,
            "s_names": s_names,
            "events": [asdict(event) for event in self.events],
            "drift": self.drift._asdict(),
            "energy": self.energy._asdict(),
            "text": self._text,
        }

    def _table(self) -> "files.Table":
        columns = self.t, *self.values.T
        return dict(zip(headings(self.names, self.units, self.parameters), columns, strict=True))

    def _labelled(self) -> Labelled:
        return simulation.labelled(self._record())

    def _figure(self, columns: list[int] | None, style: plot.Style) -> "Figure":
        values = self.t, self.values, self.names
        return plot.plot_trajectory(
            *values, units=self.units, chosen=columns, title=self.name, timeless=self.figures, style=style
        )


def _start_lines(start: Mapping[str, list[str]]) -> list[str]:
    """Lines of text: names of values that were kept, solved for or left free at the start, and redundant rows."""
    parts = "; ".join(f"{what} {_some(start[key])}" for key, what in _START.items() if start[key])
    redundant = [f"  redundant   {', '.join(start['redundant'])}: smallest reactions"] if start["redundant"] else []
    return [*([f"  start       {parts}"] if parts else []), *redundant]


def _some(names: Sequence[str]) -> str:
    """A list of names as text. Long lists are shortened, because a robot has hundreds of names."""
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")


def _pulse_lines(program: Program) -> list[str]:
    """A line of text about the longest step that detects all pulses of functions of time; no line without pulses."""
    longest = program.longest_step
    if not math.isfinite(longest):
        return []
    passes = "are at most {:.2g} s, so that they do not miss pulses"
    if getattr(program.solver, "rtol", None) is None:  # the user chose the fixed step
        passes = "above {:.2g} s may miss pulses"
    return [f"  pulses      in functions of time: steps {passes.format(longest)}"]


def _event_lines(events: Sequence[Event]) -> list[str]:
    """A line with the number of impacts by name, the times of other events, and the work of all events."""
    if not events:
        return []
    counts = Counter(event.name for event in events if event.what == "impact")
    parts = [f"{n} of {name!r}" for name, n in counts.items()]
    parts += [f"{e.name!r} {e.what} at {e.time:.6g} s" for e in events if e.what != "impact"]
    work = sum(event.work for event in events)
    label = "impacts" if counts else "events"
    return [f"  {label:<11} {', '.join(parts[:6] + ['...'] * (len(parts) > 6))}; work {work:.4g} J"]


def _extremes(t: Array, values: Array, names: Sequence[str]) -> list[list[str]]:
    """Rows of text: first, last, lowest and highest value of each output (n_t, n_y), and times. Rounding is 0."""
    size = np.abs(values)
    rounding = np.maximum(_ROUNDING[0] * size.max(axis=0), _ROUNDING[1] * size.max(initial=0.0))
    values = np.where(size < rounding, 0.0, values)
    rows = [["output", f"at {t[0]:g} s", f"at {t[-1]:g} s", "lowest", "at [s]", "highest", "at [s]"]]
    for name, own in zip(names, values.T, strict=True):
        low, high = own.argmin(), own.argmax()
        extremes = f"{own[low]:.6g}", time_text(t, low, own), f"{own[high]:.6g}", time_text(t, high, own)
        rows.append([name, f"{own[0]:.6g}", f"{own[-1]:.6g}", *extremes])
    return over_times(rows, t)
