"""Options of a picture that a caller sets: axes, and labels, colours and a legend of the curves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb._types import GivenAxes


@dataclass(frozen=True)
class Style:
    """Options of the method `owner`. If an option is None, the picture uses its own default.

    `label` is a text, and `color` a colour of matplotlib. `label` and `color` may be lists, with an entry for each
    curve. `legend` is a bool.
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
        """Labels of curves, by default their names. If there is a single text, it labels the first curve, or each curve
        if the curves are `apart` in panels."""
        if isinstance(self.label, str):
            return [self.label if k == 0 or apart else None for k in range(len(own))]
        return self._each("label", own, lambda text: isinstance(text, str))

    def colours(self, own: Sequence[Any]) -> list[Any]:
        """Colours of curves, by default the colours of the picture. A single colour is used for all curves."""
        from matplotlib.colors import is_color_like

        return [self.color] * len(own) if is_color_like(self.color) else self._each("color", own, is_color_like)

    def _each(self, name: str, own: Sequence[Any], fits: Any) -> list[Any]:
        given = getattr(self, name)
        if given is None:
            return [*own]
        if isinstance(given, list | tuple) and len(given) == len(own) and all(map(fits, given)):
            return [*given]
        raise DeclarationError(f"{self.owner}: {name} must be one value, or a list of {len(own)}, got {shown(given)}.")


OWN = Style()
