"""Scenes for other programs: FMUs, and C source of runs."""

from symmb.exchange.fmu import save_fmu
from symmb.exchange.scene_c import save_scene_c
