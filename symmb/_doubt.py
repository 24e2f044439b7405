"""Warnings that concern only some outputs."""

from collections.abc import Iterable


class Doubt(str):
    """A sentence that says what is uncertain in some outputs. A warning that is a plain text concerns all outputs.

    Attributes
    ----------
    outputs : names            outputs whose errors may be larger than the estimated errors

    Examples
    --------
    >>> concerned(Doubt("The noise of x is large.", ["x"]), "xy"), concerned("A run failed.", "xy")
    (('x',), ('x', 'y'))
    """

    outputs: tuple[str, ...]

    def __new__(cls, text: str, outputs: Iterable[str] = ()) -> "Doubt":
        doubt = super().__new__(cls, text)
        doubt.outputs = tuple(outputs)
        return doubt


def concerned(doubt: str, names: Iterable[str]) -> tuple[str, ...]:
    """Names of the outputs that a warning concerns."""
    return tuple(name for name in names if not isinstance(doubt, Doubt) or name in doubt.outputs)
