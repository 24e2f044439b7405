"""The command `symmb mcp`: a server by which assistants study scenes, over the Model Context Protocol.

A scene file is Python code. The server therefore loads shipped scenes, and files in the folders that are given at its
start. Paths are resolved before this check. Code in these folders has all rights of the user who starts the server.
"""

import argparse
import ast
import inspect
import re
from collections.abc import Callable, Sequence
from functools import wraps
from itertools import chain, count
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

import symmb as mb
from symmb import models
from symmb._cleanup import real_path
from symmb._errors import DeclarationError, SymmbError
from symmb._names import did_you_mean
from symmb._options import optional_package
from symmb._table import aligned
from symmb._units import label, units_of_parameters, values_text
from symmb.show.cli.scene_file import is_urdf, load_scene, shipped_names

_INSTRUCTIONS = (
    "symmb simulates mechanisms, and bounds their outputs for all parameters in a box of intervals. Call `scenes` for "
    "the scenes, and `describe` for the names, units and intervals of a scene. Values are numbers in the unit that "
    "`describe` prints for the name (SI units if it prints none), or texts such as '235 mm'. A `box` replaces the box "
    "of the scene. Each parameter has [lower, upper], or a tolerance of its nominal value such as '5%' or '±0.1 mm'. "
    "Parameters that are not in the box keep their nominal values. `limits` give [lower, upper] of outputs, with null "
    "for a missing end. Bounds are estimates. Report their estimated errors and warnings with them."
)
_FORMATS = {
    "box": "`box` replaces the box of the scene: parameter -> [lower, upper], or a tolerance of its nominal value such "
    "as '5%' or '±0.1 mm'. Parameters that are not in it keep their nominal values.",
    "limits": "`limits`: output -> [lower, upper], with null for a missing end.",
}
"""Arguments of several tools, described with each tool."""
_FAULTS = SymmbError, OSError, ImportError, ValueError
"""Exceptions whose texts are results of tools. A path with a null byte is a ValueError."""
End = float | str
Values = dict[str, Any]
BoxText = dict[str, str | list[End]]
LimitText = dict[str, list[End | None]]


