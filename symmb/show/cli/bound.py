"""The command `symmb bound`: bounds by one method, and a check of limits."""

import argparse
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import symmb as mb
from symmb._errors import DeclarationError
from symmb._options import require_names, shown
from symmb._units import number_or_quantity, quantity, units_of_parameters
from symmb.bound.answers import limit_pairs
from symmb.connect import Simulator
from symmb.show.cli import specs
from symmb.show.cli.result_path import result_paths, write_results
from symmb.show.cli.scene_file import load_subject
from symmb.show.report import BLOCK, write_bounds

_NO_CONTRIBUTIONS = "The contributions of parameters need further runs. Add --contributions to make these runs."
End = float | str | None
"""An end of an interval: a number, a number with a unit, or None."""


def add_bound(command: Callable[..., argparse.ArgumentParser], methods: str, solvers: str) -> None:
    """Add the command `symmb bound`."""
    bound = command("bound", "bound outputs, and check limits", _bound, f"{methods}\n\n{solvers}")
    several: dict[str, Any] = {"nargs": "+", "action": "extend", "default": []}
    bound.add_argument("--box", metavar="k=1:2", **several, help="intervals that replace the box of the scene")
    bound.add_argument("--tolerances", metavar="F", help="a table of intervals (.csv, .toml), in addition to --box")
    bound.add_argument("--limit", metavar="x=:0.3", **several, help="limits low:high of outputs")
    bound.add_argument("--method", metavar="M", default="pce", help="method; default: pce")
    bound.add_argument("--solver", metavar="S", help="solver of the runs")
    bound.add_argument("--contributions", action="store_true", help="make further runs for contributions")
    bound.add_argument("--json", metavar="F", help="write the complete result to this file")
    bound.add_argument("--csv", metavar="F", help="write bounds over time to this file")
    bound.add_argument("--plot", metavar="F.png", help="draw bounds over time, and limits")
    bound.add_argument("--view", metavar="F", help="draw the mechanism in the runs that attain the bounds")
    bound.add_argument("--report", metavar="F.html", help="write a printable report of the bounds and limits")
    text = f"parts of the report's title block: {', '.join(BLOCK)}"
    bound.add_argument("--title-block", metavar="author=A", **several, help=text)


def _bound(options: argparse.Namespace) -> tuple[str, ...] | int:
    method = specs.method(options.method)
    solver = specs.solver(options.solver)
    paths = result_paths(options)
    limits = limits_of(options)
    block = dict(word.partition("=")[::2] for word in options.title_block)
    require_names("--title-block", "part", [*block], BLOCK)
    subject, own = load_subject(options.scene)
    box = _box(options, subject, own)
    if limits:  # check before the study, which may take long
        names = subject.output_names if isinstance(subject, mb.Scene) else subject.outputs
        limit_pairs("--limit", limits, names, getattr(subject, "units", ()))
    if "view" in paths and not isinstance(subject, mb.Scene):
        raise DeclarationError("--view draws only scenes, because a simulator has no bodies. Leave --view out.")
    bounds = _about_fixed(mb.propagate(subject, method, box, solver), own)
    check = bounds.check(limits) if limits else None
    print(*filter(None, (bounds, check)), sep="\n\n")
    contributions = _tell_contributions(bounds, options.contributions)
    write_results(paths, bounds, {"limits": check.to_json()} if check else {}, drawn=check)
    if "view" in paths:
        mb.view(bounds, paths["view"])
    if "report" in paths:
        command = shlex.join(["symmb", *options.words])
        write_bounds(bounds, paths["report"], limits or None, block, command=command, contributions=contributions)
    if check is None or check.kept:
        return bounds.doubts
    # Exit status if a limit is violated. A failed test has the same status.
    return 1 if check.kept is False else (*bounds.doubts, "It is not decided whether all limits are satisfied.")


def _about_fixed(bounds: mb.Bounds, own: mb.Box | None) -> mb.Bounds:
    """The bounds, with a remark on parameters that have an interval only in the box of the scene."""
    fixed = [name for name in own or () if name not in (bounds.box or ())]
    text = f"{', '.join(fixed)} keep their nominal values, because --box and --tolerances replace the scene's box."
    return replace(bounds, remarks=(*bounds.remarks, text)) if fixed else bounds


def _tell_contributions(bounds: mb.Bounds, is_asked: bool) -> mb.Contributions | None:
    """Contributions if they need no further runs, or are requested. Otherwise a text explains how to get them."""
    contributions = bounds.contributions() if is_asked else bounds._known_contributions() if bounds.range_of else None
    if contributions is not None or bounds.range_of:
        print("", contributions or _NO_CONTRIBUTIONS, sep="\n")
    return contributions


def limits_of(options: argparse.Namespace) -> dict[str, tuple[End, End]]:
    """The limits of outputs, from the options."""
    limits = _ranges("--limit", options.limit)
    for name, ends in limits.items():
        if ends == (None, None):
            raise DeclarationError(f"--limit {name}=low:high has no number. Give low, high or both.")
    return limits


def _box(options: argparse.Namespace, subject: mb.Scene | Simulator, own: mb.Box | None) -> mb.Box:
    """The intervals of --box and of --tolerances, or the intervals of the scene if both are missing."""
    intervals: dict[str, Any] = {}
    for name, (low, high) in _ranges("--box", options.box).items():
        if low is None or high is None:
            raise DeclarationError(f"--box: the interval of {name!r} needs both ends, such as {name}=1:2.")
        intervals[name] = low, high
    if options.tolerances is not None:
        nominal = subject.system.parameters if isinstance(subject, mb.Scene) else subject.parameters
        table, units = mb.Box.read(options.tolerances, nominal), units_of_parameters(nominal)
        return table | mb.Box(**intervals).with_units(units) if intervals else table
    if intervals:
        return mb.Box(**intervals)
    if own is None:
        raise DeclarationError(f"{options.scene} has no box with uncertain parameters. Give intervals: --box NAME=1:2.")
    return own


def _ranges(option: str, words: Sequence[str]) -> dict[str, tuple[End, End]]:
    """The ends of texts such as k=1:2 and k=1:2mm, by name; None if an end is missing. A unit applies to both ends."""
    ranges: dict[str, tuple[End, End]] = {}
    for word in words:
        name, _, text = word.partition("=")
        low, colon, high = text.partition(":")
        try:
            low, high = (number_or_quantity(end) if end else None for end in (low, high))
            units = {quantity(f"{option} {name}:", end)[1] for end in (low, high) if isinstance(end, str)}
            if len(units) == 1:
                low, high = (f"{end!r} {min(units)}" if isinstance(end, float) else end for end in (low, high))
        except ValueError:
            colon = ""
        if not name or not colon:
            raise DeclarationError(f"{option} must be name=low:high, got {shown(word)}.")
        if name in ranges:
            raise DeclarationError(f"{option} has {name!r} twice. Give each name once.")
        ranges[name] = low, high
    return ranges
