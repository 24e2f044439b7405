"""Compilation of C sources into shared libraries, which are stored in the cache."""

import ctypes
import functools
import hashlib
import importlib.util
import itertools
import math
import os
import platform
import re
import shlex
import shutil
import struct
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from symmb._cleanup import run_program, temporary_folder
from symmb._errors import DeclarationError, SymmbError, SymmbWarning
from symmb.run.codegen import cache
from symmb.run.codegen.c_source import C_FOLDER, c_source
from symmb.run.codegen.threads import cores

R = TypeVar("R")

# -ffast-math is not used: it lets compilers assume that nothing is NaN, but tests for NaN find lanes that fail.
_FLAGS = ("-O2", "-shared", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-w")
_WEB_FLAGS = (
    *("-target", "wasm32-wasi", "-mexec-model=reactor", "-O2", "-msimd128", "-fno-math-errno", "-fno-trapping-math"),
    *("-ffp-contract=off", "-w", "-Wl,--strip-all", "-Wl,-z,stack-size=1048576"),
)
_MORE_FLAGS = "SYMMB_CFLAGS"
"""The environment variable for further flags, such as "-O1". With this flag tests compile faster and run slower."""
_NATIVE = "-march=native", "-mcpu=native"  # some compilers for ARM know the second only
_DEFINED = ("-Wl,-z,defs",) if sys.platform.startswith("linux") else ()
_LIBMVEC = ("-DLIBMVEC", "-Wl,--no-as-needed", "-lmvec")

_PROBE = """
#include <stdlib.h>
#include "lanes.h"
#if WIDTH != 8
#error flags change the number of lanes
#endif
#ifdef __cplusplus
#error the sources are C
#endif
#if defined(LIBMVEC) && !defined(__AVX2__)
#error the vector functions are compiled for processors with AVX2
#endif
V probe(V a) { return v_sin(a) + v_pow(a, a) + v_sqrt(a); }
void *(*room)(size_t, size_t) = aligned_alloc; /* a flag such as -std=c99 hides its declaration */
int is_number(double a) { return a == a; }     /* always 1 with -ffast-math */
int answer(void) { return 42; }
"""

INSTALL = "Install gcc or clang, or run `pip install 'symmb[compiler]'`, or set CC."
SLOW = "Without a C compiler runs take about 100 times as long."
"""Advice for messages. CVODES takes 6 ms for a run of the double pendulum, and compiled lanes take 0.04 ms."""

_VERSION_SECONDS = 20.0
"""Time limit for the version of a compiler [s]."""
_BUILD_SECONDS = 120.0
"""Time limit to test a compiler, to build a model, and for each further megabyte of its source [s]. It is fifty times
the time of gcc, because other programs may use most of the processor. tests/benchmarks/scaling.py"""


class NoCompilerError(SymmbError):
    """No C compiler works."""


class _BuildError(SymmbError):
    """A compiler fails to build a source."""


class _TimeoutError(_BuildError):
    """A compiler takes too long."""


def has_compiler() -> bool:
    """Whether a C compiler works."""
    try:
        _compiler()
    except NoCompilerError:
        return False
    return True


def require_compiler(user: str) -> None:
    """Raise NoCompilerError if no C compiler works. `user` is the part that needs the compiler."""
    if not has_compiler():
        raise NoCompilerError(f"{user} needs a C compiler, and none was found. {compiler_advice()}")


def compiler_advice() -> str:
    """A text with the compilers that do not work, the reasons, and the way to install a compiler."""
    unusable = (f"{shlex.join(command)} is not used: {reason}" for command, reason in _UNUSABLE.items())
    return " ".join([*unusable, INSTALL])


def with_compiler(work: Callable[[], R], otherwise: Callable[[], R]) -> R:
    """The result of `work`, which needs a compiler, or the result of `otherwise` if no compiler works."""
    if has_compiler():
        with suppress(NoCompilerError):  # a compiler may pass its test and still fail to build this source
            return work()
    return otherwise()


def load(source: str, *names: str, shared: tuple[str, ...] = ()) -> ctypes.CDLL:
    """The library of a C source, from the cache or built now.

    Parameters
    ----------
    source : str
    *names                 functions and variables that the library must contain: a compiler may leave them out
    shared : tuple of str  further sources, which other libraries contain too. The cache stores their object files

    Raises
    ------
    NoCompilerError        if there is no C compiler that can build the source
    UnsafeFolderError      if others can write to the folder for temporary files
    """
    return _with_next_compiler(lambda compiler: _loaded(source, compiler, *names, shared=shared))


def portable_library(files: Mapping[str, str], sources: Sequence[str]) -> bytes:
    """A library of C files for every processor of this family. Symbols are hidden unless they are exported.

    Parameters
    ----------
    files                  name -> text
    sources                names of the files that are compiled

    Raises
    ------
    NoCompilerError        if there is no C compiler that can build the sources
    """

    def built(compiler: _Compiler) -> bytes:
        with temporary_folder() as folder:
            for name, text in files.items():
                (folder / name).write_text(text, encoding="utf-8")
            library_path = folder / "library.so"
            command = [*compiler.command, *(str(folder / name) for name in sources), "-o", str(library_path)]
            size = sum(map(len, files.values()))
            _compile([*command, *_flags(), "-fvisibility=hidden", "-lm"], library_path, folder, _build_seconds(size))
            return library_path.read_bytes()

    return _with_next_compiler(built)


def web_module(files: Mapping[str, str], sources: Sequence[str], user: str) -> bytes:
    """A WebAssembly module of C files, from the cache or built now by ziglang. It exports what its C files export.

    Parameters
    ----------
    files                  name -> text
    sources                names of the files that are compiled
    user                   the part that needs the module, for messages

    Raises
    ------
    NoCompilerError        if the package ziglang is not installed, or cannot build the module
    """
    command = next(_ziglang(), None)
    if command is None:
        raise NoCompilerError(f"{user} needs the package ziglang. Run `pip install 'symmb[compiler]'`.")
    try:
        key = _key(*itertools.chain(*files.items()), *_WEB_FLAGS, _version(command))
        if (path := cache.find(key, ".wasm")) is not None:
            return path.read_bytes()
        with temporary_folder() as folder:
            for name, text in files.items():
                (folder / name).write_text(text, encoding="utf-8")
            built = folder / "module.wasm"
            status, said = _ran(
                [*command, *(str(folder / name) for name in sources), "-o", str(built), *_WEB_FLAGS],
                _build_seconds(sum(map(len, files.values()))),
                folder,
            )
            if status:
                raise _BuildError(f"the compiler cannot build the module: {_first_error(said)}.")
            content = built.read_bytes()
    except (OSError, _BuildError) as error:
        raise NoCompilerError(f"{user}: {shlex.join(command)}: {error}") from error
    cache.keep(key, content, ".wasm")
    return content


def _with_next_compiler(build: Callable[["_Compiler"], R]) -> R:
    """The result of `build` with the first compiler that succeeds. A compiler that fails is not used again."""
    while True:
        compiler = _compiler()
        try:
            return build(compiler)
        except _BuildError as error:
            _give_up(compiler.command, str(error))
            _compiler.cache_clear()


def _give_up(compiler: tuple[str, ...], reason: str) -> None:
    """Do not use a compiler from now on, and issue a warning."""
    _UNUSABLE[_real(compiler)] = reason
    warnings.warn(f"{' '.join(compiler)} is not used: {reason}", SymmbWarning, stacklevel=2)


@functools.cache
def _loaded(source: str, compiler: "_Compiler", *names: str, shared: tuple[str, ...] = ()) -> ctypes.CDLL:
    key = _key(source, *shared, *compiler.command, compiler.version, *compiler.flags)
    library_in_cache = _opened(cache.find(key), *names)
    if library_in_cache is not None:
        return library_in_cache
    try:
        with temporary_folder() as folder:
            cache.check_folder(folder, "TMPDIR")
            library_path = _built(source, folder, compiler, shared)
            cache.keep(key, library_path.read_bytes())
            # Either folder may forbid the execution of programs. A library in the cache serves other processes too.
            library = _opened(cache.find(key), *names) or _opened(library_path, *names)
    except TimeoutError:
        raise
    except OSError as error:
        raise _BuildError(f"temporary files cannot be written ({error}). Set TMPDIR to another folder.") from error
    if library is None:
        raise _BuildError(
            "its libraries lack functions or cannot be loaded. Set TMPDIR to a folder that is not mounted noexec."
        )
    return library


def _opened(library: Path | None, *names: str) -> ctypes.CDLL | None:
    """A library, or None if it cannot be loaded or does not contain all names."""
    try:
        if library is None or not _has_its_segments(library.read_bytes()):
            return None
        opened = ctypes.CDLL(str(library))
    except OSError:
        return None
    return opened if all(hasattr(opened, name) for name in names) else None


def _has_its_segments(content: bytes) -> bool:
    """Whether an ELF library of 64 bits is complete. Loading an incomplete file would end the process."""
    if content[:5] != b"\x7fELF\x02":
        return True
    order = "<" if content[5:6] == b"\x01" else ">"
    try:
        (first,), (size, n) = (
            struct.unpack_from(f"{order}Q", content, 32),
            struct.unpack_from(f"{order}HH", content, 54),
        )
        segments = [struct.unpack_from(f"{order}IIQQQQ", content, first + k * size) for k in range(n)]
    except struct.error:
        return False
    return all(offset + in_file <= len(content) for _, _, offset, _, _, in_file in segments)


def _built(source: str, folder: Path, compiler: "_Compiler", shared: tuple[str, ...]) -> Path:
    library_path = folder / "model.so"
    to_library = ["-o", str(library_path), *compiler.flags, "-lm"]
    seconds = _build_seconds(sum(map(len, (source, *shared))))
    commands, objects, new = list[list[str]](), list[Path](), dict[str, Path]()
    for number, text in enumerate((source, *shared)):
        path = folder / (f"shared{number}.c" if number else "model.c")
        path.write_text(text, encoding="utf-8")
        if not shared:
            _compile([*compiler.command, str(path), *to_library], library_path, folder, seconds)
            return library_path
        parts = int(found[1]) if (found := re.search(r"^#define N_PARTS (\d+)$", text, re.MULTILINE)) else 1
        for part in range(parts):
            objects.append(path.with_suffix(f".{part}.o"))
            key = _key(text, str(part), *compiler.command, compiler.version, *compiler.flags)
            if number and (kept := cache.find(key, ".o")):
                with suppress(FileNotFoundError):  # another process may have removed it
                    objects[-1].write_bytes(kept.read_bytes())
                    continue
            commands.append(
                [*compiler.command, "-c", f"-DPART={part}", str(path), "-o", str(objects[-1]), *compiler.flags]
            )
            if number:
                new[key] = objects[-1]
    last = [*compiler.command, *map(str, objects), *to_library]
    _compile(["/bin/sh", "-c", _side_by_side(commands, last)], library_path, folder, seconds)
    for key, path in new.items():
        cache.keep(key, path.read_bytes(), ".o")
    return library_path


def _build_seconds(size: int) -> float:
    return _BUILD_SECONDS * (1.0 + size / 1e6)


def _side_by_side(commands: Sequence[Sequence[str]], last: Sequence[str]) -> str:
    """A shell script that runs commands in parallel, one on each core, and then the last command."""
    # A shell is used, because its processes end with the process group of run_program at an interrupt or a time limit.
    count = min(cores(), len(commands))
    lines = [f"({' && '.join(map(shlex.join, commands[k::count]))}) & p{k}=$!" for k in range(count)]
    waits = [f"wait $p{k} || exit 1" for k in range(count)]
    return "\n".join([*lines, *waits, shlex.join(last)])


def _compile(command: list[str], library_path: Path, folder: Path, seconds: float) -> None:
    """Run a compiler. _BuildError is raised if it writes no library or takes longer than `seconds`."""
    status, text = _ran(command, seconds, folder)
    if status:
        raise _BuildError(f"the compiler cannot build a model: {_first_error(text)}.")
    head = library_path.read_bytes()[:18] if library_path.is_file() else b""
    is_shared = head[:4] == b"\x7fELF" and head[16:].strip(b"\0") == b"\3"  # a flag such as -c gives an object file
    if not head or (sys.platform.startswith("linux") and not is_shared):
        raise _BuildError("the compiler reports success, but writes no library.")


def _ran(command: Sequence[str], seconds: float, folder: Path | None = None, purpose: str = "") -> tuple[int, str]:
    """Exit status and output of a compiler. _BuildError is raised if it cannot start, or does not end in time."""
    try:
        return run_program(command, seconds, folder)
    except subprocess.TimeoutExpired:
        raise _TimeoutError(f"the compiler takes longer than {seconds:.0f} s{purpose}.") from None
    except TimeoutError:  # of the user's signal handler
        raise
    except OSError as error:
        raise _BuildError(f"the compiler cannot be started ({error.strerror}).") from None


def _first_error(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line.lower()), lines[0] if lines else "no message")[:300]


