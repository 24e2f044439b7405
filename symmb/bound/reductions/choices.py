"""Boxes with choices: one study for each combination of choices, and the bounds joined from all of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from symmb._doubt import Doubt, concerned
from symmb._errors import PropagationError
from symmb._names import counted
from symmb.bound import reductions
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method
from symmb.bound.reductions.reduction import Reduced, Reduction
from symmb.bound.responses import first_points
from symmb.equations.model import Box

_LEFT_OUT = "Combinations without any allowed point among those that were tried are left out: {}{}."
_LOST = "No bounds were found for {} of {} of choices. The bounds use only the others. With {}: {}"


class Choices(Reduction):
    """One study for each combination of choices that satisfies the constraints of the box."""

    def accepts(self, method: Method, box: Box) -> bool:
        return bool(box.choices)

    def apply(self, method: Method, box: Box) -> Sequence[Box]:
        own = [each for each in box.combinations() if not each.constraints or len(first_points(each))]
        if not own:
            raise PropagationError(f"{method!r}: no combination of the choices satisfies the constraints of the box.")
        return own

    def invert(self, study: Reduced, found: Sequence[Bounds | PropagationError]) -> Bounds:
        own = zip(self.apply(study.method, study.box), found, strict=True)
        lost = {
            combination_words(study.box, each): " ".join(map(str.strip, str(error).splitlines()[:2]))
            for each, error in own
            if isinstance(error, PropagationError)
        }
        parts = [each for each in found if isinstance(each, Bounds)]
        if not parts:
            word, reason = next(iter(lost.items()))
            raise PropagationError(f"No combination of choices has bounds. With {word}: {reason}")
        return joined(study.box, parts, lost)


def over_parts(bounds: Bounds, work: Callable[[Bounds], Bounds]) -> Bounds:
    """Bounds with the same work done on the bounds of each combination of choices."""
    if not bounds.parts:
        return work(bounds)
    assert bounds.box is not None
    return joined(bounds.box, [work(part) for part in bounds.parts], bounds.lost)


def joined(box: Box, parts: Sequence[Bounds], lost: Mapping[str, str]) -> Bounds:
    """The bounds over a box with choices, from the bounds of each combination.

    `lost` are errors of combinations that have no bounds, by their words.
    """
    words = [combination_words(box, part.box) for part in parts if part.box]
    every = [combination_words(box, own) for own in box.combinations()]
    left_out = [told for told in every if told not in words and told not in lost]
    of_all = counted(len(every), "combination")
    # Recorded runs are the same runs for all combinations.
    own = parts if parts[0].next_run is None else parts[:1]
    return replace(
        reductions.hull_of(parts),
        trace=None,  # each part has its own
        evaluations=sum(part.evaluations for part in own),
        failed=tuple(run for part in own for run in part.failed),
        failed_region="; ".join(
            f"{part.failed_region} with {told}" for part, told in zip(parts, words, strict=True) if part.failed_region
        ),
        run_doubts=(
            *(_LOST.format(len(lost), of_all, *first) for first in [*lost.items()][:1]),
            *_sentences([part.run_doubts for part in parts], words, parts[0].names),
        ),
        remarks=(
            f"The bounds are joined from {len(parts)} of {of_all} of choices.",
            *([_LEFT_OUT.format("; ".join(left_out[:3]), "; ..." * (len(left_out) > 3))] if left_out else []),
            *_sentences([part.remarks for part in parts], words, parts[0].names),
        ),
        parts=tuple(parts),
        lost=lost,
        box=box,
        expansion=None,
        surrogate=None,
        study=None,
        range_of="",
    )


def combination_words(box: Box, combination: Box) -> str:
    """A combination of the choices of a box in words, as "spring: hard, n: 17"."""
    fixed = dict(zip(combination.names, combination.lower.tolist(), strict=True))
    return ", ".join(choice.chosen(fixed) for choice in box.choices)


def _sentences(each: Sequence[Sequence[str]], words: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """The sentences about all combinations. A sentence about only one or some combinations names the first of them."""
    told = dict[str, list[str]]()
    for word, own in zip(words, each, strict=True):
        for text in own:
            told.setdefault(text, []).append(word)
    return tuple(
        text if len(some) == len(each) else Doubt(f"With {some[0]}: {text}", concerned(text, names))
        for text, some in told.items()
    )
