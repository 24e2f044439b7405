"""A program as a simulator. Each run has a folder, input files from templates, and a file with the results."""

import os
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from symmb._cleanup import process_group, real_path, temporary_folder
from symmb._errors import DeclarationError, SimulationError
from symmb._options import require_timeout, shown, whole
from symmb._types import Array
from symmb.connect.black_box import BlackBox
from symmb.connect.identity import DeclaredFiles, digest
from symmb.connect.limited_calls import LimitedCalls, fault_text, signal_name
from symmb.connect.program_files import (
    READERS,
    filled,
    is_filled,
    is_inside,
    is_text,
    read_table,
    template_faults,
    template_texts,
)

_OWNER = "CommandSimulator"
_KEEP = ("none", "failed", "all")
_OUTPUT, _ERRORS = "stdout.txt", "stderr.txt"


@dataclass(frozen=True, eq=False, repr=False)
class CommandSimulator(BlackBox):
    """Trajectories from a program. For each run, the program is started in a separate folder, without a shell.

    Parameters
    ----------
    command : list of str
        the program and its arguments; `{name}` is replaced by the value of a parameter, as in templates
    parameters : mapping
        nominal values by name
    times : (n_t,)
        increasing times of the rows [s]
    outputs : list of str
        n_y names of the columns
    templates : mapping
        file name -> a str with the text of the file, or a Path of a file with the text. The files are written into the
        folder of a run. `{name}` and `{name:format}` are replaced by the values of parameters. Without a format all
        digits are written. Other braces are kept
    read : str or callable
        the file with the results: a .csv, .json or .npz file with a column `time` and a column for each output. A
        function is also possible. It receives the folder and returns an array (n_t, n_y)
    timeout : float
        longest time of a run [s]. After this time the program, and the programs that it started, are ended
    files : list of paths
        files and folders that are copied into the folder of a run
    environment : mapping
        environment variables that are added to those of this process
    retries : int
        number of further attempts after a failed run
    interpolate : bool
        accept files with other times than the declared times, and interpolate linearly
    keep : str
        which folders are kept: "failed" (default), "all" or "none". The message of a failed run names its folder.
        The files stdout.txt and stderr.txt in this folder contain the output of the program
    folder : path
        the folder that contains the folders of the runs; default: the folder for temporary files
    noise : mapping
        errors of the output values, by name of the output

    Raises
    ------
    DeclarationError
        If the program is not found, a template cannot be filled, a parameter is neither in a template nor in an
        argument, or an option is out of its range

    Examples
    --------
    >>> import symmb as mb, sys
    >>> code = "k = {k}; print('time,x', *[f'{t},{k * t}' for t in (0, 1)], sep='\\\\n', file=open('out.csv', 'w'))"
    >>> line = mb.CommandSimulator([sys.executable, "in.py"], {"k": 2.0}, [0, 1], ["x"], {"in.py": code}, "out.csv")
    >>> line.run([[3.0]]).Y.tolist()
    [[[0.0], [3.0]]]
    """

    command: tuple[str, ...]
    templates: Mapping[str, str]
    read: str | Callable[[Path], Any]
    timeout: float | None
    files: tuple[Path, ...]
    environment: Mapping[str, str]
    retries: int
    interpolate: bool
    keep: str
    folder: Path | None
    _inputs: DeclaredFiles
    _calls: LimitedCalls | None

    def __init__(
        self,
        command: Sequence[str],
        parameters: Mapping[str, float],
        times: Array | Sequence[float],
        outputs: Sequence[str],
        templates: Mapping[str, str | Path] | None = None,
        read: str | Callable[[Path], Any] = "out.csv",
        timeout: float | None = None,
        files: Sequence[str | Path] = (),
        environment: Mapping[str, str] | None = None,
        retries: int = 0,
        interpolate: bool = False,
        keep: str = "failed",
        folder: str | Path | None = None,
        noise: Mapping[str, float] | None = None,
    ):
        self._declare(parameters, times, outputs, noise)
        environment = {} if environment is None else environment
        _require_types(command, files, folder, environment)
        texts = template_texts(_OWNER, {} if templates is None else templates)
        sources = tuple(real_path(file) for file in files)
        program = _program(str(command[0]), {*texts, *(file.name for file in sources)})
        vars(self).update(
            command=(program, *map(str, command[1:])),
            templates=texts,
            read=read,
            timeout=timeout,
            files=sources,
            environment=dict(environment),
            retries=whole(_OWNER, "retries", retries, 0),
            interpolate=interpolate,
            keep=keep,
            folder=None if folder is None else real_path(folder),
        )
        faults = [f"{_OWNER}: {fault}" for fault in (*self._input_faults(), *self._option_faults())]
        if faults:
            raise DeclarationError("\n".join(faults))
        require_timeout(_OWNER, timeout)
        inputs = [Path(program), *sources]
        for word in self.command[1:]:  # words such as /home/model.sh or --input=/home/mesh.inp
            names = {word, word.partition("=")[2]}
            inputs += [Path(name) for name in names if os.path.isabs(name) and os.path.isfile(name)]
        # A separate process starts the programs. At the end of a study, it ends them and removes folders.
        calls = LimitedCalls(self._made, None, "the program", self.folder) if hasattr(os, "fork") else None
        vars(self).update(_inputs=DeclaredFiles(path for path in inputs if path.exists()), _calls=calls)

    def _input_faults(self) -> Iterator[str]:
        """Faults of templates, of arguments and of the names of files."""
        places = {f"template {name!r}": text for name, text in self.templates.items()}
        places |= {f"argument {word!r}": word for word in self.command[1:]}
        for place, text in places.items():
            yield from (f"{place}: {fault}." for fault in template_faults(text, self.parameters))
        for name in self.parameters:
            if not any(is_filled(text, name) for text in places.values()):
                yield f"no template and no argument contains parameter {name!r}. Write {{{name}}} into one of them."
        yield from (f"files: {file} does not exist." for file in self.files if not file.exists())
        own = [str(PurePosixPath(name)) for name in self.templates]
        names = [_OUTPUT, _ERRORS, *own, *(file.name for file in self.files)]
        for name, count in Counter(names).items():
            if count > 1:
                yield f"{name!r} is the name of two files in the folder of a run. Rename one of them."
            if any(str(parent) in names for parent in PurePosixPath(name).parents):
                yield f"{name!r} needs a folder, but a file of the run has the name of this folder. Rename one of them."

    def _option_faults(self) -> Iterator[str]:
        if not isinstance(self.read, str):
            if not callable(self.read):
                yield f"read must be the name of a file, or a function that reads a folder, got {shown(self.read)}."
        elif not is_inside(self.read):
            yield f"read: {self.read!r} must be the name of a file in the folder of a run."
        elif Path(self.read).suffix not in READERS:
            yield f"read: {self.read!r} must end in one of {', '.join(READERS)}. Or give a function that reads results."
        if not isinstance(self.interpolate, bool):
            yield f"interpolate must be True or False, got {shown(self.interpolate)}."
        if not isinstance(self.keep, str) or self.keep not in _KEEP:
            yield f"keep must be one of {', '.join(map(repr, _KEEP))}, got {shown(self.keep)}."
        if self.folder is not None and not self.folder.is_dir():
            yield f"folder: {self.folder} does not exist, or is not a folder."

    def response(self, values: dict[str, float]) -> Any:
        """Outputs (n_t, n_y) of one run, or of the first successful repetition."""
        try:
            return self._made(**values) if self._calls is None else self._calls(values)
        finally:
            self._inputs.require_same()

    def _made(self, **values: float) -> Any:
        for left in range(self.retries, -1, -1):
            with temporary_folder(self.folder) as folder:
                try:
                    result = self._shaped(self._run(folder, values))
                    if not np.isfinite(result).all():
                        raise SimulationError(self._irregular(result))
                except (Exception, SystemExit) as error:
                    if left:
                        continue
                    kept = "" if self.keep == "none" else f"; see {_kept(folder, self.folder)}"
                    raise SimulationError(f"{fault_text(error)}{kept}") from None
                if self.keep == "all":
                    _kept(folder, self.folder)
                return result
        raise AssertionError("unreachable")

    def _run(self, folder: Path, values: dict[str, float]) -> Any:
        for file in self.files:
            copy = shutil.copytree if file.is_dir() else shutil.copy2
            copy(file, folder / file.name)
        for name, template in self.templates.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(filled(template, values), encoding="utf-8", newline="")
        program, *arguments = self.command
        command = [program, *(filled(argument, values) for argument in arguments)]
        environment = {**os.environ, **self.environment}
        with (folder / _OUTPUT).open("wb") as output, (folder / _ERRORS).open("wb") as errors:
            try:
                with process_group(command, cwd=folder, env=environment, stdout=output, stderr=errors) as process:
                    status = process.wait(self.timeout)
            except subprocess.TimeoutExpired:
                raise SimulationError(f"timed out: the program had not ended after {self.timeout:g} s") from None
            except OSError as error:
                raise SimulationError(f"the program cannot be started: {error}") from None
        if status:
            how = f"ended with exit status {status}" if status > 0 else f"was killed by {signal_name(-status)}"
            raise SimulationError(f"the program {how}{_last_line(folder)}")
        if not isinstance(self.read, str):
            return self.read(folder)
        return read_table(folder / self.read, self.times, self.outputs, self.interpolate)

    def identity(self) -> str:
        """A digest of the program, its input and the way to read its results, for `StoredSimulator`."""
        files = self._inputs.digests()
        return digest("command", self.command, files, self.templates, self.environment, self.read, self.interpolate)

    def __repr__(self) -> str:
        return f"CommandSimulator({Path(self.command[0]).name})"


