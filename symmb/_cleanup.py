"""What must not outlive this process: temporary folders, incomplete files, and programs that it has started."""

import os
import shutil
import signal
import stat
import subprocess
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import parent_process
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any

from symmb._interrupts import SIGNALS, deferred_interrupts

PREFIX = "symmb-"
"""Beginning of the names of temporary folders. The number of their process follows."""

_MARK, _FOLDER = ".symmb", "run"
"""The file in a temporary folder that tells who has made it, since other folders may have such names too, and the
folder beside it that is used."""
_TITLE = "temporary folder of symmb"
_FOLDERS: set[str] = set()
_FILES: set[str] = set()
_GROUPS: dict[int, Path | None] = {}
"""Leaders of groups, with the folder in which they make theirs."""
_PROGRAMS: set[int] = set()
"""Leaders of groups that need not end anything themselves."""
_STARTS = threading.Lock()
"""Held while a program is started, and for good by a process that is about to end."""
_SEARCHED: set[Path] = set()
_LEADS = False
_WATCHES = 0
"""The process that looks whether its parent is still there."""
_TICK = 0.2
"""Time between looks whether the parent is still there [s]."""
_GRACE = 0.5
"""Time for a process to end its programs and to remove its folders [s]."""
_SOON = 0.005
"""Time between looks whether a process has ended [s]."""


@contextmanager
def temporary_folder(base: Path | None = None) -> Iterator[Path]:
    """A new folder that is removed at the end of the block, in `base` or where temporary files are.

    It raises OSError if it cannot be created.
    """
    folder = _new_folder(base)
    try:
        yield folder
    finally:
        _remove(folder.parent)
        _FOLDERS.discard(str(folder.parent))


def lasting_folder() -> Path:
    """A new folder that is removed at the end of this process, also in workers of a pool, which skip `atexit`.

    It raises OSError if it cannot be created.
    """
    folder = _new_folder(None)
    Finalize(None, _remove, (folder.parent,), exitpriority=0)
    return folder


def _new_folder(base: Path | None) -> Path:
    """A folder in one with the mark of this process. Those of processes that were killed are removed before."""
    place = Path(base or tempfile.gettempdir()).resolve()
    if place not in _SEARCHED:
        _SEARCHED.add(place)
        remove_left_folders(place)
    outer = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{os.getpid()}-", dir=place))
    _FOLDERS.add(str(outer))
    outer.chmod(stat.S_IRWXU)  # whatever the umask is
    mark, inner = outer / _MARK, outer / _FOLDER
    mark.write_text("\n".join((_TITLE, outer.name, _machine(), str(os.getpid()), _begin_of(os.getpid()))))
    mark.chmod(stat.S_IRUSR | stat.S_IWUSR)
    inner.mkdir()
    inner.chmod(stat.S_IRWXU)
    return inner


def _remove(outer: str | Path) -> None:
    """Remove a folder, its mark last: where another process still writes into it, somebody else has to remove it."""
    inner = os.path.join(outer, _FOLDER)
    _remove_tree(inner)
    if not os.path.lexists(inner):
        _remove_tree(outer)


def _remove_tree(folder: str | Path) -> None:
    """Remove a folder, also where a program has closed folders in it."""
    shutil.rmtree(folder, ignore_errors=True)
    if os.path.lexists(folder):
        for place, inner, _ in os.walk(folder):
            for name in inner:
                if not os.path.islink(os.path.join(place, name)):
                    os.chmod(os.path.join(place, name), stat.S_IRWXU)
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def temporary_file(path: Path) -> Iterator[None]:
    """A context that removes a file if the block raises."""
    _FILES.add(str(path))
    try:
        yield
    except BaseException:
        with suppress(OSError):
            path.unlink()
        raise
    finally:
        _FILES.discard(str(path))


def run_program(command: Sequence[str], seconds: float, folder: Path | None = None) -> tuple[int, str]:
    """Run a program, and return its exit status and what it wrote.

    The program and those that it starts are a group of processes. They end when the time is over, and when this call is
    interrupted. Temporary files of the program go into the folder, if it is given. It raises OSError if it cannot be
    started, and TimeoutExpired if it takes longer.
    """
    environment = None if folder is None else {**os.environ, "TMPDIR": str(folder)}
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
    with process_group(command, env=environment, **output) as process:
        text, _ = process.communicate(timeout=seconds)
        return process.wait(), text


@contextmanager
def process_group(command: Sequence[str], **options: Any) -> Iterator["subprocess.Popen[Any]"]:
    """A program in a group of processes of its own. What is left of the group is ended with the block.

    It raises OSError if it cannot be started.
    """
    if _LEADS:  # its parent, which ends it, does not know the program
        signal.signal(signal.SIGTERM, lambda number, frame: _end_now())
    process = None
    try:
        with deferred_interrupts(), _STARTS:  # an end before the process is known would leave it behind
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **options)
            _PROGRAMS.add(process.pid)
        yield process
    finally:
        if process is not None:
            with process:
                _kill(process.pid)
            _PROGRAMS.discard(process.pid)


