"""Removes temporary folders and incomplete files, and ends started programs, when this process ends."""

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
from pathlib import Path
from typing import Any

from symmb._interrupts import SIGNALS, deferred_interrupts

PREFIX = "symmb-"
"""First part of the names of temporary folders. The number of the process follows."""

_MARK, _FOLDER = ".symmb", "run"
"""Contents of a temporary folder: the mark, and the folder of the temporary files. The mark is a file that names the
process that made the folder. The mark is necessary, because other programs may also use such names of folders."""
_TITLE = "temporary folder of symmb"
_FOLDERS: set[str] = set()
_FILES: set[str] = set()
_GROUPS: dict[int, Path | None] = {}
"""Number of a forked group leader -> the folder for its folders; None: the system's temporary folder."""
_PROGRAMS: set[int] = set()
"""Numbers of the programs that this process has started. Each program leads a process group."""
_STARTS = threading.Lock()
"""This lock is held while a program is started. A process that is about to end keeps it."""
_CLEANS = threading.RLock()
"""This lock is held while a thread cleans up. Signals may interrupt this thread by a function that cleans up, too."""
_ENDS = False
"""Whether this process is about to end. A second thread that cleans up does not wait for programs that start."""
_SEARCHED: set[Path] = set()
_LEADS = False
_WATCHES = 0
"""Number of the process that checks whether its parent still runs. A forked process must start its own check."""
_GRACE = 0.5
"""Time for a process to end its programs and to remove its folders [s]."""


def real_path(path: str | Path) -> Path:
    """The path without links. Unlike `Path.resolve`, this raises no RuntimeError if links form a loop."""
    return Path(os.path.realpath(path))


@contextmanager
def temporary_folder(base: Path | None = None) -> Iterator[Path]:
    """A context with a new folder in `base`, or in the system's temporary folder. The folder is removed at the end.

    OSError is raised if the folder cannot be created.
    """
    folder = _new_folder(base)
    try:
        yield folder
    finally:
        _remove(folder.parent)
        _FOLDERS.discard(str(folder.parent))


def lasting_folder() -> Path:
    """A new folder that is removed when this process ends. Workers of a pool also remove their folders.

    OSError is raised if the folder cannot be created.
    """
    from multiprocessing.util import Finalize

    folder = _new_folder(None)
    Finalize(None, _remove, (folder.parent,), exitpriority=0)
    return folder


def _new_folder(base: Path | None) -> Path:
    """A new folder beside the mark of this process. First, the folders of killed processes are removed."""
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
    """Remove a folder. If another process still writes into the folder, the mark is kept for a later attempt."""
    inner = os.path.join(outer, _FOLDER)
    _remove_tree(inner)
    if not os.path.lexists(inner):
        _remove_tree(outer)


def _remove_tree(folder: str | Path) -> None:
    """Remove a folder, even if a program has removed the permissions of folders inside it."""
    shutil.rmtree(folder, ignore_errors=True)
    if os.path.lexists(folder):
        for place, inner, _ in os.walk(folder):
            for name in inner:
                if not os.path.islink(os.path.join(place, name)):
                    os.chmod(os.path.join(place, name), stat.S_IRWXU)
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def temporary_file(path: Path) -> Iterator[None]:
    """A context that removes a file if the block raises an exception."""
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
    """Run a program, and return its exit status and its output.

    The program and the programs that it starts form a process group. The group ends after `seconds`, or when this call
    is interrupted. If a folder is given, the program writes temporary files there, and uses it as home folder if the
    variable HOME is not set. OSError is raised if the program cannot be started. TimeoutExpired is raised if the
    program needs more time.
    """
    environment = None if folder is None else {"HOME": str(folder), **os.environ, "TMPDIR": str(folder)}
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
    with process_group(command, env=environment, **output) as process:
        text, _ = process.communicate(timeout=seconds)
        return process.wait(), text


@contextmanager
def process_group(command: Sequence[str], **options: Any) -> Iterator["subprocess.Popen[Any]"]:
    """A context with a program in a new process group. At the end of the block, all processes of the group are ended.

    OSError is raised if the program cannot be started.
    """
    if _LEADS:  # the parent, which ends this process, does not know the program
        signal.signal(signal.SIGTERM, lambda number, frame: _end_now())
    process = None
    try:
        with deferred_interrupts(), _STARTS:  # an interrupt before the process is known would leave the process running
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **options)
            _PROGRAMS.add(process.pid)
        yield process
    finally:
        if process is not None:
            with process:
                _kill(process.pid)
            _PROGRAMS.discard(process.pid)


def lead_group() -> None:
    """Make this forked process the leader of a new process group. The parent ends this group."""
    global _LEADS
    os.setsid()
    _LEADS = True
    for known in (_GROUPS, _PROGRAMS, _FOLDERS, _FILES):  # the lists of the parent
        known.clear()
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN if number == signal.SIGINT else signal.SIG_DFL)
    signal.set_wakeup_fd(-1)  # the descriptor belongs to the parent


