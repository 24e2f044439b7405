"""The program `symmb`, run by `python -m symmb`."""

import sys

from symmb.cli.__main__ import run

sys.exit(run())