def _require_types(command: Any, files: Any, folder: Any, environment: Any) -> None:
    if not _are_paths(command) or not command:
        raise DeclarationError(
            f"{_OWNER}: command must be a list of a program and its arguments, got {shown(command)}."
        )
    if not _are_paths(files):
        raise DeclarationError(f"{_OWNER}: files must be a list of paths, got {shown(files)}.")
    if folder is not None and not _are_paths([folder]):
        raise DeclarationError(f"{_OWNER}: folder must be a path, got {shown(folder)}.")
    are_texts = isinstance(environment, Mapping) and _are_paths([*environment, *environment.values()])
    if not are_texts or any(not name or "=" in name for name in environment):
        raise DeclarationError(f"{_OWNER}: environment must map names of variables to texts.")


def _are_paths(things: Any) -> bool:
    """Whether a value is a list of texts and paths that can be passed to the system."""
    return isinstance(things, list | tuple) and all(
        isinstance(thing, str | Path) and is_text(str(thing)) for thing in things
    )


def _program(program: str, made: set[str]) -> str:
    """The program with its path: in the folder of the run, in the current folder, or in the search path."""
    if program.removeprefix("./") in made:
        return f"./{program.removeprefix('./')}"
    found = shutil.which(program)
    if found is None:
        raise DeclarationError(
            f"{_OWNER}: the program {program!r} is not found. Give its path, or put it into `files` or `templates`."
        )
    return str(Path(found).absolute())


def _kept(folder: Path, base: Path | None) -> Path:
    """Rename the folder of a run, so that it is not removed, and return the new path."""
    kept = tempfile.mkdtemp(prefix="symmb_run-", dir=base)
    return folder.rename(kept)  # replaces an empty folder


def _last_line(folder: Path, most: int = 200) -> str:
    """The last line that the program wrote to stderr, or to stdout if stderr is empty; at most `most` characters."""
    for name in (_ERRORS, _OUTPUT):
        lines = (folder / name).read_text(encoding="utf-8", errors="replace").split("\n")
        for line in reversed(lines):
            text = "".join(c if c.isprintable() else " " for c in line.strip()[:most]).strip()
            if text:
                return f": {text}"
    return ""