class Tools:
    """The tools of the server as methods that return texts. Tools raise the errors of `_FAULTS`."""

    def __init__(self, folders: Sequence[str]) -> None:
        self._folders = [real_path(folder) for folder in folders]
        for folder in self._folders:
            if not folder.is_dir():
                raise DeclarationError(f"{folder} is not a folder. Give folders with scene files.")
        self.progress: Callable[..., None] | None = None
        self.remark = ""  # about the last box

    def scenes(self) -> str:
        """List the shipped scenes, and the Python and URDF files in the folders. URDF files have no parameters here."""
        files = [path for folder in self._folders for kind in ("*.py", "*.urdf") for path in sorted(folder.glob(kind))]
        return "\n".join(["shipped scenes: " + ", ".join(shipped_names()), *(f"file: {path}" for path in files)])

    def describe(self, scene: str) -> str:
        """Describe a scene: words in its file, system, nominal parameters, times, outputs, units, start and box."""
        path = self._path(scene)
        found = load_scene(path)
        words = "" if is_urdf(path) else ast.get_docstring(ast.parse(Path(path).read_bytes()))
        lines = [*filter(None, [words]), repr(found), str(found.system), f"nominal: {found.system.parameters}"]
        names = map(label, found.output_names, found.units)
        kinds = (found.figures[name].kind if name in found.figures else "" for name in found.output_names)
        texts = (f"{name} ({kind} over a run)" if kind else name for name, kind in zip(names, kinds, strict=True))
        lines += [f"outputs: {', '.join(texts)}"]
        if found.start:
            lines.append(f"start (SI units): {', '.join(f'{name} = {value}' for name, value in found.start.items())}")
        return "\n".join([*lines, f"box: {found.box or 'none; give a box for bounds'}"])

    def simulate(self, scene: str, parameters: Values | None = None, times: list[float] | None = None) -> str:
        """Run a scene once. The table has the first, last, lowest and highest value of each output over its times.

        `parameters` replace nominal values. `times` [s] give a table of the outputs at these times instead, in
        increasing order. The times may be closer or later than those of the scene. The first row is the start.
        """
        found = load_scene(self._path(scene))
        if times is None:
            return str(mb.simulate(found, parameters=parameters))
        first = [] if times[:1] == [found.times[0]] else [found.times[0]]
        run = mb.simulate(found, parameters=parameters, times=[*first, *times])
        rows = [[f"{value + 0:.6g}" for value in (time, *row)] for time, row in zip(run.t, run.values, strict=True)]
        table = aligned([["time [s]", *map(label, run.names, run.units)], *rows])
        return "\n".join([*table, *(f"warning: {doubt}" for doubt in run.doubts)])

    def bound(self, scene: str, box: BoxText | None = None, method: str = "pce") -> str:
        """Bound all outputs over all times, for all parameters in the box.

        `method`: "pce" (polynomial chaos, with estimated errors), "mc:500" (500 random runs), "scan:11" (11 values of
        each parameter), "vertex" (corners of the box), "taylor:2" (Taylor series), "opt" (optimisation of each bound),
        "swarm" (particle swarm), "interval" (interval arithmetic) or "tm" (proved bounds by Taylor models). Bounds by
        runs, such as "mc", are never too wide.
        """
        return str(self._bounds(scene, box, method))

    def worst_case(
        self, scene: str, output: str, time: End | None = None, box: BoxText | None = None, method: str = "pce"
    ) -> str:
        """The lowest and highest value of an output, when they occur, and the parameters that cause them.

        With `time` [s], the extremes at the closest output time. Without `time`, the extremes over all output times.
        `method` is one of those of `bound`. In the answer, `bound` is the estimate, ± its estimated error, and
        `attained` the output in a run with these parameters.
        """
        bounds = self._bounds(scene, box, method)
        return _with_warnings(bounds.worst(output, time), bounds)

    def limits(self, scene: str, limits: LimitText, box: BoxText | None = None) -> str:
        """Check whether outputs stay within limits for all parameters in the box, with margins and the worst case.

        The check also searches between output times, so its worst case may be slightly beyond that of `worst_case`.
        Parameters that hardly change the output may then have other values.
        """
        bounds = self._bounds(scene, box)
        return _with_warnings(bounds.check(_pairs(limits)), bounds)

    def tolerances(self, scene: str, limits: LimitText, box: BoxText | None = None) -> str:
        """The largest factor of all tolerances in the box with which outputs satisfy the limits.

        A factor below 1 means that the box violates the limits. This makes several hundred runs.
        """
        subject, box_ = self._subject(scene, box)
        return str(mb.tolerances(subject, _pairs(limits), box_, progress=self.progress))

    def contributions(self, scene: str, box: BoxText | None = None) -> str:
        """The contribution of each parameter to each output, at the time of the output's largest width.

        Columns: `alone` is the width if only this parameter varies, and `saved` is the width that vanishes if only this
        parameter is exact, both with their errors ±. `of width` gives both in percent of the full width. `first` and
        `total` are Sobol's indices, the shares of the variance.
        """
        bounds = self._bounds(scene, box)
        return _with_warnings(bounds.contributions(), bounds)

    def report(self, scene: str, limits: LimitText | None = None, box: BoxText | None = None) -> str:
        """Write a printable report (.html) of the bounds and limits. Return its path and the check of the limits."""
        path, bounds = self._output(scene, "report"), self._bounds(scene, box)
        bounds.report(path, _pairs(limits) if limits else None)
        return _with_warnings("\n".join([str(path), *([str(bounds.check(_pairs(limits)))] if limits else [])]), bounds)

    def view(
        self,
        scene: str,
        parameters: Values | None = None,
        output: str | None = None,
        time: End | None = None,
        box: BoxText | None = None,
    ) -> str:
        """Write an animated page (.html) of the mechanism, and return its path.

        The page shows one run, with `parameters` instead of nominal values. With `output`, the page shows the two runs
        in which this output is lowest and highest at one time, for parameters in the box. This is `time` [s], by
        default the time of the largest width. The answer lists both runs.
        """
        path = self._output(scene, "view")
        if output is None:
            mb.view(mb.simulate(load_scene(self._path(scene)), parameters=parameters), path)
            return str(path)
        bounds = self._bounds(scene, box)
        mb.view(bounds, path, output=output, time=time)
        if time is None and output in bounds.names and output not in bounds.figures:
            lower, upper = bounds[output]
            time = float(bounds.t[np.argmax(upper - lower)])
        return _with_warnings(f"{path}\n{bounds.worst(output, time)}", bounds)

    def _path(self, scene: str) -> str:
        """The file of a shipped scene, or a file in the folders. Links are resolved before the check."""
        if scene in shipped_names():
            return str(Path(models.__path__[0], f"{scene}.py"))
        for folder in self._folders:
            path = real_path(folder / scene)  # an absolute path replaces the folder
            if path.is_file() and any(map(path.is_relative_to, self._folders)):
                return str(path)
        raise DeclarationError(
            f"{scene} is neither a shipped scene nor a file in the folders of this server "
            f"({', '.join(map(str, self._folders)) or 'none'}).{did_you_mean(scene, shipped_names())}"
        )

    def _subject(self, scene: str, box: BoxText | None) -> tuple[mb.Scene, mb.Box | None]:
        found = load_scene(self._path(scene))
        if not box:
            return found, None
        nominal = found.system.parameters
        for name, interval in box.items():
            if not isinstance(interval, str) and any("%" in str(end) for end in interval):
                raise DeclarationError(
                    f"box: {name!r}: give one tolerance of the nominal value, such as '5%', or [lower, upper] in units."
                )
        texts: dict[str, Any] = {name: told for name, told in box.items() if isinstance(told, str)}
        ends: dict[str, Any] = {name: told for name, told in box.items() if not isinstance(told, str)}
        boxes = [mb.Box.plus_minus(nominal, **texts)] if texts else []
        boxes += [mb.Box(**ends).with_units(units_of_parameters(nominal))] if ends else []
        given = boxes[0] if len(boxes) == 1 else boxes[0] | boxes[1]
        if lacking := [name for name in found.box or () if name not in given]:
            values = values_text(lacking, [nominal[name] for name in lacking], units_of_parameters(nominal))
            self.remark = (
                f"remark: The given box has no interval for {', '.join(lacking)}, unlike the box of the scene. This "
                f"result is for {values}."
            )
        return found, given

    def _bounds(self, scene: str, box: BoxText | None, method: str = "pce") -> mb.Bounds:
        subject, intervals = self._subject(scene, box)
        return mb.propagate(subject, method, intervals, progress=self.progress)

    def _output(self, scene: str, kind: str) -> Path:
        """The path of a new page in the first folder."""
        if not self._folders:
            raise DeclarationError("This server has no folder for files. Start it by `symmb mcp FOLDER`.")
        folder = self._folders[0] / "symmb_output"
        folder.mkdir(exist_ok=True)
        stem = f"{re.sub(r'[^A-Za-z0-9]+', '_', Path(scene).stem)}_{kind}"
        names = (f"{stem}{number}.html" for number in chain([""], (f"_{k}" for k in count(2))))
        return next(folder / name for name in names if not (folder / name).exists())


