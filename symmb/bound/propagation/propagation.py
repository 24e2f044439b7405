"""Bounds of a simulator by a method."""

from dataclasses import replace
from typing import Any

from symmb._errors import PropagationError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._names import ByName
from symmb._progress import shown_runs
from symmb._types import Executor
from symmb._units import units_of_parameters
from symmb.bound import methods
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method, PolynomialChaos
from symmb.bound.propagation.doubts import doubts_of_checks, doubts_of_runs, far_intervals, with_doubts
from symmb.bound.propagation.study import Study
from symmb.bound.reductions import bounded, over_parts
from symmb.connect import Noisy, Progress, Simulator, is_recorded
from symmb.equations.model import Box, Scene
from symmb.run.formulations import program_of
from symmb.run.integrate import Solver
from symmb.run.simulation import Device, SceneSimulator, Subject


@kept_interrupts()
def propagate(
    scene_or_simulator: Scene | Simulator,
    method: Method | str | None = None,
    box: Box | None = None,
    solver: Solver | str | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    device: Device = None,
) -> Bounds:
    """Bound every output of a scene or a simulator over time, for parameters anywhere in a box.

    Parameters
    ----------
    scene_or_simulator : Scene, FunctionSimulator, DAESimulator or anything with their interface
    method : PolynomialChaos(...), Taylor(...), MonteCarlo(...), Scanning(...), ..., a `Method` of your own, or a text
        such as "pce:4"; default: PolynomialChaos()
    box : intervals of some or all parameters; the others keep their nominal values; default: the box of the scene
    solver : solver of a Scene, or a text such as "cvodes:1e-9"; default: pilot runs choose it, usually DormandPrince()
    executor : anything with an ordered ``map`` (thread or process pool, Dask); the result does not depend on the
        executor
    progress : called with the number of finished runs and of all runs. Adaptive methods increase the number of all
        runs. If `progress` has a method ``estimate``, these methods call ``estimate`` with the current estimated error.
        Default: a bar, in notebooks and terminals
    device : "cuda" for runs on a graphics card of NVIDIA; default: the processor. `TaylorModel` and `Optimization` run
        on the processor in any case.

    Returns
    -------
    Bounds
        ``lower`` and ``upper`` (n_t, n_y). ``warnings`` of the bounds state what is uncertain. A SymmbWarning is issued
        as well.

    Raises
    ------
    DeclarationError
        If method is not a method, or if there is no box, or if the box names an unknown parameter.
    PropagationError
        If the simulator lacks what the method needs, or too many runs fail.

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> t = np.array([0.0, 1.0])
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> result = mb.propagate(decay, mb.Vertex(), mb.Box(k=(0.5, 2.0)))
    >>> result.upper[:, 0].round(3)
    array([1.   , 0.607])
    """
    method = PolynomialChaos() if method is None else methods.method_of("propagate", method)
    with shown_runs(progress, repr(method), method.unit_of_work) as progress:
        simulator, box = Subject.of(scene_or_simulator, solver, device=device).over(box)
        if is_recorded(simulator) and method != PolynomialChaos():
            raise simulator.refusal(f"{method!r}: ")
        far = tuple(far_intervals(simulator, box))
        warn_of(far, "propagate")  # now, because such a study may take long
        try:
            bounds = bounded(method, simulator, box, executor=executor, progress=progress)
        except PropagationError as error:
            causes = list(far)
            if isinstance(simulator, SceneSimulator) and simulator.scene is not None:  # None in a pickled copy
                causes += program_of(replace(simulator.scene, box=box)).bodies.start.doubts
            if not causes:
                raise
            raise PropagationError("\n".join((str(error), *causes))) from error
        bounds = finished(method, simulator, bounds, executor)
    warn_of([doubt for doubt in bounds.doubts if doubt not in far], f"Bounds by {bounds.method}")
    return bounds


def finished(method: Method, simulator: Simulator, bounds: Bounds, executor: Executor | None) -> Bounds:
    """The bounds by a method, with warnings, and with the data for further runs."""
    return over_parts(bounds, lambda own: _finished(method, simulator, own, executor))


def _finished(method: Method, simulator: Simulator, bounds: Bounds, executor: Executor | None) -> Bounds:
    box = bounds.box
    assert box is not None
    # These warnings need the nominal run, which also gives the noise.
    told = doubts_of_runs(simulator, bounds), doubts_of_checks(method, simulator, bounds, executor)
    nominal, own = getattr(simulator, "nominal", None), simulator.parameters
    values = ByName({k: float(v) for k, v in own.items()}, units_of_parameters(own))
    if nominal is None:  # black box: the study may have made this run
        nominal = bounds.nominal
    study = None if is_recorded(simulator) or box.constraints else Study(simulator, box, executor)
    known: dict[str, Any] = {"study": study, "nominal": nominal, "nominal_parameters": values}
    of_scene = isinstance(simulator, SceneSimulator)
    known["subject"] = simulator.name if of_scene else repr(simulator)
    known["solver"] = repr(simulator.solver) if of_scene else ""
    if bounds.noise is None and bounds.estimate is None and isinstance(simulator, Noisy):
        known["noise"] = simulator.noise
    return with_doubts(bounds, *told, **known)
