"""The simulator of a study, from the subject of the study, which is a scene or a simulator."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TypeAlias

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
from symmb.run.simulation.figure_simulator import FigureSimulator, SceneSimulator
from symmb.run.simulation.random_simulator import RandomSimulator, random_inputs

Device: TypeAlias = "str | codegen.Card | None"
"""The device of runs: "cuda" for a graphics card, or None for the processor."""
_SCENE = "Scene(system, times=...) makes a Scene from a System."


def simulator_of(
    subject: Scene | Simulator,
    box: Box | None,
    solver: Solver | str | None = None,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
    device: Device = None,
) -> tuple[Simulator, Box]:
    """The simulator and the box of a study. Without `box`, the study uses the box of the scene.

    Raises
    ------
    DeclarationError       if there is no box, an argument has a wrong type, or a simulator comes with options of scenes
    """
    solver = solver_of(solver)
    if not (isinstance(subject, Scene) or hasattr(subject, "outputs")):
        raise DeclarationError(f"Expected a Scene or a simulator, got {type(subject).__name__}. {_SCENE}")
    box = getattr(subject, "box", None) if box is None else box
    if box is None:
        raise DeclarationError("No box: no parameter has an interval. Pass a box, such as box=Box(l1=(0.95, 1.05)).")
    if not isinstance(box, Box):
        raise DeclarationError(
            f"box: {shown(box)} is not a Box. Write Box(l1=(0.95, 1.05)), or Box(**intervals) for a dict."
        )
    simulator = simulator_for("", subject, solver, times, outputs, device)
    if not len(simulator.outputs):
        raise DeclarationError(f'{subject!r} has no outputs. Give some, as in Scene(..., outputs={{"x": body.x}}).')
    return simulator, box.with_units(units_of_parameters(simulator.parameters))


def simulator_for(
    owner: str,
    subject: Scene | Simulator,
    solver: Solver | str | None,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
    device: Device = None,
) -> Simulator:
    """The simulator of a scene with these options, or the given simulator, including scalar outputs.

    Raises
    ------
    DeclarationError       if the subject has a wrong type, or a simulator comes with options of scenes
    """
    solver = solver_of(solver)
    if isinstance(subject, Scene):
        return _of_study(with_options(subject, times, outputs), solver, device)
    if not hasattr(subject, "outputs"):
        raise DeclarationError(f"{owner}: expected a Scene or a simulator, got {shown(subject)}.")
    require_own(subject, solver, times, outputs, device)
    if isinstance(subject, DAESimulator) and subject.scene is not None and subject.scene.figures:
        return _of_study(subject.scene, subject.solver, subject.program.card)
    return subject


def _of_study(scene: Scene, solver: Solver | None, device: Device = None) -> Simulator:
    """The simulator of a study of a scene. If the scene has random inputs, it averages over their realizations."""
    if not (inputs := random_inputs(scene)):
        return study_simulator(scene, solver, device)

    key, card = (RandomSimulator, solver, device), None if device is None else _card(device)
    return scene.remembered(key, lambda: RandomSimulator(scene, inputs, solver, card))


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


def with_options(scene: Scene, times: Sequence[float] | Array | None, outputs: Mapping[str, Expr] | None) -> Scene:
    """The scene with other times and outputs, if they are given."""
    scene = scene if times is None else scene.with_times(times)
    return scene if outputs is None else scene.with_outputs(outputs)


def require_own(subject: object, solver: object, times: object, outputs: object, device: object = None) -> None:
    """Raise a DeclarationError if a simulator comes with options that only scenes accept."""
    if any(option is not None for option in (solver, times, outputs, device)):
        raise DeclarationError(
            f"{subject!r} has its own solver, times, outputs and device. Pass a Scene to choose other ones."
        )


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
    solver = solver_of(solver)
    with kept_interrupts(), Progress(f"{scene.name}: equations and trial runs") as progress:
        simulator = simulator_with(scene, solver, device)
        progress(f"{scene.name}: nominal run in two ways", 0, 0)
        simulator.second_look()
    return simulator


def simulator_with(scene: Scene, solver: Solver | str | None = None, device: Device = None) -> DAESimulator:
    """The simulator that `prepare` returns, before the nominal parameters are run in two ways."""
    solver = solver_of(solver)
    if device is None:
        return scene.remembered(solver, lambda: DAESimulator(scene, solver))
    card = _card(device)
    return scene.remembered((solver, device), lambda: simulator_with(scene, solver).on_card(card))


def _card(device: "str | codegen.Card") -> "codegen.Card":
    """The graphics card of a device."""
    if isinstance(device, str) and device == "cuda":
        return codegen.CudaCard()
    if not isinstance(device, codegen.Card):
        raise DeclarationError(f"device: expected 'cuda' or None, got {shown(device)}. None is the processor.")
    return device


def study_simulator(scene: Scene, solver: Solver | None = None, device: Device = None) -> SceneSimulator:
    """The simulator of a study of a scene, which also computes the scalar outputs of the scene."""
    if not scene.figures:
        return simulator_with(scene, solver, device)
    curves, key = scene.curves, (FigureSimulator, solver, device)
    return scene.remembered(key, lambda: FigureSimulator(scene, simulator_with(curves, solver, device)))


def scene_of(subject: Scene | DAESimulator) -> Scene:
    """The given scene, or the scene of the result of `prepare`.

    Raises
    ------
    DeclarationError       if the subject has another type
    """
    scene = subject.scene if isinstance(subject, DAESimulator) else subject
    if isinstance(scene, Scene):
        return scene
    if hasattr(subject, "outputs"):
        raise DeclarationError(f"Expected a Scene, but {subject!r} is a simulator. For runs, call its method run(P).")
    raise DeclarationError(f"Expected a Scene, got {type(subject).__name__}. {_SCENE}")
