"""The command `symmb bound`: bounds by one method, and whether limits are kept."""

import argparse
from collections.abc import Callable, Sequence

import symmb as mb
from symmb._errors import DeclarationError
from symmb._options import shown
from symmb.cli import specs
from symmb.cli.result_path import result_path
from symmb.cli.scene_file import load_subject
from symmb.drawing import FORMATS
from symmb.files import save_json
from symmb.plot import PICTURES

VIOLATED = 1
"""Exit status where a limit is violated, as of a test that fails."""


def add_bound(command: Callable[..., argparse.ArgumentParser], methods: str, solvers: str) -> None:
    """Add the command."""
    bound = command("bound", "bound outputs, and check limits", _bound, f"{methods}\n\n{solvers}")
    bound.add_argument(
        "--box", metavar="k=1:2", nargs="+", action="extend", default=[], help="intervals, beside those of --tolerances"
    )
    bound.add_argument("--tolerances", metavar="F", help="a .csv or .toml table of tolerances, see Box.read")
    bound.add_argument(
        "--limit", metavar="x=:0.3", nargs="+", action="extend", default=[], help="limits low:high of outputs"
    )
    bound.add_argument("--method", metavar="M", default="pce", help="method; default: pce")
    bound.add_argument("--solver", metavar="S", help="solver of the runs")
    bound.add_argument("--json", metavar="F", help="write everything to this file")
    bound.add_argument("--csv", metavar="F", help="write bounds over time to this file")
    bound.add_argument("--plot", metavar="F.png", help="draw bounds over time, and limits")
    bound.add_argument("--view", metavar="F", help="draw the mechanism in the runs that attain the bounds")


def _bound(options: argparse.Namespace) -> tuple[str, ...] | int:
    method = specs.method(options.method)
    solver = None if options.solver is None else specs.solver(options.solver)
    json_file, csv_file = result_path(options.json, ".json"), result_path(options.csv, ".csv")
    picture, drawing = result_path(options.plot, *PICTURES), result_path(options.view, *FORMATS)
    intervals, limits = _ranges("--box", options.box), _ranges("--limit", options.limit)
    subject, box = load_subject(options.scene)
    if options.tolerances is not None:
        box = mb.Box.read(options.tolerances)
    for name, (low, high) in intervals.items():
        if low is None or high is None:
            raise DeclarationError(f"--box: the interval of {name!r} needs both ends, as {name}=1:2.")
    if intervals:
        given = mb.Box(**{name: (float(low or 0), float(high or 0)) for name, (low, high) in intervals.items()})
        box = given if options.tolerances is None or box is None else box | given
    if box is None:
        raise DeclarationError(
            f"{options.scene} has no box that says which parameters are uncertain. Give intervals: --box NAME=1:2."
        )
    if drawing is not None and not isinstance(subject, mb.Scene):
        raise DeclarationError("--view draws scenes only: a simulator has no bodies.")
    bounds = mb.propagate(subject, method, box, solver)
    check = bounds.check(limits) if limits else None
    print(bounds)
    if check is not None:
        print(f"\n{check}")
    if json_file:
        save_json(json_file, bounds.to_json())
    if csv_file:
        bounds.save(csv_file)
    if picture:
        (bounds if check is None else check).plot(picture)
    if drawing is not None:
        mb.view(bounds, drawing)
    if check is not None and check.kept is False:
        return VIOLATED
    undecided = ("A limit is not decided.",) if check is not None and check.kept is None else ()
    return (*bounds.doubts, *undecided)


def _ranges(option: str, words: Sequence[str]) -> dict[str, tuple[float | None, float | None]]:
    """The ends of texts such as k=1:2, by name; None for an end that is left out."""
    found: dict[str, tuple[float | None, float | None]] = {}
    for word in words:
        name, _, text = word.partition("=")
        low, colon, high = text.partition(":")
        try:
            ends = (float(low) if low else None, float(high) if high else None)
        except ValueError:
            colon, ends = "", (None, None)
        if not name or not colon or ends == (None, None):
            raise DeclarationError(f"{option} takes name=low:high, got {shown(word)}.")
        if name in found:
            raise DeclarationError(f"{option} has {name!r} twice.")
        found[name] = ends
    return found
