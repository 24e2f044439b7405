"""The end of the program at SIGINT, SIGTERM, SIGHUP and SIGQUIT, at any moment.

The signals raise KeyboardInterrupt in the main thread, which can then write the results so far. A call of compiled code
may delay the exception. A second thread therefore ends the process after a short time.
"""

import os
import select
import signal
import sys
import time
from contextlib import suppress
from functools import partial
from threading import Thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from symmb._cleanup import clean_up
from symmb._interrupts import SIGNALS

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

INTERRUPTED = 130
"""The exit status of an interrupted program, as shells define it for SIGINT."""
_LOST = b"\0"
"""The byte with which the main thread reports a lost interrupt: Python drops exceptions of some callbacks."""


def end_at_signals() -> None:
    """End this process after a signal, and at once after a second signal."""
    for number in SIGNALS:
        if number in (signal.SIGINT, signal.SIGTERM) or signal.getsignal(number) is not signal.SIG_IGN:  # nohup ignores
            signal.signal(number, _interrupt)
    if os.name != "posix":  # other systems compile nothing, and have no pipe for signals
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    try:
        Thread(target=_watch, args=(reader,), daemon=True).start()
    except RuntimeError:  # the thread cannot be started: the handlers alone end the process
        os.environ["OPENBLAS_NUM_THREADS"] = "1"  # otherwise NumPy's threads would end the process by SIGINT
        return
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    sys.unraisablehook = partial(_report_unraisable, writer)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _report_unraisable(writer: int, unraisable: "UnraisableHookArgs") -> None:
    if unraisable.exc_type is KeyboardInterrupt:
        os.write(writer, _LOST)
    else:
        sys.__unraisablehook__(unraisable)


def _watch(reader: int) -> None:
    while os.read(reader, 1)[0] not in SIGNALS:  # C writes the number of each signal that has a handler
        pass
    # Time for the main thread to end [s]. The program ends within 2 s.
    deadline, repeated = time.monotonic() + 1.4, 0
    while select.select([reader], [], [], max(deadline - time.monotonic(), 0.0))[0]:
        if os.read(reader, 1) == _LOST:
            repeated += 1
            time.sleep(0.005)  # by then the callback has returned
            signal.pthread_kill(main_thread().ident or 0, signal.SIGINT)
        elif repeated:
            repeated -= 1
        else:  # a second signal
            break
    end_now()


def end_now() -> NoReturn:
    """End this process with all programs that it has started."""
    clean_up()
    if sys.stderr.isatty():
        os.write(sys.stderr.fileno(), b"\r\x1b[K")  # clear the progress line
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, RuntimeError, ValueError):  # the main thread may be writing to the stream
            stream.flush()
    os._exit(INTERRUPTED)
