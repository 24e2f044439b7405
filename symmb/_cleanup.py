"""What must not outlive this process: temporary folders, incomplete files, and programs that it has started."""

import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any

from symmb._interrupts import deferred_interrupts

PREFIX = "symmb-"
"""Beginning of the names of temporary folders. The number of their process follows."""

_FOLDERS: set[str] = set()
_FILES: set[str] = set()
_GROUPS: set[int] = set()
_LEADS = False
_TICK = 0.2
"""Time between looks whether the parent is still there [s]."""


@contextmanager
def temporary_folder(base: Path | None = None) -> Iterator[Path]:
    """A new folder that is removed at the end of the block, in `base` or where temporary files are.

    Raises
    ------
    OSError     if it cannot be created
    """
    name = tempfile.mkdtemp(prefix=f"{PREFIX}{os.getpid()}-", dir=base)
    _FOLDERS.add(name)
    try:
        yield Path(name).resolve()
    finally:
        shutil.rmtree(name, ignore_errors=True)
        _FOLDERS.discard(name)


def lasting_folder() -> Path:
    """A new folder that is removed at the end of this process, also in workers of a pool, which skip `atexit`.

    Raises
    ------
    OSError     if it cannot be created
    """
    name = tempfile.mkdtemp(prefix=f"{PREFIX}{os.getpid()}-")
    _FOLDERS.add(name)
    Finalize(None, shutil.rmtree, (name, True), exitpriority=0)
    return Path(name).resolve()


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

    The program and those that it starts are a group of processes. They end when the time is over, and when this call
    is interrupted. Temporary files of the program go into the folder, if it is given.

    Raises
    ------
    OSError                         if it cannot be started
    subprocess.TimeoutExpired       if it takes longer
    """
    environment = None if folder is None else {**os.environ, "TMPDIR": str(folder)}
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
    with process_group(command, env=environment, **output) as process:
        text, _ = process.communicate(timeout=seconds)
        return process.wait(), text


@contextmanager
def process_group(command: Sequence[str], **options: Any) -> Iterator["subprocess.Popen[Any]"]:
    """A program in a group of processes of its own. What is left of the group is ended with the block.

    Raises
    ------
    OSError     if it cannot be started
    """
    with deferred_interrupts():  # one that arrives before the process is known would leave it behind
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=not _LEADS, **options)
        _GROUPS.add(process.pid)
    with process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()  # in a group that it does not lead
            if not _LEADS:
                _kill(process.pid)
            _GROUPS.discard(process.pid)


def lead_group() -> None:
    """Make this forked process, with the programs that it starts, a group that its parent ends."""
    global _LEADS
    os.setsid()
    _LEADS = True
    for known in (_GROUPS, _FOLDERS, _FILES):  # the parent's
        known.clear()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def note_group(leader: int) -> None:
    """A forked process that leads a group."""
    _GROUPS.add(leader)


def end_group(leader: int) -> None:
    """End a forked process and the programs that it started, and remove its folders."""
    _kill(leader)
    with suppress(OSError):
        os.kill(leader, signal.SIGKILL)  # it may not lead its group yet
    _GROUPS.discard(leader)
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}{leader}-*"):
        shutil.rmtree(path, ignore_errors=True)


def clean_up() -> None:
    """End the programs, and remove the folders and files, of a process that is about to end at once."""
    for group in list(_GROUPS):
        end_group(group)
    for name in list(_FILES):
        with suppress(OSError):
            os.unlink(name)
    for name in list(_FOLDERS):
        shutil.rmtree(name, ignore_errors=True)


def end_with_parent() -> None:
    """Let this worker of a pool end with its parent, which alone hears of interrupts, or when it is terminated."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.set_wakeup_fd(-1)  # that of the parent, if it was forked
    signal.signal(signal.SIGTERM, lambda number, frame: _end_now())
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


def left_folders() -> list[Path]:
    """The user's temporary folders of processes that were killed."""
    folders = [path for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*-*") if path.is_dir()]
    own = [path for path in folders if not path.is_symlink() and path.stat().st_uid == os.getuid()]
    return [path for path in own if not _runs(path.name.split("-")[1])]


def _runs(number: str) -> bool:
    try:
        os.kill(int(number), 0)
    except ProcessLookupError:
        return False
    except (ValueError, PermissionError):  # not a name of ours, or a process of another user
        pass
    return True


def _kill(group: int) -> None:
    with suppress(OSError):
        os.killpg(group, signal.SIGKILL)
