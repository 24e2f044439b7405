"""C source of a scene's runs, with a main program."""

from pathlib import Path

from symmb.codegen import C_FOLDER, scene_source
from symmb.exchange.exported import exported
from symmb.files import replacement
from symmb.model import Scene
from symmb.simulation import DAESimulator


def save_scene_c(scene: Scene | DAESimulator, folder: Path) -> tuple[Path, ...]:
    """Write scene.h, scene.c and main.c, which runs the scene over its times, to a folder that exists.

    It raises DeclarationError if something of the scene needs Python.
    """
    model = exported(scene)
    texts = scene_source(model.source) | {"main.c": (C_FOLDER / "main.c").read_text(encoding="utf-8")}
    for name, text in texts.items():
        with replacement(folder / name) as file:
            file.write(text.encode())
    return tuple(folder / name for name in texts)
