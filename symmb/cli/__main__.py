"""The program `symmb`, which `python -m symmb.cli` runs as well."""

import importlib
import signal
import sys

from symmb._interrupts import SIGNALS
from symmb.cli.signals import INTERRUPTED, end_at_signals, end_now


def run() -> int:
    """Run the command that the arguments name. Signals end it from its first moment on, while modules load as well."""
    end_at_signals()
    try:
        status = importlib.import_module("symmb.cli.main").main()
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)  # the work is done: its status is that of the process
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:
        end_now()  # Python would end by SIGINT, if a module was loading
    return status


if __name__ == "__main__":
    sys.exit(run())
