"""The commands `symmb codegen` and `symmb fmu`: scenes for other programs."""

import argparse
import warnings
from collections.abc import Callable
from pathlib import Path

import symmb as mb
from symmb._cleanup import real_path
from symmb._errors import DeclarationError, SymmbWarning
from symmb._progress import Progress
from symmb.run.codegen import require_compiler
from symmb.run.formulations import program_of
from symmb.run.simulation import Subject
from symmb.show.cli import specs
from symmb.show.cli.result_path import result_path
from symmb.show.cli.scene_file import load_scene
from symmb.show.exchange import save_scene_c


def add_export(command: Callable[..., argparse.ArgumentParser], solvers: str) -> None:
    """Add the commands `symmb codegen` and `symmb fmu`."""
    codegen = command(
        "codegen",
        "export equations and runs as C that builds without symmb",
        _codegen,
        solvers,
        usage="-o DIR [options]",
    )
    codegen.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for the C files")
    codegen.add_argument("--solver", metavar="S", help="solver of the runs: dopri, rosenbrock or events")
    fmu = command("fmu", "export the scene as an FMU, for Simulink, Modelica tools and others", _fmu, solvers)
    fmu.add_argument("-o", "--output", metavar="F.fmu", required=True, help="file to write")
    fmu.add_argument("--fmi", metavar="N", type=int, default=3, help="version of FMI, 2 or 3; default: 3")
    fmu.add_argument("--solver", metavar="S", help="solver of co-simulation: dopri, rosenbrock or events")


def _codegen(options: argparse.Namespace) -> None:
    folder = Path(options.output)
    if folder.exists() and not folder.is_dir():
        raise DeclarationError(f"{folder} is a file. -o needs the name of a folder for the C files.")
    solver = specs.solver(options.solver)
    scene = load_scene(options.scene)
    with Progress("generating C"):
        equations = program_of(scene)
        bodies = equations.bodies
        nominal = {**bodies.start.nominal(), "times": equations.times}
        files = dict.fromkeys(bodies.dae.save_c(folder, nominal))
        if solver is None:  # without pilot runs, nothing is compiled
            solver = mb.EventDriven() if bodies.dae.impacts is not None else mb.DormandPrince()
        try:
            files |= dict.fromkeys(save_scene_c(Subject(scene, solver).motion, real_path(folder)))
        except DeclarationError as error:
            warnings.warn(SymmbWarning(f"only the equations are written as C, not runs. {error}"), stacklevel=1)
    print(*files, sep="\n")


def _fmu(options: argparse.Namespace) -> None:
    result_path(options.output, ".fmu")
    require_compiler("The export of an FMU")
    solver = specs.solver(options.solver)
    scene = load_scene(options.scene)
    with Progress(f"exporting {scene.name}"):
        mb.save_fmu(scene if solver is None else mb.prepare(scene, solver), options.output, options.fmi)
    print(options.output)
