"""Bounds of a simulator over a box: reductions, and then a method."""

from symmb._errors import DeclarationError, PropagationError
from symmb._interrupts import carry
from symmb._names import did_you_mean
from symmb._options import require_callable
from symmb._types import Executor
from symmb._units import units_of_parameters
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method
from symmb.bound.reductions.absences import bounds_with_absences, with_open_ends
from symmb.bound.reductions.choices import Choices
from symmb.bound.reductions.constraints import Constraints
from symmb.bound.reductions.reduction import Reduced, Reduction
from symmb.bound.reductions.unseen import bounds_with_unseen
from symmb.bound.responses import RunsOverBox
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box, hint, require_numbers_of_words

REDUCTIONS: tuple[Reduction, ...] = Choices(), Constraints()
"""The reductions, in the order in which features are taken out of a box."""


def bounded(
    method: Method,
    simulator: Simulator,
    box: Box,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    searched: bool = True,
) -> Bounds:
    """Bound all outputs of a simulator at all its times over a box, without check runs; see `propagate`.

    If `searched` is False, there is no search for elements that act in a small part of the box.

    Raises
    ------
    DeclarationError
        If the box names a parameter that the simulator does not have.
    PropagationError
        If the simulator lacks what the method needs, too many runs fail, or a method of the user returns no bounds.
    KeyboardInterrupt
        If the study is interrupted. ``partial`` then contains the bounds that runs have attained, if there are any.
    """
    for name in box.names:
        if name not in simulator.parameters:
            known = did_you_mean(name, simulator.parameters)
            raise DeclarationError(f"Box: no parameter {name!r}.{known}{hint(box.choices, name)}")
    box = box.with_units(units_of_parameters(simulator.parameters))
    require_numbers_of_words(box.choices, simulator.parameters)
    require_callable("progress", progress, "done", "all")

    def found(own: Box) -> Bounds | PropagationError:
        try:
            # Places that the constraints do not allow would be searched, and change the errors of the polynomials.
            may_search = searched and not box.constraints
            return bounded(method, simulator, own, executor=executor, progress=progress, searched=may_search)
        except PropagationError as error:
            return error

    for reduction in REDUCTIONS:
        if reduction.accepts(method, box):
            boxes, study = reduction.apply(method, box), Reduced(method, simulator, box, executor)
            parts = list[Bounds | PropagationError]()
            try:
                for own in boxes:
                    parts.append(found(own))
            except KeyboardInterrupt as interrupt:
                if any(isinstance(part, Bounds) for part in parts):
                    left = [PropagationError("interrupted")] * (len(boxes) - len(parts))
                    carry(interrupt, reduction.invert(study, [*parts, *left]))
                raise
            return reduction.invert(study, parts)
    runs = RunsOverBox(repr(method), simulator, box, executor, progress)
    return with_open_ends((bounds_with_unseen if searched else bounds_with_absences)(method, runs))
