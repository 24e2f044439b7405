"""The command `symmb compare`: bounds by several methods, on this machine or on others."""

import argparse
import math
import shlex
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

import symmb as mb
from symmb._cleanup import end_with_parent
from symmb._errors import DeclarationError
from symmb._options import shown
from symmb._types import Executor
from symmb.connect import Simulator
from symmb.show.cli import specs
from symmb.show.cli.result_path import result_paths, write_results
from symmb.show.cli.scene_file import is_urdf, load_subject
from symmb.show.cli.urdf_scene import parameter_name
from symmb.show.report import write_comparison

_OVER_TIME = "lower", "upper", "estimate", "inner_lower", "inner_upper"
"""Entries of a method over time. They are large, so the file with the table does not contain them."""


def add_compare(command: Callable[..., argparse.ArgumentParser], methods: str, solvers: str) -> None:
    """Add the command `symmb compare`."""
    compare = command(
        "compare", "bound outputs by several methods and measure each", _compare, f"{methods}\n\n{solvers}"
    )
    compare.add_argument(
        "--spread",
        metavar="5%",
        help="half width of the intervals in the box of the file, as 5%% or 0.05 of the nominal values",
    )
    compare.add_argument(
        "--uncertain",
        metavar="NAME",
        nargs="+",
        action="extend",
        default=[],
        help="parameters for --spread, instead of those in the box of the file; for URDF files such as forearm.mass",
    )
    compare.add_argument(
        "--methods", metavar="M", nargs="+", action="extend", help="methods to compare; default: a dozen settings"
    )
    compare.add_argument("--solver", metavar="S", help="solver of all methods")
    compare.add_argument("--store", metavar="F.db", help="store each run in this file, and read stored runs from it")
    elsewhere = compare.add_mutually_exclusive_group()
    elsewhere.add_argument("--workers", metavar="N", type=int, help="make runs in N processes")
    elsewhere.add_argument("--dask", metavar="ADDRESS", help="make runs on the Dask cluster of this scheduler")
    compare.add_argument("--json", metavar="F", help="write the table and its notes to this file")
    compare.add_argument("--save", metavar="F.npz", help="write everything to this file, which Comparison.load reads")
    compare.add_argument("--plot", metavar="F.png", help="draw bounds over time and error against run time")
    compare.add_argument("--report", metavar="F.html", help="write a printable report of the comparison")


def _compare(options: argparse.Namespace) -> tuple[str, ...]:
    methods = None if options.methods is None else [specs.method(text) for text in options.methods]
    solver = specs.solver(options.solver)
    paths = result_paths(options)
    if options.workers is not None and options.workers < 1:
        raise DeclarationError(f"--workers must be a number of processes, 1 or more, got {options.workers}.")
    if options.uncertain and options.spread is None:
        raise DeclarationError("--uncertain needs the width of the intervals. Give it, for example, by --spread 5%.")
    subject, own = load_subject(options.scene, options.uncertain)
    box = _box(options, subject, own)
    if options.store is not None:
        if isinstance(subject, mb.Scene):
            subject, solver = mb.prepare(subject, solver), None
        subject = mb.StoredSimulator(subject, options.store)
    with _executor(options) as executor:
        comparison = mb.compare(subject, methods, box, solver=solver, executor=executor)
    print(comparison)
    write_results(paths, comparison, _table(comparison) if "json" in paths else {})
    if "report" in paths:
        write_comparison(comparison, paths["report"], shlex.join(["symmb", *options.words]))
    return comparison.doubts


def _table(comparison: mb.Comparison) -> dict[str, Any]:
    """The entries of a file, without bounds over time."""
    entries = comparison.to_json()
    reference, *methods = (
        {name: value for name, value in part.items() if name not in _OVER_TIME}
        for part in (entries["reference"], *entries["methods"])
    )
    return {"reference": reference, "methods": methods}


@contextmanager
def _executor(options: argparse.Namespace) -> Iterator[Executor | None]:
    if options.dask is None:
        pool = partial(ProcessPoolExecutor, options.workers, initializer=end_with_parent)
        yield None if options.workers is None else pool
        return
    try:
        from dask.distributed import Client
    except ImportError:
        raise DeclarationError("--dask needs Dask: pip install 'symmb[dask]'.") from None
    try:
        client = Client(options.dask)
    except (OSError, ValueError) as error:
        raise DeclarationError(f"--dask {options.dask}: {error}") from None
    with client:
        if not is_urdf(options.scene):
            client.upload_file(options.scene)
        yield client


def _box(options: argparse.Namespace, subject: mb.Scene | Simulator, own: mb.Box | None) -> mb.Box:
    """The intervals of --spread, or the intervals of the file if the option is missing."""
    if options.spread is None:
        if own is None:
            raise DeclarationError(
                f"{options.scene} has no box with uncertain parameters. Give names and a half width: "
                "--uncertain NAME --spread 5%."
            )
        return own
    spread, names = _share(options.spread), options.uncertain
    if is_urdf(options.scene):
        names = [parameter_name(name) for name in names]
    if not names:
        if own is None:
            raise DeclarationError(
                f"--spread: {subject!r} has no box with uncertain parameters. Name the parameters by --uncertain, "
                "or give its Scene box=mb.Box.around(p, 0.05) or box=mb.Box(name=(lower, upper))."
            )
        names = own.names
    parameters: Mapping[str, float] = (subject.system if isinstance(subject, mb.Scene) else subject).parameters
    return mb.Box.around(parameters, spread, names)


def _share(text: str) -> float:
    try:
        share = float(text.removesuffix("%")) * (0.01 if text.endswith("%") else 1.0)
    except ValueError:
        share = math.nan
    if not 0.0 < share < math.inf:
        raise DeclarationError(f"--spread must be a positive number such as 5% or 0.05, got {shown(text)}.")
    if share >= 1.0:
        hint = "Declare wider intervals by their ends in the Box." if text.endswith("%") else f"Did you mean {text}%?"
        raise DeclarationError(f"--spread {text} is {100.0 * share:g} %, so the intervals would contain 0. {hint}")
    return share
