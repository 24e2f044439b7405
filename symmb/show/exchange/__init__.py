"""Scenes for other programs: FMUs, and C source of runs.

The fixed C of FMUs is in `run/codegen/c`: `fmi2.h`, `fmi3.h`, and `fmu.h`, which checks the order of calls.
"""

from symmb.show.exchange.fmu import save_fmu, save_scene_c
