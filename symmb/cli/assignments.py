"""The option `--set`: values of parameters."""

import argparse
from collections.abc import Sequence

from symmb._errors import DeclarationError


def add_set(command: argparse.ArgumentParser) -> None:
    """Add the option to a command."""
    text = "parameters that are not nominal"
    command.add_argument("--set", metavar="l1=1.02", nargs="+", action="extend", default=[], help=text)


def assignments(texts: Sequence[str]) -> dict[str, float]:
    """Values by name.

    Raises
    ------
    DeclarationError    if a text is not of the form name=number
    """
    parameters = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            parameters[name] = float(value)
        except ValueError:
            raise DeclarationError(f"--set takes name=number, got {text!r}.") from None
    return parameters
