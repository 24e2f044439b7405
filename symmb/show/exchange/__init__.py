"""Export of scenes for other programs, as FMUs and as C source.

The C code that all FMUs have in common is in `run/codegen/c`: `fmi2.h`, `fmi3.h` and `fmu.h`. `fmu.h` checks the order
of calls.
"""

from symmb.show.exchange.exported import Exported, exported
from symmb.show.exchange.fmu import save_fmu, save_scene_c
