"""Scenes from a Python or URDF file, or by name, and the option `--set`. Errors are reported in one sentence."""

import argparse
import importlib
import importlib.util
import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from symmb import models
from symmb._cleanup import real_path
from symmb._errors import DeclarationError, SymmbError, text_of
from symmb._names import did_you_mean
from symmb._options import shown
from symmb._units import number_or_quantity
from symmb.connect import Simulator
from symmb.equations.model import Box, Scene
from symmb.show.cli.urdf_scene import parameter_name, urdf_scene

_MODELS = Path(models.__path__[0])
"""The folder of shipped scenes."""


def load_scene(given: str, numbers: Iterable[str] = ()) -> Scene:
    """The scene of a Python file, of a URDF file, or of a shipped model by its name.

    The file runs with `__file__` set, and can import from its folder. Its `scene` is a Scene, or a function without
    arguments. A scene without a name gets the name of the file. `numbers` of a URDF file become parameters.
    DeclarationError is raised if the file or model does not exist, defines no `scene()`, or raises an exception.
    """
    path = _find(given)
    return urdf_scene(path, numbers) if is_urdf(given) else _scene(_module(path), path)


def import_of(given: str) -> str:
    """Lines of Python that define the `scene` of `load_scene`; empty for a file that cannot be imported."""
    path = _find(given)
    if is_urdf(given) or not path.stem.isidentifier():
        return ""
    package = "symmb.models." if path.parent == _MODELS else ""
    return f"from {package}{path.stem} import scene\nscene = scene() if callable(scene) else scene"


def is_urdf(given: str) -> bool:
    """Whether a scene is a URDF file."""
    return given.lower().endswith(".urdf")


def add_set(command: argparse.ArgumentParser) -> None:
    """Add the option `--set` to a command."""
    text = "values of parameters that differ from the nominal values"
    command.add_argument("--set", metavar="l1=1.02", nargs="+", action="extend", default=[], help=text)


def scene_and_parameters(options: argparse.Namespace) -> tuple[Scene, dict[str, Any]]:
    """The scene of a command, and the parameters from --set. For a URDF file, parameters are its numbers.

    DeclarationError is raised if a text is not of the form name=number, or if the scene cannot be loaded.
    """
    values = dict[str, Any]()
    for text in options.set:
        name, _, value = text.partition("=")
        try:
            values[name] = number_or_quantity(value)
        except ValueError:
            raise DeclarationError(f"--set takes name=number, got {shown(text)}.") from None
    scene = load_scene(options.scene, values)
    if is_urdf(options.scene):
        values = {parameter_name(name): value for name, value in values.items()}
    return scene, values


def load_subject(given: str, numbers: Iterable[str] = ()) -> tuple[Scene | Simulator, Box | None]:
    """The scene or simulator in a file, and its box. A file defines `scene()`, or `simulator()` with a box.

    DeclarationError is raised in the same cases as by `load_scene`.
    """
    path = _find(given)
    if is_urdf(given):
        return urdf_scene(path, numbers), None
    module = _module(path)
    if hasattr(module, "scene") or not hasattr(module, "simulator"):
        scene = _scene(module, path)
        return scene, scene.box
    make = module.simulator
    if not callable(make):
        raise DeclarationError(f"{path}: simulator must be a function that returns a simulator and its symmb.Box.")
    with _foreign(path):
        study = make()
    if not isinstance(study, tuple) or [*map(type, study[1:])] != [Box] or not hasattr(study[0], "stream"):
        raise DeclarationError(f"{path}: simulator() must return a pair, a simulator and its symmb.Box.")
    return study


def value_in_module(module: str, name: str, kind: type) -> Any:
    """A value in a module of the user: in a file of the current folder, or in an installed module.

    An error lists the classes and objects of a kind.

    DeclarationError is raised if the module or the name does not exist, or if the module raises an exception.
    """
    path = Path(*module.split(".")).with_suffix(".py")
    if path.is_file():
        found = _module(real_path(path))
    else:
        try:
            found = importlib.import_module(module)
        except ModuleNotFoundError as error:
            raise DeclarationError(
                f"{module}:{name}: there is no method {module!r}, no file {path} in this folder, and no module "
                f"{error.name}."
            ) from error
        except Exception as error:
            raise DeclarationError(f"{module}:{name}: the module raised {text_of(error)}.") from error
    if not hasattr(found, name):
        own = [k for k, v in vars(found).items() if issubclass(v if isinstance(v, type) else type(v), kind)]
        raise DeclarationError(f"{module}:{name}: the module has no {name!r}.{did_you_mean(name, own) if own else ''}")
    return getattr(found, name)


def _module(path: Path) -> ModuleType:
    """The module of a file. Other processes can import the module by its name, so its functions can be sent to them."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise DeclarationError(f"{path} is not a scene file. Use a .py file that defines scene(), or a .urdf file.")
    module = importlib.util.module_from_spec(spec)
    known = sys.modules.setdefault(path.stem, module)
    if getattr(known, "__file__", None) == str(path):
        sys.modules[path.stem] = module
    with _foreign(path):
        spec.loader.exec_module(module)
    return module


def _scene(module: ModuleType, path: Path) -> Scene:
    scene = getattr(module, "scene", None)
    if not isinstance(scene, Scene):
        if not callable(scene):
            raise DeclarationError(
                f"{path} defines no function scene() that returns a symmb.Scene, and no variable scene of this type."
            )
        with _foreign(path):
            scene = scene()
    if not isinstance(scene, Scene):
        raise DeclarationError(f"{path}: scene() returned a {type(scene).__name__}; it must return a symmb.Scene.")
    return scene.with_name(path.stem) if scene.name == Scene.name else scene


def shipped_names() -> list[str]:
    """The names of the shipped scenes."""
    return sorted(path.stem for path in _MODELS.glob("*.py") if not path.name.startswith("_"))


def _find(given: str) -> Path:
    for path in (Path(given), _MODELS / f"{given}.py"):
        if path.is_file():
            return path
    if given.endswith(".py") or is_urdf(given) or len(Path(given).parts) > 1:
        raise DeclarationError(f"There is no scene file {given}.")
    raise DeclarationError(
        f"There is no scene file and no shipped scene {given!r}.{did_you_mean(given, shipped_names())}"
    )


@contextmanager
def _foreign(path: Path) -> Iterator[None]:
    """A context for the code of a file. The code can import from its folder. An exception becomes one sentence."""
    before, folder = sys.path, str(real_path(path.parent))
    sys.path = [folder, *before]
    try:
        yield
    except SymmbError as error:
        raise DeclarationError(f"{path}: {error}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        frames = traceback.extract_tb(error.__traceback__)  # a SyntaxError contains its line
        lines = [frame.lineno for frame in frames if real_path(frame.filename) == real_path(path)]
        where = f" (line {lines[-1]})" if lines else ""
        raise DeclarationError(f"{path} raised {text_of(error)}{where}.") from error
    finally:
        sys.path = before
