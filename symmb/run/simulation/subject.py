"""The subject of a study, which is a scene or a simulator, and its simulators."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._options import require_names, shown
from symmb._progress import Progress
from symmb._types import Array, Expr
from symmb._units import units_of_parameters
from symmb.connect import Simulator
from symmb.equations.model import Box, Scene
from symmb.run import codegen
from symmb.run.integrate import Solver, solver_of
from symmb.run.simulation.dae_simulator import DAESimulator
from symmb.run.simulation.figure_simulator import FigureSimulator
from symmb.run.simulation.random_simulator import RandomSimulator, random_inputs

Device: TypeAlias = str | Any | None
"""The device of runs: "cuda" for a graphics card, a `Card`, or None for the processor."""
_SCENE = "Scene(system, times=...) makes a Scene from a System."


@dataclass(frozen=True, eq=False)
class Subject:
    """What is studied: a scene with the options of its runs, or a simulator, which has its own options.

    Nothing is derived before `simulator`, `motion` or `figures` is used. The scene stores these simulators.

    Attributes
    ----------
    scene : Scene                scene with the times and outputs of the study; None for simulators of other programs
    solver : Solver, optional    default: pilot runs choose the solver
    card : Card, optional        graphics card of the runs; default: the processor
    given : Simulator, optional  simulator that was given instead of a scene
    """

    scene: Scene
    solver: Solver | None = None
    card: "codegen.Card | None" = None
    given: Simulator | None = None

    @classmethod
    def of(
        cls,
        given: Scene | Simulator,
        solver: Solver | str | None = None,
        times: Sequence[float] | Array | None = None,
        outputs: Mapping[str, Expr] | None = None,
        device: Device = None,
        owner: str = "",
    ) -> "Subject":
        """The subject of a public function with these arguments, which are checked.

        Raises
        ------
        DeclarationError       if an argument has a wrong type, or a simulator comes with options of scenes
        """
        solver = solver_of(solver)
        if isinstance(given, Scene):
            scene = given if times is None else given.with_times(times)
            scene = scene if outputs is None else scene.with_outputs(outputs)
            return cls(scene, solver, None if device is None else _card(device))
        if isinstance(given, type):
            raise DeclarationError(f"Expected a Scene or a simulator, got the class {given.__name__}. Make one of it.")
        if not hasattr(given, "outputs"):
            if owner:
                raise DeclarationError(f"{owner}: expected a Scene or a simulator, got {shown(given)}.")
            raise DeclarationError(f"Expected a Scene or a simulator, got {type(given).__name__}. {_SCENE}")
        if any(option is not None for option in (solver, times, outputs, device)):
            raise DeclarationError(
                f"{given!r} has its own solver, times, outputs and device. Pass a Scene to choose other ones."
            )
        if isinstance(given, DAESimulator):
            return cls(given.scene, given.solver, given.program.card, given)
        return cls(cast(Scene, None), given=given)

    @property
    def motion(self) -> DAESimulator:
        """The simulator of the outputs over time, as `prepare` returns it, but before its nominal run in two ways."""
        if isinstance(self.given, DAESimulator):
            return self.given
        scene, solver, card = self.scene, self.solver, self.card
        if card is None:
            return scene.remembered(solver, lambda: DAESimulator(scene, solver))
        return scene.remembered((solver, card), lambda: Subject(scene, solver).motion.on_card(card))

    @property
    def figures(self) -> FigureSimulator:
        """The simulator of all outputs of a scene that has scalar outputs."""
        scene, solver, card = self.scene, self.solver, self.card
        curves = Subject(scene.curves, solver, card)
        return scene.remembered((FigureSimulator, solver, card), lambda: FigureSimulator(scene, curves.motion))

    @property
    def simulator(self) -> Simulator:
        """The simulator of all outputs. If a scene has random inputs, it averages over their realizations."""
        scene, solver, card = self.scene, self.solver, self.card
        if self.given is not None and (scene is None or not scene.figures):
            return self.given
        if inputs := random_inputs(scene):
            key = RandomSimulator, solver, card
            return scene.remembered(key, lambda: RandomSimulator(scene, inputs, solver, card))
        return self.figures if scene.figures else self.motion

    def over(self, box: Box | None = None) -> tuple[Simulator, Box]:
        """The simulator and the box of a study. Default: the box of the scene.

        In its runs, a scalar output whose condition never holds has a value, because other outputs need these runs.

        Raises
        ------
        DeclarationError       if there is no box, `box` has a wrong type, or the simulator has no outputs
        """
        own = self.scene if self.given is None else self.given
        box = getattr(own, "box", None) if box is None else box
        if box is None:
            raise DeclarationError(
                "No box: no parameter has an interval. Pass a box, such as box=Box(l1=(0.95, 1.05))."
            )
        if not isinstance(box, Box):
            raise DeclarationError(
                f"box: {shown(box)} is not a Box. Write Box(l1=(0.95, 1.05)), or Box(**intervals) for a dict."
            )
        simulator = self.simulator
        if not len(simulator.outputs):
            raise DeclarationError(f'{own!r} has no outputs. Give some, as in Scene(..., outputs={{"x": body.x}}).')
        if isinstance(simulator, FigureSimulator):
            simulator = simulator.continued()
        return simulator, box.with_units(units_of_parameters(simulator.parameters))


def _card(device: "str | codegen.Card") -> "codegen.Card":
    """The graphics card of a device."""
    if isinstance(device, str) and device == "cuda":
        return codegen.CudaCard()
    if not isinstance(device, codegen.Card):
        raise DeclarationError(f"device: expected 'cuda' or None, got {shown(device)}. None is the processor.")
    return device


@kept_interrupts()
def prepare(scene: Scene, solver: Solver | str | None = None, device: Device = None) -> DAESimulator:
    """Prepare the equations, the start and the solver of a scene for all its runs. The scene stores the result.

    The nominal parameters are run in two ways. If the two runs differ, there are warnings.

    `simulate`, `propagate`, `compare`, `linearize`, `stability` and `view` prepare scenes in this way. If these
    functions get the prepared scene instead of the scene, nothing is derived, chosen or compiled twice.

    Parameters
    ----------
    scene : Scene
    solver : Solver, optional
        solver, or a text that names it, such as "cvodes:1e-9"; default: pilot runs choose the solver for many runs,
        mostly DormandPrince()
    device : "cuda" for runs on a graphics card of NVIDIA, with one sample in each thread; default: the processor. Cards
        run explicit solvers, and need the extra `cuda`

    Returns
    -------
    DAESimulator
        `formulation`, `solver` and `reason` show what was chosen; `warnings` list what is uncertain about the nominal
        run

    Raises
    ------
    DeclarationError
        If the solver cannot run the scene, or cannot run on the card
    CardError
        If there is no card that works
    AssemblyError
        If the scene cannot be started

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), start={"ball.vx": 2.0}, times=[0.0, 1.0])
    >>> prepared = mb.prepare(fall)
    >>> prepared.solver, prepared is mb.prepare(fall), float(mb.simulate(prepared)["ball.y"][-1].round(6))
    (DormandPrince(), True, -4.905)
    """
    scene = scene_of(scene)
    subject = Subject.of(scene, solver, device=device)
    with Progress(f"{scene.name}: equations and trial runs") as progress:
        simulator = subject.motion
        progress(f"{scene.name}: nominal run in two ways", 0, 0)
        simulator.second_look()
    return simulator


def scene_of(subject: Scene | Simulator) -> Scene:
    """The given scene, or the scene of the result of `prepare`.

    Raises
    ------
    DeclarationError       if the subject has another type
    """
    scene = subject.scene if isinstance(subject, DAESimulator) else subject
    if isinstance(scene, Scene):
        return scene
    if hasattr(subject, "outputs") and not isinstance(subject, type):
        what = "a copy without its scene" if isinstance(subject, DAESimulator) else "a simulator"
        raise DeclarationError(f"Expected a Scene, but {subject!r} is {what}. For runs, call its method run(P).")
    raise DeclarationError(f"Expected a Scene, got {type(subject).__name__}. {_SCENE}")


def chosen_parameters(owner: str, names: Sequence[str] | None, nominal: Mapping[str, float]) -> list[str]:
    """The given names of parameters, or the names of all parameters if `names` is None.

    Raises
    ------
    DeclarationError       if there are no parameters, or a name is unknown or listed twice
    """
    if not nominal:
        raise DeclarationError(f"{owner}: there are no parameters. Declare p = Parameters(k=...), and use p.k.")
    if names is None:
        return [*nominal]
    some = require_names(f"{owner}: parameters", "parameter", names, nominal)
    if not some:
        raise DeclarationError(f"{owner}: the list of parameters is empty. Omit it to choose all parameters.")
    if twice := [name for name, count in Counter(some).items() if count > 1]:
        raise DeclarationError(f"{owner}: the list of parameters contains {twice[0]!r} twice.")
    return some
