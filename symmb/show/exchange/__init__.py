"""Export of scenes for other programs, as FMUs and as C source.

The C code that all FMUs have in common is in `run/codegen/c`: `fmi2.h`, `fmi3.h` and `fmu.h`. `fmu.h` checks the order
of calls.
"""

from symmb._doors import open_door

open_door(__name__)
