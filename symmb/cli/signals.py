"""The end of the program at SIGINT and SIGTERM, whatever it is doing.

Both raise KeyboardInterrupt in the main thread, so that what was found so far can be written. A call of compiled code
may keep the main thread from this for long. A second thread therefore ends the process after a short time.
"""

import os
import select
import signal
import sys
from contextlib import suppress
from threading import Thread
from types import FrameType
from typing import NoReturn

from symmb._cleanup import clean_up

INTERRUPTED = 130
"""The exit status of a program that was interrupted, as shells have it for SIGINT."""
SIGNALS = signal.SIGINT, signal.SIGTERM
_GRACE = 1.4
"""Time for the main thread to end [s]. The program ends within 2 s."""


def end_at_signals() -> None:
    """End this process at SIGINT and SIGTERM, at once at the second signal."""
    for number in SIGNALS:
        signal.signal(number, _interrupt)
    if os.name != "posix":  # elsewhere nothing is compiled, and no pipe tells of signals
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    Thread(target=_watch, args=(reader,), daemon=True).start()


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _watch(reader: int) -> None:
    while os.read(reader, 1)[0] not in SIGNALS:  # C writes the number of each signal that has a handler
        pass
    select.select([reader], [], [], _GRACE)
    end_now()


def end_now() -> NoReturn:
    """End this process with all that it has started."""
    clean_up()
    if sys.stderr.isatty():
        os.write(sys.stderr.fileno(), b"\r\x1b[K")  # the line that shows progress
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, RuntimeError, ValueError):  # the main thread may be writing to it
            stream.flush()
    os._exit(INTERRUPTED)
