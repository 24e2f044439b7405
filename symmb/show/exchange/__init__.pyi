"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .exported import Exported as Exported, exported as exported
from .fmu import save_fmu as save_fmu, save_scene_c as save_scene_c
