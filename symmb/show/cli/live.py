"""The command `symmb live`: a page that runs the scene while a reader changes its parameters."""

import argparse
from collections.abc import Callable

from symmb._progress import Progress
from symmb.show.cli.bound import limits_of
from symmb.show.cli.result_path import result_path
from symmb.show.cli.scene_file import import_of, load_scene
from symmb.show.live import live_from


def add_live(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command `symmb live`."""
    text = "write a page that runs the scene and bounds its outputs while parameters are changed; needs ziglang"
    live = command("live", text, _live, usage="-o F.html [options]")
    live.add_argument("-o", "--output", metavar="F.html", required=True, help="file to write")
    several = {"nargs": "+", "action": "extend", "default": []}
    live.add_argument("--limit", metavar="x=:0.3", **several, help="limits low:high of outputs")


def _live(options: argparse.Namespace) -> None:
    result_path(options.output, ".html")
    limits = limits_of(options)
    scene = load_scene(options.scene)
    with Progress(f"compiling {scene.name}"):
        live_from(scene, options.output, limits or None, import_of(options.scene))
    print(options.output)
