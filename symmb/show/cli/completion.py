"""The command `symmb completion`: a script for shells that completes commands, options and scenes."""

import argparse
from typing import Any

from symmb._errors import DeclarationError
from symmb._options import optional_package
from symmb.show.cli.scene_file import shipped_names

_SHELLS = ("bash", "zsh")


def add_completion(commands: "argparse._SubParsersAction[Any]", parser: argparse.ArgumentParser) -> None:
    """Add the command `symmb completion` for the commands of the parser."""
    text = "print a script that completes commands, options and scenes in a shell; needs symmb[completion]"
    completion = commands.add_parser(
        "completion", help=text, description=text + '. Use: eval "$(symmb completion bash)".'
    )
    completion.add_argument("shell", choices=_SHELLS)
    completion.set_defaults(run=lambda options: print(_script(parser, commands, options.shell)))


def _script(parser: argparse.ArgumentParser, commands: "argparse._SubParsersAction[Any]", shell: str) -> str:
    try:
        shtab = optional_package("shtab", "this command", "completion")
    except ImportError as error:
        raise DeclarationError(str(error)) from None
    for action in (action for command in commands.choices.values() for action in command._actions):
        if action.dest == "scene":
            action.complete = {name: "_symmb_scene" for name in _SHELLS}  # type: ignore[attr-defined]
        elif str(action.metavar).startswith(("F", "DIR")):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    names = " ".join(shipped_names())
    preamble = {
        "bash": f'_symmb_scene() {{ compgen -f -- "$1"; compgen -W "{names}" -- "$1"; }}',
        "zsh": f'_symmb_scene() {{ _alternative "files:file:_files" "scenes:shipped scene:({names})"; }}',
    }
    return shtab.complete(parser, shell, preamble=preamble)