def make_server(folders: Sequence[str]) -> Any:
    """The MCPServer of the package mcp, with one tool for each public method of `Tools`. Calls run one after the other.

    Raises
    ------
    DeclarationError    if the package mcp is not installed, or if a folder does not exist
    """
    try:
        mcp = optional_package("mcp.server.mcpserver", "this command", "mcp")
        tool_error = optional_package("mcp.server.mcpserver.exceptions", "this command", "mcp").ToolError
    except ImportError as error:
        raise DeclarationError(str(error)) from None
    from_thread = optional_package("anyio", "this command", "mcp").from_thread
    wrong_arguments = optional_package("pydantic", "this command", "mcp").ValidationError
    tools, lock = Tools(folders), Lock()  # symmb shows one progress, and files change sys.path while they run

    class Server(mcp.MCPServer):
        async def call_tool(self, name: str, arguments: dict[str, Any], context: Any = None) -> Any:
            try:
                return await super().call_tool(name, arguments, context)
            except tool_error as error:
                if not isinstance(error.__cause__, wrong_arguments):
                    raise
                wrong = dict.fromkeys(str(fault["loc"][0]) for fault in error.__cause__.errors())
                faults = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.__cause__.errors()]
                remedies = [_FORMATS[own] for own in wrong if own in _FORMATS] or ["; ".join(faults)]
                raise tool_error(f"{name}: {' '.join(wrong)} is not valid. {' '.join(remedies)}") from None

    server = Server("symmb", instructions=_INSTRUCTIONS, version=mb.__version__, log_level="WARNING")

    def add(tool: Callable[..., str]) -> None:
        @wraps(tool)
        def call(context: Any, **arguments: Any) -> str:
            count = 0

            def show(*told: Any) -> None:
                from_thread.check_cancelled()
                nonlocal count
                count += 1  # the protocol wants numbers that increase, but the runs start again with each method
                *label, done, total = told
                message = " ".join([*label, f"{done} of {total} runs" if total else f"{done} runs"])
                from_thread.run(context.report_progress, count, None, message)

            with lock:
                tools.progress, tools.remark = show, ""
                try:
                    answer = tool(tools, **arguments)
                    return "\n".join(filter(None, [answer, tools.remark]))
                except _FAULTS as error:
                    raise tool_error(str(error)) from None
                except KeyboardInterrupt:  # of code in the file, because signals interrupt the main thread only
                    raise tool_error(f"{arguments['scene']} raised KeyboardInterrupt.") from None

        own = [*inspect.signature(tool).parameters.values()][1:]
        asked = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=mcp.Context)
        call.__signature__ = inspect.Signature([*own, asked], return_annotation=str)  # type: ignore[attr-defined]
        call.__annotations__ = tool.__annotations__ | {"context": mcp.Context}
        more = [text for name, text in _FORMATS.items() if name in tool.__annotations__]
        server.tool(description="\n\n".join([str(inspect.getdoc(tool)), *more]), structured_output=False)(call)

    for name, tool in vars(Tools).items():
        if not name.startswith("_"):
            add(tool)
    return server


def add_mcp(commands: "argparse._SubParsersAction[Any]") -> None:
    """Add the command `symmb mcp`."""
    text = "start a server by which assistants study scenes (Model Context Protocol); needs symmb[mcp]"
    command = commands.add_parser("mcp", help=text, description=text + ". It speaks on stdin and stdout.")
    help_ = "folders with scene files that the server may load, and run as code; shipped scenes need no folder"
    command.add_argument("folders", metavar="DIR", nargs="*", help=help_)
    command.set_defaults(run=lambda options: make_server(options.folders).run("stdio"))


def _with_warnings(answer: object, bounds: mb.Bounds) -> str:
    """The text of an answer, followed by the warnings of the bounds."""
    return "\n".join([str(answer), *(f"warning: {doubt}" for doubt in bounds.doubts)])


def _pairs(limits: LimitText) -> dict[str, Any]:
    return {name: tuple(ends) for name, ends in limits.items()}
