"""The command `symmb linearize`: frequencies, damping and stability."""

import argparse
from collections.abc import Callable

import symmb as mb
from symmb._progress import Progress
from symmb._units import number_or_quantity
from symmb.show.cli.result_path import result_paths, write_results
from symmb.show.cli.scene_file import add_set, scene_and_parameters


def add_linearize(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command `symmb linearize`."""
    linearize = command("linearize", "print frequencies, damping, modes and stability of the scene", _linearize)
    add_set(linearize)
    linearize.add_argument(
        "--time", metavar="S", type=number_or_quantity, help="simulate the scene, and linearise it at this time [s]"
    )
    linearize.add_argument("--json", metavar="F", help="write matrices, eigenvalues and modes to this file")


def _linearize(options: argparse.Namespace) -> tuple[str, ...]:
    paths = result_paths(options)
    scene, parameters = scene_and_parameters(options)
    with Progress(f"linearising {scene.name}"):
        if options.time is None:
            result, doubts = mb.linearize(scene, parameters=parameters), ()
        else:
            run = mb.simulate(scene, parameters=parameters)
            result, doubts = mb.linearize(run, options.time), run.doubts
    print(result)
    write_results(paths, result)
    return (*doubts, *result.doubts)
