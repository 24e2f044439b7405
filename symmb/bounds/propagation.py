"""Bounds of a simulator by a method."""

from dataclasses import replace

import numpy as np

from symmb._errors import warn_of
from symmb._progress import shown_runs
from symmb._types import Executor
from symmb.bounds.method import Method, parameter_samples, require_method
from symmb.bounds.result import Bounds
from symmb.bounds.study import study_of
from symmb.events import longest_steps
from symmb.integrate import Solver
from symmb.model import Box, Scene
from symmb.nodes import grid
from symmb.simulation import DAESimulator, Noisy, Progress, Simulator, simulator_of


def propagate(
    scene_or_simulator: Scene | Simulator,
    method: Method,
    box: Box | None = None,
    solver: Solver | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Bounds:
    """Bound every output of a scene or a simulator over time, for parameters anywhere in a box.

    Parameters
    ----------
    scene_or_simulator : Scene, FunctionSimulator, DAESimulator or anything with their interface
    method : PolynomialChaos(...), Taylor(...), MonteCarlo(...), Scanning(...), ...
    box : intervals of some or all parameters; the others keep their nominal values; default: that of the scene
    solver : of a Scene; default: chosen by pilot runs, mostly DormandPrince()
    executor : anything with an ordered ``map`` (thread or process pool, Dask); the result does not depend
        on it
    progress : called with the finished runs and all runs; adaptive methods plan more as they go, and call its method
        ``estimate`` with the estimated error that they have reached, if it has one; default: a bar, in notebooks and
        terminals

    Returns
    -------
    Bounds
        ``lower`` and ``upper`` (n_t, n_y). What is doubtful about them stands in ``doubts``, and is a SymmbWarning.

    Raises
    ------
    DeclarationError
        If method is not a method, there is no box, or it names an unknown parameter.
    PropagationError
        If the simulator lacks what the method needs, or too many runs fail.

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> t = np.array([0.0, 1.0])
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> result = propagate(decay, mb.Vertex(), mb.Box(k=(0.5, 2.0)))
    >>> result.upper[:, 0].round(3)
    array([1.   , 0.607])
    """
    require_method("propagate", method)
    with shown_runs(progress, repr(method)) as progress:
        simulator, box = simulator_of(scene_or_simulator, box, solver)
        bounds = method.bounds(simulator, box, executor=executor, progress=progress)
    doubts = _doubts_of_proofs(simulator) if bounds.kind == "enclosure" else _doubts_of_runs(simulator, box, bounds)
    bounds = replace(
        bounds, run_doubts=(*bounds.run_doubts, *doubts), study=study_of(scene_or_simulator, simulator, method, box)
    )
    warn_of(bounds.doubts, f"Bounds by {bounds.method}")
    return bounds


def _doubts_of_proofs(simulator: Simulator) -> tuple[str, ...]:
    """Doubts about the start. Proofs make no runs, and errors of the solver are none of theirs."""
    return simulator.start.doubts if isinstance(simulator, DAESimulator) else ()


def _doubts_of_runs(simulator: Simulator, box: Box, bounds: Bounds) -> tuple[str, ...]:
    own = getattr(simulator, "doubts", ())
    return (*own, *_pulse_doubts(simulator, box), *_noise_doubts(simulator, bounds))


def _pulse_doubts(simulator: Simulator, box: Box) -> tuple[str, ...]:
    """Whether laws of time have pulses at corners of the box that are shorter than those which steps follow."""
    if not isinstance(simulator, DAESimulator):
        return ()
    d = len(box)
    unit = np.random.default_rng(0).choice([-1.0, 1.0], (_CORNERS, d)) if 2**d > _CORNERS else grid(_ENDS, d)
    P = np.vstack([simulator.dae.p_nominal, parameter_samples(simulator, box, unit)])
    usual, *others = longest_steps(simulator.dae, simulator.times, P).tolist()
    k = int(np.argmin(others))
    if others[k] > min(usual / 2, _LONG * float(np.ptp(simulator.times))):
        return ()
    where = ", ".join(f"{name} = {value:g}" for name, value in zip(simulator.parameters, P[k + 1], strict=True))
    return (
        f"At {where} a law of time has a pulse over which steps may pass: they follow the pulses at the nominal "
        "parameters. Take nominal parameters at which it is shortest.",
    )


def _noise_doubts(simulator: Simulator, bounds: Bounds) -> tuple[str, ...]:
    """Outputs whose noise is told to be larger than the width that runs attain. That of scenes is a rough guess."""
    if isinstance(simulator, DAESimulator) or not isinstance(simulator, Noisy) or simulator.noise is None:
        return ()
    lower, upper = bounds.inner or (bounds.lower, bounds.upper)
    below = (upper <= lower + simulator.noise).all(axis=0) & (lower < upper).any(axis=0)
    names = ", ".join(bounds.names[k] for k in np.flatnonzero(below))
    return (f"The noise is told to be larger than the width of {names}.",) if names else ()


_LONG = 1e-2
"""Share of the horizon above which steps meet a pulse anyway."""
_CORNERS, _ENDS = 64, np.array([-1.0, 1.0])
"""Most corners of the box at which laws are searched for pulses, and the ends of a parameter."""
