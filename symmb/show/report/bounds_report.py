"""The report of bounds."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import MappingProxyType

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError, SymmbError
from symmb._magnitudes import SAME
from symmb._types import Figure
from symmb.bound.answers import Bounds, Contributions, LimitCheck, Limits
from symmb.bound.propagation import Study
from symmb.bound.responses import worst_rows
from symmb.equations.model import Scene
from symmb.results import plot
from symmb.results.files import require_suffix
from symmb.run.simulation import DAESimulator, SceneSimulator, simulate
from symmb.show.drawing import of_bounds, of_run, page, start_picture, still
from symmb.show.report import document
from symmb.show.report.document import assumed, called, section, seed, settings_table
from symmb.show.report.verdict import by_urgency, next_steps, verdict

_NO_CONTRIBUTIONS = (
    "The polynomials of the study do not give contributions. {} makes the further runs for contributions."
)
_ASKED, _ASKED_BY_COMMAND = "`bounds.contributions()`", "`symmb bound --contributions`"
_AT_MARGIN = "Outputs with limits: at the time of the smallest margin. Other outputs: at the time of the widest bounds."


def write_bounds(
    bounds: Bounds,
    path: str | Path,
    limits: Limits | None = None,
    block: Mapping[str, object] = MappingProxyType({}),
    *,
    command: str = "",
    contributions: Contributions | None = None,
) -> None:
    """Write the report of bounds; see `Bounds.report`.

    `block` contains the texts of the title block by name. The report shows how to repeat the study: by the `command`,
    or by lines of Python if no command is given.
    Contributions are computed only if they need no further runs. Other contributions must be given.
    """
    require_suffix(path, ".html")
    check = None if limits is None else bounds.check(limits)
    title = f"Bounds of {bounds.subject or ', '.join(bounds.names)}"
    document.write(path, title, _parts(bounds, check, command, contributions), block)


def _parts(
    bounds: Bounds, check: LimitCheck | None, command: str, contributions: Contributions | None
) -> Iterator[str]:
    shares, why = contributions, ""
    try:
        shares = contributions or (bounds._known_contributions() if bounds.range_of else None)
    except SymmbError as error:
        why = document.note(str(error))
    if check is not None and check.kept is not True:
        bounds = bounds._with_nominal()
    yield section("Result", document.sentences(verdict(bounds, check)), style="verdict")
    steps = next_steps(bounds, check, shares)
    yield section("What to do next", document.sentences(("", step) for step in steps), style="steps")
    yield section("Curves", _curves(bounds, check))
    prepared = _prepared(bounds)
    mechanism = "" if prepared is None else _part_or_reason(lambda: _motion(bounds, prepared.scene, check))
    yield section("The mechanism", mechanism)
    yield "" if bounds.box is None else assumed(bounds.box, bounds.nominal_parameters)
    yield document.ANNEX
    yield from _annex(bounds, check, command, shares, why)


def _prepared(bounds: Bounds) -> DAESimulator | None:
    """The prepared scene of a study; None for other simulators, and for bounds from a file."""
    study = bounds.study
    return study.prepared if isinstance(study, Study) and isinstance(study.simulator, SceneSimulator) else None


def _annex(
    bounds: Bounds, check: LimitCheck | None, command: str, shares: Contributions | None, why: str
) -> Iterator[str]:
    """Warnings, tables, settings and equations. If contributions are not known, `why` is the reason."""
    yield section("Warnings and remarks", document.warnings(bounds.doubts, bounds.remarks))
    if check is not None:
        worst = [] if check.worst is None else [document.note(f"Worst case: {check.worst}")]
        yield section("Limits", check._tabulated(), *worst, style="limits")
    yield section("Bounds", bounds._tabulated(bounds._about()))
    if bounds.trace is not None:
        reasons = [("", bounds.why(bounds.names[k])) for k in _shown(bounds, check)]
        found = document.sentences(reasons), bounds.trace._repr_html_()
        yield section("How the errors were found", *found, style="found")
    yield section("Worst cases", _part_or_reason(lambda: _worst(bounds, check)))
    if bounds.range_of or shares is not None:  # other methods would need a second study
        asked = _ASKED_BY_COMMAND if command else _ASKED
        tables = why or _part_or_reason(lambda: _contributions(bounds, check, shares, asked))
        yield section("What each parameter contributes", tables, style="contributions")
    prepared = _prepared(bounds)
    if prepared is not None:
        at_start = document.note(f"{prepared.scene.name} at its start, at the nominal parameters.")
        start = _part_or_reason(lambda: html.picture(start_picture(prepared)))
        yield section("The start", at_start, start, style="still")
    yield settings_table(_settings(bounds), is_own=bounds.study is not None)
    took = f", {bounds.seconds:.3g} s" if np.isfinite(bounds.seconds) else ""
    weighed = " A run with derivatives counts as several runs." if bounds.method.startswith("Taylor(") else ""
    yield section("Cost", document.note(f"{bounds.evaluations} runs{took}.{weighed}"))
    yield section("How to repeat it", *_repeated(command, bounds, prepared is not None, check))
    if prepared is not None:
        system = prepared.scene.system
        yield document.equations(f"{system}\n\n{system.equations()}".rstrip())


def _shown(bounds: Bounds, check: LimitCheck | None) -> list[int]:
    """Numbers of the outputs in pictures and tables of parameters. Outputs with limits are first."""
    names = [*([] if check is None else (limit.output for limit in by_urgency(check))), *bounds.names]
    return [bounds.names.index(name) for name in dict.fromkeys(names)][: plot.MOST_PANELS]


def _worst(bounds: Bounds, check: LimitCheck | None) -> str:
    shown = [bounds.names[k] for k in _shown(bounds, check)]
    cases = [case for case in bounds._all_worst() if case.output in shown]
    return _part(bounds, check) + html.page(html.table(worst_rows(cases))) if cases else ""


def _part(bounds: Bounds, check: LimitCheck | None) -> str:
    """A note if not all outputs are shown."""
    shown, n = len(_shown(bounds, check)), len(bounds.names)
    return document.note(f"{shown} of {n} outputs.") if shown < n else ""


def _pictures(names: Sequence[str], draw: Callable[[str], Figure]) -> str:
    """One picture for each output, because a wide picture with many panels cannot be read on a phone."""
    return document.pictures((name, plot.narrow_png(draw(name))) for name in names)


def _curves(bounds: Bounds, check: LimitCheck | None) -> str:
    shown = [bounds.names[k] for k in _shown(bounds, check)]
    of_check = () if check is None else check.names
    return _part(bounds, check) + _pictures(
        shown, lambda name: (check if check and name in of_check else bounds).plot(outputs=name)
    )


def _contributions(bounds: Bounds, check: LimitCheck | None, shares: Contributions | None, asked: str) -> str:
    """Tables and pictures of contributions. Outputs with limits are shown at the time of their smallest margin."""
    if shares is None:
        return document.note(_NO_CONTRIBUTIONS.format(asked))
    shown = _shown(bounds, check)
    width = bounds.upper - bounds.lower
    rows = {} if check is None else {bounds.names.index(limit.output): limit.row for limit in check.limits}
    rows = {k: i for k, i in rows.items() if width[i, k] > SAME * width[:, k].max()}  # the width may be 0 at the start
    notes = [_AT_MARGIN] if rows else []
    if left := len(bounds.names) - len(shown):
        notes.append(f"{left} of {len(bounds.names)} outputs are left out: `print(bounds.contributions())` shows them.")
    order = shown if left else range(len(bounds.names))
    drawn = _pictures(
        [bounds.names[k] for k in shown],
        lambda name: shares.plot(outputs=name, time=float(bounds.t[0]) if name in bounds.figures else None),
    )
    return "".join(map(document.note, notes)) + shares.some_as_html(order, rows) + drawn


def _part_or_reason(part: Callable[[], str]) -> str:
    """A part, or the reason why it is missing. For example, a run cannot be repeated."""
    try:
        return part()
    except SymmbError as error:
        return document.note(str(error))


def _motion(bounds: Bounds, scene: Scene, check: LimitCheck | None) -> str:
    """The runs that attain the bound closest to a limit, or the widest bounds; or only the nominal run."""
    worst = None if check is None else check.worst
    output, time = (None, None) if worst is None else (worst.output, worst.time)
    text = "The nominal run, and the runs of the study that come closest to the bounds:"
    try:
        exhibit = of_bounds(bounds, output, None if output in bounds.figures else time, None)
    except DeclarationError:
        assert isinstance(bounds.study, Study)
        text = f"The nominal run. {bounds.method} stores no runs that attain its bounds."
        when = scene.times[len(scene.times) // 2] if check is None else bounds.t[check.margin.argmin()]
        exhibit = of_run(simulate(scene, bounds.study.solver), float(when), None)
    file, ghosts = BytesIO(), exhibit.ghosts
    still(replace(exhibit, ghosts=tuple(replace(ghost, label="") for ghost in ghosts)), file, ".png")
    labels = [(ghost.tint, ghost.label) for ghost in ghosts]
    return document.note(text) + document.moving(page(exhibit), file.getvalue(), labels)


def _settings(bounds: Bounds) -> list[tuple[str, str]]:
    simulator = bounds.study.simulator if isinstance(bounds.study, Study) else None
    of_scene = isinstance(simulator, SceneSimulator)
    return [
        ("method", bounds.method),
        ("seed", seed(bounds.method)),
        ("solver", bounds.solver),
        ("why this solver", simulator.reason if of_scene else ""),
        ("simulator", "" if bounds.solver else bounds.subject),
    ]


def _repeated(command: str, bounds: Bounds, of_scene: bool, check: LimitCheck | None) -> list[str]:
    """Requirements, and the command or the lines of Python that compute the bounds again."""
    if command:
        return [document.note("Run this command in the folder with the files that it names:"), html.text(command)]
    solver = repr(bounds.study.solver) if of_scene and isinstance(bounds.study, Study) else ""
    box = "" if bounds.box is None else repr(bounds.box)
    subject = "scene_or_simulator" if bounds.study is None else "scene" if of_scene else "simulator"
    what = f"the declaration of {bounds.subject}" if bounds.subject else "the declaration of its scene or simulator"
    needed = f"This report does not contain {what}. Ask its author for the Python file that defines `{subject}`."
    lines = ["import symmb as mb", f"bounds = mb.propagate({subject}, {called(bounds.method, box, solver)})"]
    limits = () if check is None else check.limits
    ends = {own.output: tuple(x if np.isfinite(x) else None for x in (own.low, own.high)) for own in limits}
    lines.append(f'bounds.report("report.html"{f", {ends}" if ends else ""})')
    return [document.note(f"{needed} Add these lines to the file, and run it:"), html.text("\n".join(lines))]