def lead_group() -> None:
    """Make this forked process, with the programs that it starts, a group that its parent ends."""
    global _LEADS
    os.setsid()
    _LEADS = True
    for known in (_GROUPS, _PROGRAMS, _FOLDERS, _FILES):  # the parent's
        known.clear()
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN if number == signal.SIGINT else signal.SIG_DFL)
    signal.set_wakeup_fd(-1)  # that of the parent


def note_group(leader: int, base: Path | None = None) -> None:
    """A forked process that leads a group, and where it makes folders, if not where temporary files are."""
    _GROUPS[leader] = base


def end_groups(*leaders: int) -> None:
    """End forked processes and the programs that they started, and remove their folders."""
    for leader in leaders:
        with suppress(OSError):
            os.kill(leader, signal.SIGTERM)
    deadline = time.monotonic() + _GRACE
    for leader in leaders:
        with suppress(OSError):
            while not _has_ended(leader) and time.monotonic() < deadline:
                time.sleep(_SOON)
        _kill(leader)
        with suppress(OSError):
            os.kill(leader, signal.SIGKILL)  # it may not lead its group yet
        for path in Path(_GROUPS.pop(leader, None) or tempfile.gettempdir()).glob(f"{PREFIX}{leader}-*"):
            if _maker(path) is not None:
                _remove(path)


def _has_ended(child: int) -> bool:
    """Whether a child has ended, which stays to be waited for."""
    if hasattr(os, "waitid"):
        return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return os.waitpid(child, os.WNOHANG)[0] != 0


def clean_up() -> None:
    """End the programs, and remove the folders and files, of a process that is about to end at once."""
    _STARTS.acquire(timeout=_GRACE)  # a thread may be starting a program, and must start no other
    for program in list(_PROGRAMS):
        _kill(program)
    end_groups(*_GROUPS)
    for name in list(_FILES):
        with suppress(OSError):
            os.unlink(name)
    for name in list(_FOLDERS):
        _remove(name)


def outlive(parent: int) -> None:
    """Clean up for a parent that ends, whatever ends it, and end the group that this process leads."""
    clean_up()
    deadline = time.monotonic() + _GRACE
    while os.getppid() == parent and time.monotonic() < deadline:
        time.sleep(_SOON)
    group = os.getpgid(0)
    with suppress(OSError):  # there may be too many processes
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads
        if os.fork() > 0:
            return
        os.setsid()  # a process by itself: other threads of this one may still write into the parent's folders
    _kill(group)
    remove_left_folders()
    os._exit(0)


def end_with_parent() -> None:
    """Let this worker of a pool end with its parent, which alone hears of interrupts, or when it is terminated."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.set_wakeup_fd(-1)  # that of the parent, if it was forked
    signal.signal(signal.SIGTERM, lambda number, frame: _end_now())
    watch_parent()


def watch_parent() -> None:
    """End this process with its parent, if it is of a pool: those of Python go on where their parent is killed."""
    global _WATCHES
    if parent_process() is not None and os.getpid() != _WATCHES:
        _WATCHES = os.getpid()
        threading.Thread(target=_watch_parent, args=(os.getppid(),), daemon=True).start()


def _watch_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_TICK)
    os.kill(os.getpid(), signal.SIGTERM)  # the main thread ends all: it would start the next program beside this one
    time.sleep(1.0)
    _end_now()  # it is in compiled code, which notices no signals


def _end_now() -> None:
    clean_up()
    os._exit(1)


def remove_left_folders(place: Path | None = None) -> None:
    """Remove the user's temporary folders of processes that were killed, in a place or where temporary files are."""
    place = (place or Path(tempfile.gettempdir())).resolve()
    if place == Path(os.curdir).resolve():  # where nothing is temporary
        return
    for path in place.glob(f"{PREFIX}*-*"):
        maker = _maker(path)
        if maker is not None and _begin_of(maker[0]) != maker[1]:
            _remove(path)


def _maker(folder: Path) -> tuple[int, str] | None:
    """The process of this machine that made a temporary folder, and its begin; None if another or nobody did so."""
    mark = folder / _MARK
    try:
        if folder.is_symlink() or mark.is_symlink() or not mark.is_file() or folder.stat().st_uid != os.getuid():
            return None
        title, name, machine, process, begin = mark.read_text(encoding="utf-8").split("\n")
        if (title, name, machine) == (_TITLE, folder.name, _machine()):
            return int(process), begin
    except (OSError, ValueError):
        pass
    return None


def _machine() -> str:
    """What tells this machine, since it was started, and this container from others that share folders with it."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{os.uname().nodename} {boot} {os.readlink('/proc/self/ns/pid')}"
    except OSError:
        return os.uname().nodename if hasattr(os, "uname") else ""


def _begin_of(process: int) -> str:
    """When a process began, as the system tells it; empty if it does not run."""
    try:
        status = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        return "" if status[0] in "ZX" else status[19]  # ended, though nobody has waited for it
    except OSError:
        return "" if Path("/proc/self/stat").exists() else _runs(process)


def _runs(process: int) -> str:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return ""
    except (OverflowError, PermissionError):  # a process of another user
        pass
    return "runs"


def _kill(group: int) -> None:
    with suppress(OSError):
        os.killpg(group, signal.SIGKILL)


def _forget_starts() -> None:
    """Make a new lock in a process that was forked: a thread of the parent may have had the old one."""
    global _STARTS
    _STARTS = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_starts)
