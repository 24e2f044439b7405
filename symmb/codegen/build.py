"""Compilation of C sources into shared libraries, which are kept in the cache."""

import ctypes
import functools
import hashlib
import itertools
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from symmb._errors import SymmbError
from symmb.codegen import cache
from symmb.codegen.c_source import C_FOLDER, c_source

_FLAGS = ("-O2", "-shared", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-w")
_NATIVE = "-march=native", "-mcpu=native"  # the second for ARM compilers that do not know the first
_DEFINED = ("-Wl,-z,defs",) if sys.platform.startswith("linux") else ()
_LIBMVEC = ("-DLIBMVEC", "-Wl,--no-as-needed", "-lmvec")

_PROBE = """
#include "lanes.h"
#if defined(LIBMVEC) && !defined(__AVX2__)
#error the vector functions are compiled for processors with AVX2
#endif
V probe(V a) { return v_sin(a) + v_pow(a, a) + v_sqrt(a); }
"""


class NoCompilerError(SymmbError):
    """No C compiler was found."""


def has_compiler() -> bool:
    """Whether there is a C compiler."""
    try:
        _compiler()
    except NoCompilerError:
        return False
    return True


def load(source: str) -> ctypes.CDLL:
    """The library of a C source, from the cache or built now.

    Raises
    ------
    NoCompilerError        if there is no C compiler
    UnsafeFolderError      if others can write to the folder for temporary files
    SymmbError             if the source does not build
    """
    return _loaded(source, _compiler())


@functools.cache
def _loaded(source: str, compiler: "_Compiler") -> ctypes.CDLL:
    key = _key(source, compiler.path, compiler.version, *compiler.flags)
    library_in_cache = _opened(cache.find(key))
    if library_in_cache is not None:
        return library_in_cache
    with tempfile.TemporaryDirectory(prefix="symmb-") as name:
        folder = Path(name).resolve()
        cache.check_folder(folder, "TMPDIR")
        library_path = _built(source, folder, compiler)
        cache.keep(key, library_path.read_bytes())
        # The cache first, then the temporary folder: either may forbid the execution of programs.
        library = _opened(cache.find(key)) or _opened(library_path)
    if library is None:
        raise SymmbError(f"What {compiler.path} built cannot be loaded. Set TMPDIR to a folder that may hold programs.")
    return library


def _opened(library: Path | None) -> ctypes.CDLL | None:
    if library is None:
        return None
    try:
        return ctypes.CDLL(str(library))
    except OSError:
        return None


def _built(source: str, folder: Path, compiler: "_Compiler") -> Path:
    text, library_path = folder / "model.c", folder / "model.so"
    text.write_text(source, encoding="utf-8")
    command = [compiler.path, str(text), "-o", str(library_path), *compiler.flags, "-lm"]
    run = subprocess.run(command, capture_output=True, text=True, errors="replace")
    if run.returncode:
        raise SymmbError(f"{compiler.path} cannot build the model: {run.stderr.strip()[:2000]}")
    return library_path


@dataclass(frozen=True)
class _Compiler:
    path: str
    version: str
    flags: tuple[str, ...]


@functools.cache
def _compiler() -> _Compiler:
    """The compiler and its flags, with the vector functions of the C library where it has them.

    Raises
    ------
    NoCompilerError        if none is found that builds the engine
    """
    for name in filter(None, (os.environ.get("CC"), "cc", "gcc", "clang")):
        path = shutil.which(name)
        if path and os.name == "posix":
            version = _version(path)
            for native, extra in itertools.product(_NATIVE, (_LIBMVEC, ())):
                flags = (*_FLAGS, native, *extra)
                if _builds(path, version, flags):
                    return _Compiler(path, version, flags)
    raise NoCompilerError("No C compiler found. Install gcc or clang, or set CC.")


def _builds(compiler: str, version: str, flags: tuple[str, ...]) -> bool:
    """Whether a library that uses the lanes can be built without undefined symbols. A positive answer is cached."""
    lanes = c_source("lanes")
    key = _key(_PROBE, lanes, compiler, version, *flags)
    if cache.is_noted(key):
        return True
    try:
        with tempfile.TemporaryDirectory(prefix="symmb-") as folder:
            text = Path(folder) / "probe.c"
            text.write_text(_PROBE, encoding="utf-8")
            command = [compiler, str(text), "-o", str(Path(folder) / "probe.so"), f"-I{C_FOLDER}"]
            if subprocess.run([*command, *flags, "-lm", *_DEFINED], capture_output=True).returncode:
                return False
    except OSError:  # no space for files, or not a program
        return False
    cache.note(key)
    return True


def _key(*described: str) -> str:
    """The key of a library built from this source, for this processor."""
    text = "\0".join([*described, platform.machine(), _processor()])
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _version(compiler: str) -> str:
    """The version of the compiler, and its real path."""
    try:
        said = subprocess.run([compiler, "--version"], capture_output=True, text=True, errors="replace").stdout
    except OSError:  # not a program
        said = ""
    return f"{said}{os.path.realpath(compiler)}"


def _processor() -> str:
    """Properties of the processor that the compiler uses."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    relevant = ("model", "cpu family", "flags", "Features", "CPU implementer", "CPU part", "CPU variant")
    return "".join(sorted({line for line in text.splitlines() if line.startswith(relevant)}))