@dataclass(frozen=True)
class _Compiler:
    path: str
    version: str
    flags: tuple[str, ...]
    arguments: tuple[str, ...] = ()

    @property
    def command(self) -> tuple[str, ...]:
        """The first words of a command that runs the compiler: its path, and the arguments that come first."""
        return self.path, *self.arguments


_UNUSABLE: dict[tuple[str, ...], str] = {}
"""Command of a compiler that does not work, with its real path -> the reason."""


@functools.cache
def _compiler() -> _Compiler:
    """The first compiler that works, and its flags. NoCompilerError is raised if no compiler builds the engine."""
    for command in _candidates():
        if os.name == "posix" and _real(command) not in _UNUSABLE:
            try:
                return _probed(command)
            except _BuildError as error:
                _give_up(command, str(error))
    raise NoCompilerError(f"No C compiler found. {compiler_advice()}")


def _flags() -> tuple[str, ...]:
    try:
        return *_FLAGS, *shlex.split(os.environ.get(_MORE_FLAGS, ""))
    except ValueError as error:
        raise DeclarationError(f"{_MORE_FLAGS} is {os.environ[_MORE_FLAGS]!r}: {error}.") from None


def _candidates() -> Iterator[tuple[str, ...]]:
    """Commands of installed compilers. The first is the value of CC, which may have arguments; the last is ziglang."""
    given = os.environ.get("CC") or ""
    if given.strip() and not (shutil.which(given) or shutil.which(given.split()[0])):
        warnings.warn(f"CC is {given!r}, but there is no such program. CC is ignored.", SymmbWarning, stacklevel=2)
    for command in ([given], given.split(), ["cc"], ["gcc"], ["clang"]):
        if command and (path := shutil.which(command[0])):
            yield path, *command[1:]
    yield from _ziglang()


