"""C sources built into shared libraries, kept in the user's cache folder, and loaded."""

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

from symmb._errors import SymmbError

_FLAGS = (
    "-O2",
    "-march=native",
    "-shared",
    "-fPIC",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=fast",
    "-w",
)
_DEFINED = ("-Wl,-z,defs",) if sys.platform.startswith("linux") else ()
_LIBMVEC = ("-DLIBMVEC", "-Wl,--no-as-needed", "-lmvec")


class NoCompilerError(SymmbError):
    """There is no C compiler to be found."""


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
    """
    compiler, flags = _compiler()
    key = hashlib.sha256("\0".join([source, compiler, *flags, platform.machine(), _processor()]).encode()).hexdigest()
    library = cache_folder() / f"{key}.so"
    try:
        return ctypes.CDLL(str(library))
    except OSError:  # not there, or not whole
        _build(source, library, compiler, flags)
        return ctypes.CDLL(str(library))


def cache_folder() -> Path:
    """The folder of built libraries, readable and writable by its owner alone; a new temporary one if that fails."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = root / "symmb"
    try:
        folder.mkdir(parents=True, mode=0o700, exist_ok=True)
        status = folder.stat()
        if status.st_uid == os.getuid() and status.st_mode & 0o077 == 0 and os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return _private_folder()


@cache
def _private_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="symmb-"))


def _build(source: str, library: Path, compiler: str, flags: tuple[str, ...]) -> None:
    """Build aside and move into place, so that nobody ever loads half a library."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        text, made = Path(folder) / "model.c", Path(folder) / "model.so"
        text.write_text(source, encoding="utf-8")
        run = subprocess.run([compiler, str(text), "-o", str(made), *flags, "-lm"], capture_output=True, text=True)
        if run.returncode:
            raise SymmbError(f"{compiler} cannot build the model: {run.stderr.strip()[:2000]}")
        os.replace(made, library)


@cache
def _compiler() -> tuple[str, tuple[str, ...]]:
    """The compiler and its flags, with the vector functions of the C library where it has them.

    Raises
    ------
    NoCompilerError        if none is found that builds what the engine needs
    """
    for name in filter(None, (os.environ.get("CC"), "cc", "gcc", "clang")):
        found = shutil.which(name)
        if found and os.name == "posix":
            for extra in (_LIBMVEC, ()):
                if _builds(found, (*_FLAGS, *extra)):
                    return found, (*_FLAGS, *extra)
    raise NoCompilerError("No C compiler found. Install gcc or clang, or set CC.")


def _builds(compiler: str, flags: tuple[str, ...]) -> bool:
    """Whether a library that uses the lanes can be built, with nothing left undefined."""
    probe = '#include "lanes.h"\nV probe(V a) { return v_sin(a) + v_pow(a, a) + v_sqrt(a); }\n'
    with tempfile.TemporaryDirectory() as folder:
        text = Path(folder) / "probe.c"
        text.write_text(probe, encoding="utf-8")
        command = [compiler, str(text), "-o", str(Path(folder) / "probe.so"), f"-I{Path(__file__).parent}"]
        return subprocess.run([*command, *flags, "-lm", *_DEFINED], capture_output=True).returncode == 0


def _processor() -> str:
    """What -march=native looks at."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    return "".join(sorted({line for line in text.splitlines() if line.startswith(("model name", "flags", "Features"))}))
