"""What a caller asks of a picture: axes to draw in, and labels, colours and a legend of the curves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb._types import GivenAxes


class Look(TypedDict, total=False):
    """Options of every `plot`."""

    label: str | Sequence[str] | None
    color: Any
    legend: bool | None


@dataclass(frozen=True)
class Style:
    """Options of a picture; without them it has a figure, labels and colours of its own.

    Attributes
    ----------
    owner : str                      the method that is called, for messages
    ax : the caller's axes
    label : text, or one for each curve
    color : a colour of matplotlib, or one for each curve
    legend : bool or None            whether there is a legend; None leaves it to the picture
    """

    owner: str = "plot"
    ax: GivenAxes = None
    label: Any = None
    color: Any = None
    legend: Any = None

    def __post_init__(self) -> None:
        if self.legend not in (None, True, False):
            raise DeclarationError(f"{self.owner}: legend must be True or False, got {shown(self.legend)}.")

    def labels(self, own: Sequence[str], apart: bool = False) -> list[str | None]:
        """Labels of curves, by default their own. One text is for all in panels apart, else for the first."""
        if self.label is None:
            return [*own]
        if isinstance(self.label, str):
            return [self.label if k == 0 or apart else None for k in range(len(own))]
        return self._each("label", self.label, own, lambda text: isinstance(text, str), "a text")

    def colours(self, own: Sequence[str]) -> list[Any]:
        """Colours of curves, by default their own."""
        from matplotlib.colors import is_color_like

        if self.color is None:
            return [*own]
        if is_color_like(self.color):
            return [self.color] * len(own)
        return self._each("color", self.color, own, is_color_like, "a colour of matplotlib")

    def _each(self, name: str, given: Any, own: Sequence[str], fits: Any, kind: str) -> list[Any]:
        if isinstance(given, list | tuple) and len(given) == len(own) and all(map(fits, given)):
            return [*given]
        several = f", or a list of {len(own)}" if len(own) > 1 else ""
        raise DeclarationError(f"{self.owner}: {name} must be {kind}{several}, got {shown(given)}.")


OWN = Style()
"""No options."""
