"""Scenes for other programs: FMUs, and C source of runs."""

from symmb.show.exchange.fmu import save_fmu, save_scene_c
