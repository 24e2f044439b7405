"""The scene of a URDF file: the machine is released in its zero pose."""

import re
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import symmb as mb
from symmb._errors import DeclarationError

_TIMES = np.linspace(0.0, 2.0, 201)
"""Output times [s]: an arm falls from rest in about half a second."""


def urdf_scene(path: Path, numbers: Iterable[str]) -> mb.Scene:
    """The machine on its base under gravity for two seconds. It starts at rest in its zero pose, without motors.

    Outputs are the coordinates of its joints, and the positions of bodies that move freely or in a plane. `numbers`
    lists the numbers of the file that become parameters, by their names in the file. `parameter_name` gives the names
    of the parameters. DeclarationError is raised if the file has faults, a number does not exist, or no joint moves.
    """
    names = {name: parameter_name(name) for name in numbers}
    if len(set(names.values())) < len(names):
        raise DeclarationError(
            f"{path}: two of {', '.join(names)} give parameters with equal names. Rename a link or joint."
        )
    with warnings.catch_warnings():  # warnings are reported below
        warnings.simplefilter("ignore", mb.SymmbWarning)
        nominal = mb.load_urdf(path).numbers
    p = mb.Parameters(**{own: nominal.get(name, 0.0) for name, own in names.items()})
    robot = mb.load_urdf(path, replace={name: getattr(p, own) for name, own in names.items()})
    if not robot.elements:
        raise DeclarationError(f"{path}: no joint of this file moves, so a simulation is not possible.")
    gravity = mb.Gravity(0.0, 0.0, -9.81)  # z points up in URDF files
    system = mb.System(*robot.elements, gravity, parameters=p)
    return mb.Scene(system, robot.start, _TIMES, name=path.stem)


def parameter_name(number: str) -> str:
    """The name of the parameter for a number: "forearm_mass" for "forearm.mass"."""
    name = re.sub(r"\W", "_", number)
    return name if name.isidentifier() else f"_{name}"
