"""What a study is about: a scene is made a simulator, a simulator stays what it is."""

from collections.abc import Mapping, Sequence

from symmb._box import Box
from symmb._errors import DeclarationError
from symmb._types import Array, Expr
from symmb.scene import Scene
from symmb.simulate._dae import DAESimulator
from symmb.simulate._ensemble import Simulator
from symmb.solve.solvers import Solver


def simulator_of(
    subject: Scene | Simulator,
    box: Box | None,
    solver: Solver | None = None,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> tuple[Simulator, Box]:
    """The simulator and the box of a study.

    Raises
    ------
    DeclarationError       if there is no box, or a simulator is given options that only a scene takes
    """
    if isinstance(subject, Scene):
        if times is not None:
            subject = subject.with_times(times)
        if outputs is not None:
            subject = subject.with_outputs(outputs)
        box = subject.box if box is None else box
        simulator: Simulator = DAESimulator(subject, solver)
    elif solver is not None or times is not None or outputs is not None:
        raise DeclarationError(f"{subject!r} has its own solver, times and outputs; only a Scene takes others.")
    else:
        simulator = subject
    if box is None:
        raise DeclarationError("No box: which parameters are uncertain? Give box=Box(l1=(0.95, 1.05)).")
    return simulator, box
