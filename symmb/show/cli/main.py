"""The commands, their options and their output."""

import argparse
import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import symmb as mb
from symmb._cleanup import remove_left_folders
from symmb._errors import DeclarationError, SimulationError, SymmbError
from symmb._progress import Progress
from symmb.run.codegen import cache
from symmb.show.cli import specs
from symmb.show.cli.assistant import add_mcp
from symmb.show.cli.bound import add_bound
from symmb.show.cli.compare import add_compare
from symmb.show.cli.completion import add_completion
from symmb.show.cli.export import add_export
from symmb.show.cli.linearize import add_linearize
from symmb.show.cli.live import add_live
from symmb.show.cli.result_path import result_path, result_paths, write_results
from symmb.show.cli.runs import add_runs
from symmb.show.cli.scene_file import add_set, load_scene, scene_and_parameters, shipped_names
from symmb.show.cli.signals import INTERRUPTED
from symmb.show.drawing import FORMATS

_PACKAGE = Path(mb.__file__).parent
_GUIDE = (_PACKAGE if (_PACKAGE / "guide").is_dir() else _PACKAGE.parent / "examples") / "guide" / "index.md"
"""The first page of the guide: inside an installed package, or beside the package in a checkout."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns
    -------
    int     exit status: 1 if a simulation failed or a limit is violated; 2 for wrong input, with a sentence on stderr;
            3 if the result has warnings; 130 if interrupted; otherwise 0
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # terminals without '≤' show '?'
    words = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(words, argparse.Namespace(words=words))
    log = logging.getLogger("symmb")  # messages of the library
    log.handlers = [logging.StreamHandler(sys.stderr)]
    log.setLevel(logging.INFO)
    warnings.showwarning = lambda message, *_: print(f"symmb {options.command}: {message}", file=sys.stderr)
    try:
        result = options.run(options)  # warnings of the result, or an exit status
        sys.stdout.flush()
        # Exit status of a command if the result has warnings.
        return result if isinstance(result, int) else 3 if result else 0
    except SymmbError as error:
        print(f"symmb {options.command}: {error}", file=sys.stderr)
        return 1 if isinstance(error, SimulationError) else 2
    except BrokenPipeError:  # the reader of the pipe, such as `head`, has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        print(f"symmb {options.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interrupt:
        _keep_partial(options, getattr(interrupt, "partial", None))
        return INTERRUPTED
    return 0


def _keep_partial(options: argparse.Namespace, partial: Any) -> None:
    """Print the results so far after an interrupt. Write them to files whose names contain `.partial`."""
    if partial is None:
        return
    print(partial)
    sys.stdout.flush()
    for name in filter(None, (getattr(options, name, None) for name in ("json", "save", "csv"))):
        if not Path(name).suffix:  # a device
            continue
        path = Path(name).with_suffix(f".partial{Path(name).suffix}")
        try:
            partial.save(path)
        except (SymmbError, OSError) as error:
            print(f"symmb {options.command}: {error}", file=sys.stderr)
        else:
            print(f"symmb {options.command}: interrupted. The results so far are in {path}.", file=sys.stderr)


def _simulate(options: argparse.Namespace) -> tuple[str, ...]:
    solver = specs.solver(options.solver)
    paths = result_paths(options)
    scene, parameters = scene_and_parameters(options)
    trajectory = mb.simulate(scene, solver, parameters)
    print(trajectory)
    write_results(paths, trajectory)
    return trajectory.doubts


def _stability(options: argparse.Namespace) -> None:
    paths = result_paths(options)
    scene = load_scene(options.scene)
    result = mb.stability(scene, seconds=options.seconds)
    print(result)
    write_results(paths, result)


def _equations(options: argparse.Namespace) -> None:
    system = load_scene(options.scene).system
    if options.joint:
        system = system.joint_space()
    print(system.latex() if options.latex else f"{system}\n\n{system.equations()}".rstrip())


def _view(options: argparse.Namespace) -> tuple[str, ...]:
    scene, parameters = scene_and_parameters(options)
    path = options.output or f"{'_'.join(scene.name.split())}.html"
    result_path(path, *FORMATS)
    with Progress(f"drawing {scene.name}"):
        if options.mode is None:
            run = mb.simulate(scene, parameters=parameters)
            doubts = run.doubts
        else:
            result = mb.linearize(scene, parameters=parameters)
            if not 1 <= options.mode <= len(result.modes):
                count = f"Number of modes: {len(result.modes)}. The first mode has the number 1."
                raise DeclarationError(f"{scene.name} has no mode {options.mode}. {count}")
            run, doubts = result.motion(options.mode - 1), result.doubts
        mb.view(run, path)
    print(path)
    return doubts


def _cache(options: argparse.Namespace) -> None:
    folder, files = cache.folder(), cache.contents()
    models, size = sum(path.suffix == ".so" for path in files), sum(path.lstat().st_size for path in files)
    if options.clear:
        for path in files:
            path.unlink(missing_ok=True)
        remove_left_folders()
    summary = f"{models} model{'s' * (models != 1)}, {size / 1e6:.1f} MB"
    print(f"{folder}\n{'removed ' if options.clear else ''}{summary}")


class _Parser(argparse.ArgumentParser):
    """A parser that prints an error in one line, without the usage. `--help` shows the usage."""

    def error(self, message: str) -> NoReturn:
        if "required: SCENE" in message:
            message += " (put SCENE first: --methods and --set take all following words)"
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help.\n")


def _parser() -> argparse.ArgumentParser:
    methods, solvers = specs.method_table(), specs.solver_table()
    parser = _Parser(
        prog="symmb",
        description="Symbolic multibody dynamics with interval parameters.",
        epilog=f"{methods}\n\n{solvers}\n\nshipped scenes: {', '.join(shipped_names()) or 'none'}\nguide: {_GUIDE}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"symmb {mb.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, text: str, run, epilog: str = "", usage: str = "[options]") -> argparse.ArgumentParser:
        subcommand = commands.add_parser(
            name,
            usage=f"%(prog)s SCENE {usage}",  # argparse would put SCENE last, after the values of --methods
            help=text,
            description=text,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        subcommand.add_argument(
            "scene", metavar="SCENE", help="a Python file that defines scene, a URDF file, or a shipped scene"
        )
        subcommand.set_defaults(run=run)
        return subcommand

    _add_scene_commands(command, methods, solvers)
    add_runs(commands)
    add_mcp(commands)
    text = "show the folder of compiled models, the number of models, and their size"
    cache_command = commands.add_parser(
        "cache", help=text, description=text + ". Removed models are compiled again when needed."
    )
    cache_command.add_argument("--clear", action="store_true", help="remove the compiled models")
    cache_command.set_defaults(run=_cache)
    add_completion(commands, parser)
    return parser


def _add_scene_commands(command: Callable[..., argparse.ArgumentParser], methods: str, solvers: str) -> None:
    """Add the commands that take a scene, with their options."""
    add_bound(command, methods, solvers)
    add_compare(command, methods, solvers)

    simulate = command("simulate", "run the scene once and print its outputs", _simulate, solvers)
    add_set(simulate)
    simulate.add_argument("--solver", metavar="S", help="solver of the run")
    simulate.add_argument("--json", metavar="F", help="write the complete result to this file")
    simulate.add_argument("--csv", metavar="F", help="write times and outputs to this file")
    simulate.add_argument("--plot", metavar="F.png", help="draw the outputs over time")

    add_linearize(command)

    stability = command("stability", "try every solver on the scene and its variants, and recommend one", _stability)
    stability.add_argument("--json", metavar="F", help="write the complete result to this file")
    stability.add_argument("--plot", metavar="F.png", help="draw error against run time, and drift over time")

    stability.add_argument(
        "--seconds", metavar="S", type=float, default=70.0, help="no run starts after S seconds; default: 70"
    )

    equations = command("equations", "print a summary and the equations of the scene", _equations)
    equations.add_argument("--joint", action="store_true", help="write the equations in joint coordinates")
    equations.add_argument("--latex", action="store_true", help="print the equations in LaTeX")

    view = command("view", "simulate the scene and draw the mechanism, for example as a page for a browser", _view)
    view.add_argument("-o", "--output", metavar="F", help=f"file to write; its suffix is one of {', '.join(FORMATS)}")
    view.add_argument("--mode", metavar="K", type=int, help="draw mode number K, counted from 1, instead of a run")
    add_set(view)

    add_live(command)
    add_export(command, solvers)
