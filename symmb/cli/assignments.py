"""The option `--set`: values of parameters."""

import argparse

from symmb._errors import DeclarationError
from symmb._options import shown
from symmb.cli.scene_file import is_urdf, load_scene
from symmb.cli.urdf_scene import parameter_name
from symmb.model import Scene


def add_set(command: argparse.ArgumentParser) -> None:
    """Add the option to a command."""
    text = "parameters that are not nominal"
    command.add_argument("--set", metavar="l1=1.02", nargs="+", action="extend", default=[], help=text)


def scene_and_parameters(options: argparse.Namespace) -> tuple[Scene, dict[str, float]]:
    """The scene of a command, and the parameters that --set gives; of a URDF file these are its numbers.

    It raises DeclarationError if a text is not of the form name=number, or the scene cannot be loaded.
    """
    values = dict[str, float]()
    for text in options.set:
        name, _, value = text.partition("=")
        try:
            values[name] = float(value)
        except ValueError:
            raise DeclarationError(f"--set takes name=number, got {shown(text)}.") from None
    scene = load_scene(options.scene, values)
    if is_urdf(options.scene):
        values = {parameter_name(name): value for name, value in values.items()}
    return scene, values