def _ziglang() -> Iterator[tuple[str, ...]]:
    """The command of the compiler in the package ziglang, if it is installed."""
    ziglang = importlib.util.find_spec("ziglang")
    for folder in ziglang.submodule_search_locations or () if ziglang else ():
        if path := shutil.which(os.path.join(folder, "zig")):
            yield path, "cc"


def _real(command: tuple[str, ...]) -> tuple[str, ...]:
    return os.path.realpath(command[0]), *command[1:]


def _probed(command: tuple[str, ...], own: tuple[str, ...] | None = None) -> _Compiler:
    """A compiler with all flags that it accepts. By default, `own` flags are `_flags()`, with those of the user.

    Raises
    ------
    _BuildError            if the compiler builds nothing that works
    DeclarationError       if the compiler works only without the user's flags
    """
    version, refused = _version(command), ""
    own = _flags() if own is None else own
    # The vector functions of the C library are tried first. Without them, exp, log and pow are computed lane by lane.
    for native, extra in itertools.product(_NATIVE, (_LIBMVEC, ())):
        flags = (*own, native, *extra)
        try:
            _probe(command, version, flags)
        except _TimeoutError:
            raise
        except _BuildError as error:
            refused = str(error)
        else:
            return _Compiler(command[0], version, flags, command[1:])
    if own != _FLAGS and _probed(command, _FLAGS):
        raise DeclarationError(f"{_MORE_FLAGS} is {os.environ[_MORE_FLAGS]!r}: {command[0]} then fails: {refused}")
    raise _BuildError(refused)


