"""Comparison of a scene or a simulator in one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from symmb._errors import warn_of
from symmb._interrupts import kept_interrupts
from symmb._options import require_callable
from symmb._progress import shown
from symmb._types import Array, Executor, Expr
from symmb.black_boxes import Simulator
from symmb.bounds import Bounds, Method, require_method, units_of
from symmb.integrate import Solver
from symmb.model import Box, Scene
from symmb.simulation import SceneSimulator, simulator_of
from symmb.study.comparison_result import Comparison
from symmb.study.measurement import compare_simulator


def compare(
    scene_or_simulator: Scene | Simulator,
    methods: Sequence[Method] | Method | None = None,
    box: Box | None = None,
    reference: Method | Bounds | None = None,
    solver: Solver | None = None,
    *,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
    executor: Executor | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Comparison:
    """Bound a scene's outputs by several methods, and measure each: error against run time.

    Parameters
    ----------
    scene_or_simulator : Scene, FunctionSimulator, ...
    methods : Method or several
        default: several settings of each suitable method
    box : Box
        default: the scene's
    reference : Method or Bounds
        for errors; default: scanning at two resolutions, with a ten times more accurate solver
    solver : Solver
        of all methods, for a Scene; default: chosen by pilot runs
    times, outputs
        instead of those of the scene
    executor : anything with `map`
        runs blocks of samples
    progress : callable
        called with the label of the work, the finished runs and all its runs; default: a bar, in notebooks and
        terminals

    Returns
    -------
    Comparison
        print it, plot it, save it

    Raises
    ------
    DeclarationError
        If there is no box, or an argument is not a method, a box or a solver
    PropagationError
        If no method can run
    KeyboardInterrupt
        If it is interrupted: `partial` then holds the Comparison of the methods so far

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> t = np.linspace(0.0, 1.0, 3)
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> comparison = compare(decay, [mb.Vertex(), mb.PolynomialChaos.paper(2)], mb.Box(k=(0.9, 1.1)))
    >>> [row.evaluations for row in comparison.rows]
    [2, 3]
    """
    chosen = None if methods is None else _methods(methods)
    require_callable("compare: progress", progress, "label", "done", "all")
    if reference is not None and not isinstance(reference, Bounds):
        require_method("compare: reference", reference)
    with kept_interrupts(), shown(progress, "comparing methods") as progress:
        simulator, box = simulator_of(scene_or_simulator, box, solver, times, outputs)
        about: dict[str, Any] = {"scene": repr(simulator), "units": units_of(simulator)}
        if isinstance(simulator, SceneSimulator):
            simulator.prepare()
            about |= {
                "tighter": simulator.tighter(),
                "scene": simulator.name,
                "solver": repr(simulator.solver),
                "setup_seconds": simulator.setup_seconds,
                "threads": simulator.threads,
                "reason": simulator.reason,
            }
        return _doubted(
            compare_simulator(simulator, chosen, box, reference, executor=executor, progress=progress, **about)
        )


def _doubted(comparison: Comparison) -> Comparison:
    """The comparison with a doubt about runs that failed, and a warning of all its doubts."""
    counts = {"the reference": comparison.reference.failed or 0} | {row.name: row.failed for row in comparison.rows}
    if failed := ", ".join(f"{count} of {name}" for name, count in counts.items() if count):
        doubt = f"Runs failed: {failed}. The bounds are those of the others, and what happens near these is not known."
        comparison = replace(comparison, doubts=(*comparison.doubts, doubt))
    warn_of(comparison.doubts, f"Comparison of {comparison.scene}")
    return comparison


def _methods(given: Any) -> tuple[Method, ...]:
    try:
        methods = (given,) if isinstance(given, Method | type | str) else tuple(given)
    except TypeError:
        methods = (given,)
    for method in methods:
        require_method("compare", method)
    return cast(tuple[Method, ...], methods)