def note_group(leader: int, base: Path | None = None) -> None:
    """Remember a forked process that leads a group, and the folder for its folders (default: the temporary folder)."""
    _GROUPS[leader] = base


def end_groups(*leaders: int) -> None:
    """End forked processes and the programs that they started. Remove the folders of these processes."""
    for leader in leaders:
        with suppress(OSError):
            os.kill(leader, signal.SIGTERM)
    deadline = time.monotonic() + _GRACE
    for leader in leaders:
        with suppress(OSError):
            while not _has_ended(leader) and time.monotonic() < deadline:
                time.sleep(0.005)
        _kill(leader)
        with suppress(OSError):
            os.kill(leader, signal.SIGKILL)  # the process may not lead its group yet
        for path in Path(_GROUPS.pop(leader, None) or tempfile.gettempdir()).glob(f"{PREFIX}{leader}-*"):
            if _maker(path) is not None:
                _remove(path)


def _has_ended(child: int) -> bool:
    """Whether a child process has ended. A later call of `wait` for this process still works."""
    if hasattr(os, "waitid"):
        return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return os.waitpid(child, os.WNOHANG)[0] != 0


def clean_up() -> None:
    """End the programs of this process, and remove its folders and files, because the process ends now."""
    global _ENDS
    first = _CLEANS.acquire(timeout=_GRACE)
    try:
        if not _ENDS:
            _ENDS = True
            _STARTS.acquire(timeout=_GRACE)  # a thread may be starting a program, and must not start another program
        for program in list(_PROGRAMS):
            _kill(program)
        end_groups(*_GROUPS)
        for name in list(_FILES):
            with suppress(OSError):
                os.unlink(name)
        for name in list(_FOLDERS):
            _remove(name)
    finally:
        if first:
            _CLEANS.release()


def outlive(parent: int) -> None:
    """Clean up because the parent ends, for any reason. Then end the process group of this process."""
    clean_up()
    deadline = time.monotonic() + _GRACE
    while os.getppid() == parent and time.monotonic() < deadline:
        time.sleep(0.005)
    group = os.getpgid(0)
    with suppress(OSError):  # there may be too many processes
        warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of forks in programs with threads
        if os.fork() > 0:
            return
        os.setsid()  # a new session, so that `_kill` ends threads that may still write, but not this process
    _kill(group)
    remove_left_folders()
    os._exit(0)


def end_with_parent() -> None:
    """Let this worker of a pool end when its parent ends, or at SIGTERM. Only the parent receives interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.set_wakeup_fd(-1)  # the descriptor belongs to the parent, if the process was forked
    signal.signal(signal.SIGTERM, lambda number, frame: _end_now())
    watch_parent()


def watch_parent() -> None:
    """Let this worker of a pool end when its parent ends. By default, workers continue if the parent is killed."""
    from multiprocessing import parent_process

    global _WATCHES
    if parent_process() is not None and os.getpid() != _WATCHES:
        _WATCHES = os.getpid()
        threading.Thread(target=_watch_parent, args=(os.getppid(),), daemon=True).start()


def _watch_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.2)
    os.kill(os.getpid(), signal.SIGTERM)  # otherwise the main thread would start the next program
    time.sleep(1.0)
    _end_now()  # the main thread is in compiled code, which does not react to signals


def _end_now() -> None:
    clean_up()
    os._exit(1)


def remove_left_folders(place: Path | None = None) -> None:
    """Remove the folders that killed processes of this user left in `place`, or in the system's temporary folder."""
    place = (place or Path(tempfile.gettempdir())).resolve()
    if place == Path(os.curdir).resolve():  # the current folder is not used for temporary files
        return
    for path in place.glob(f"{PREFIX}*-*"):
        maker = _maker(path)
        if maker is not None and _begin_of(maker[0]) != maker[1]:
            _remove(path)


def _maker(folder: Path) -> tuple[int, str] | None:
    """The number and the start time of the process of this machine that made a folder; None for other folders."""
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
    """A text that identifies this machine, its last boot and this container. Machines may share a temporary folder."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{os.uname().nodename} {boot} {os.readlink('/proc/self/ns/pid')}"
    except OSError:
        return os.uname().nodename if hasattr(os, "uname") else ""


def _begin_of(process: int) -> str:
    """The start time of a process, as the system reports it; empty if the process does not run."""
    try:
        status = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        return "" if status[0] in "ZX" else status[19]  # Z and X: the process has ended, but was not waited for
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
    """Make a new lock in a forked process, because a thread of the parent may have held the old lock."""
    global _STARTS
    _STARTS = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_starts)