def _probe(compiler: tuple[str, ...], version: str, flags: tuple[str, ...]) -> None:
    """Test a compiler: build a library with lanes, and call it. The cache stores a success. Otherwise: _BuildError."""
    key = _key(_PROBE, c_source("lanes"), *compiler, version, *flags)
    if cache.is_noted(key):
        return
    try:
        with temporary_folder() as folder:
            text, library_path = folder / "probe.c", folder / "probe.so"
            text.write_text(_PROBE, encoding="utf-8")
            command = [*compiler, str(text), "-o", str(library_path), f"-I{C_FOLDER}", *flags, "-lm", *_DEFINED]
            _compile(command, library_path, folder, _BUILD_SECONDS)  # ziglang first builds a part of the C library
            # Undefined symbols are errors of the linker (_DEFINED). A library that cannot be loaded from a folder
            # mounted noexec may therefore still be good, and can be loaded from the cache.
            library = _opened(library_path)
            if library is not None and (library.answer() != 42 or library.is_number(ctypes.c_double(math.nan))):
                raise _BuildError("the functions that the compiler has built return wrong values.")
    except TimeoutError:
        raise
    except (OSError, AttributeError) as error:
        raise _BuildError(f"its test fails ({error}).") from error
    cache.note(key)


def _key(*described: str) -> str:
    """The key of a library in the cache: a digest of its description and of the processor."""
    text = "\0".join([*described, platform.machine(), _processor()])
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _version(compiler: tuple[str, ...]) -> str:
    """The version and the real path of a compiler. _BuildError is raised if the compiler does not answer."""
    _, said = _ran([*compiler, "--version"], _VERSION_SECONDS, purpose=" to print its version")
    return f"{said}{os.path.realpath(compiler[0])}"


def _processor() -> str:
    """Properties of the processor that the compiler uses."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    relevant = ("model", "cpu family", "flags", "Features", "CPU implementer", "CPU part", "CPU variant")
    return "".join(sorted({line for line in text.splitlines() if line.startswith(relevant)}))
