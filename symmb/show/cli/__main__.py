"""The program `symmb`, also started by `python -m symmb`."""

import importlib
import os
import signal
import sys

from symmb._interrupts import SIGNALS
from symmb.show.cli.signals import INTERRUPTED, end_at_signals, end_now


def run() -> int | str | None:
    """Run the command in the arguments. Signals can end the command at any time, even while modules load."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # the stream is closed
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
    end_at_signals()
    try:
        try:
            status = importlib.import_module("symmb.show.cli.main").main()
        except SystemExit as end:  # raised by --help, and by wrong arguments
            status = end.code
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)  # the work is done: signals must not change the exit status
    except KeyboardInterrupt:
        status = INTERRUPTED
    except RuntimeError as error:  # Python 3.11 raises this error if a signal arrives while a class is made
        if not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        status = INTERRUPTED
    if status == INTERRUPTED:
        end_now()  # otherwise Python would end by SIGINT if a module was loading
    try:
        sys.stdout.flush()
    except OSError as error:  # full disk or closed reader: Python would write again, and end with status 120
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not status and not isinstance(error, BrokenPipeError):
            print(f"symmb: {error}", file=sys.stderr)
            status = 2
    return status


if __name__ == "__main__":
    sys.exit(run())
