"""The subject of a study: a scene, for which a simulator is made, or a simulator."""

from collections.abc import Mapping, Sequence

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb._types import Array, Expr
from symmb.integrate import Solver
from symmb.model import Box, Scene
from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.simulator import Simulator

_SCENE = "Scene(system, times=...) makes one of a System."


def simulator_of(
    subject: Scene | Simulator,
    box: Box | None,
    solver: Solver | None = None,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> tuple[Simulator, Box]:
    """The simulator and the box of a study, which is that of the scene if none is given.

    Raises
    ------
    DeclarationError       if there is no box, subject, box or solver is something else, or a simulator is given
                           options that only a scene takes
    """
    require_solver(solver)
    box = getattr(subject, "box", None) if box is None else box
    if box is None:
        raise DeclarationError("No box: which parameters are uncertain? Give box=Box(l1=(0.95, 1.05)).")
    if not isinstance(box, Box):
        raise DeclarationError(
            f"box: {shown(box)} is not a Box. Write Box(l1=(0.95, 1.05)), or for a dict Box(**intervals)."
        )
    if isinstance(subject, Scene):
        if times is not None:
            subject = subject.with_times(times)
        if outputs is not None:
            subject = subject.with_outputs(outputs)
        simulator: Simulator = DAESimulator(subject, solver)
    elif not hasattr(subject, "outputs"):
        raise DeclarationError(f"Expected a Scene or a simulator, got {type(subject).__name__}. {_SCENE}")
    elif solver is not None or times is not None or outputs is not None:
        raise DeclarationError(f"{subject!r} has its own solver, times and outputs; only a Scene takes others.")
    else:
        simulator = subject
    return simulator, box


def require_scene(scene: object) -> None:
    """DeclarationError unless it is a Scene."""
    if hasattr(scene, "stream"):
        raise DeclarationError(f"{scene!r} is a simulator. It runs samples P (N, d) of its parameters by run(P).")
    if not isinstance(scene, Scene):
        raise DeclarationError(f"Expected a Scene, got {type(scene).__name__}. {_SCENE}")


def require_solver(solver: object) -> None:
    """DeclarationError unless it is a Solver or None."""
    if isinstance(solver, type):
        raise DeclarationError(f"solver: got the class {solver.__name__}; call it, as in CVODES() or HHT(step=1e-3).")
    if solver is not None and not isinstance(solver, Solver):
        raise DeclarationError(f"solver: {shown(solver)} is not a Solver; give an object such as CVODES(rtol=1e-9).")
