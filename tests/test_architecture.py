"""The floors: who may import whom, how long a file may be, and what `import symmb` must not load."""

import ast
import importlib
import itertools
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import symmb
from symmb._presentation import UPWARD

ROOT = Path(symmb.__file__).parent
WINGS = {
    "": "_errors _types _names _options _specs _table _doubt _html _labelled _progress _cleanup _interrupts _limits"
    " _threads _work _citation _units _presentation _magnitudes _doors",
    "results": "files plot",
    "declare": "symbolic structures mechanics",
    "equations": "model start",
    "connect": "",
    "run": "schemes codegen events integrate formulations verification simulation linear",
    "prove": "",
    "bound": "polynomials nodes searches responses answers adaptive methods reductions propagation",
    "study": "",
    "show": "drawing exchange live report",
}
"""The rooms of each wing, from the ground up. The first are files of the ground floor. A wing without rooms is one."""
ROOMS = [f"{wing}.{room}".strip(".") for wing, rooms in WINGS.items() for room in rooms.split() or [""]]
ABOVE = ["symmb", "models", "show.cli", "__main__"]
"""The public names, and their clients."""
FLOORS = {unit: floor for floor, unit in enumerate([*ROOMS, *ABOVE])} | dict.fromkeys(WINGS[""].split(), 0)
HEAVY = "sympy fmpy matplotlib pandas xarray tqdm scipy.sparse scipy.stats scipy.optimize symmb.show.cli".split()
LONGEST = 500
"""Lines of a file. Files of one thought may be long: they take less to read than fragments that call each other."""
FILES = sorted(path for path in ROOT.rglob("*.py") if "models" not in path.relative_to(ROOT).parts)


def unit(module: str) -> str:
    """The room that a dotted name belongs to, the file of the ground floor, or symmb itself."""
    _, *inner = module.split(".")
    depth = 2 if inner and WINGS.get(inner[0]) else 1
    return ".".join(inner[:depth]) or "symmb"


def module_name(path: Path) -> str:
    parts = ("symmb", *path.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(node: ast.Import | ast.ImportFrom, path: Path) -> Iterator[str]:
    """The dotted names of symmb's own modules that a statement imports."""
    if isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    else:
        base = node.module or ""
        if node.level:
            package = ("symmb", *path.relative_to(ROOT).parent.parts)
            base = ".".join([*package[: len(package) - node.level + 1], *filter(None, [base])])
        names = [f"{base}.{alias.name}" if is_module(f"{base}.{alias.name}") else base for alias in node.names]
    return (name for name in names if name.split(".")[0] == "symmb")


def is_module(name: str) -> bool:
    path = ROOT.parent.joinpath(*name.split("."))
    return path.is_dir() or path.with_suffix(".py").is_file()


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """The statements of a file, at any depth: expressions import nothing, and are most of its nodes."""
    found, left = list[ast.AST](), list[ast.AST]([ast.parse(path.read_text(encoding="utf-8"))])
    while left:
        found.append(node := left.pop())
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            left += getattr(node, part, ())
    return found


def imports(path: Path, *, with_types: bool = True) -> Iterator[tuple[int, str]]:
    """Line and name of the imports of symmb's own modules in a file, those for type checking on demand.

    What stands under `if TYPE_CHECKING` never runs, so it closes no circle.
    """
    for_types = {
        inner
        for node in nodes_of(path)
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in nodes_of(path):
        if isinstance(node, ast.Import | ast.ImportFrom) and (with_types or node not in for_types):
            yield from ((node.lineno, name) for name in imported(node, path))


def needs() -> dict[str, set[str]]:
    """The other units that each unit imports when it runs."""
    graph: dict[str, set[str]] = {}
    for path in FILES:
        own = unit(module_name(path))
        graph.setdefault(own, set()).update(unit(name) for _, name in imports(path, with_types=False))
    return {own: others - {own} for own, others in graph.items()}


def circle(graph: dict[str, set[str]]) -> list[str]:
    """A chain of units that ends where it starts; empty if there is none."""
    left = dict(graph)
    while free := [own for own, others in left.items() if not others & left.keys()]:
        for own in free:
            del left[own]
    if not left:
        return []
    chain = [next(iter(left))]
    while chain[-1] not in chain[:-1]:
        chain.append(next(iter(left[chain[-1]] & left.keys())))
    return chain


def test_every_unit_has_a_floor():
    assert {unit(module_name(path)) for path in FILES} <= FLOORS.keys() | WINGS.keys()


def test_wings_only_say_what_they_are():
    wings = [ROOT / wing / "__init__.py" for wing, rooms in WINGS.items() if wing and rooms]
    assert not [path for path in wings for node in ast.parse(path.read_text()).body if not isinstance(node, ast.Expr)]


def test_imports_go_down():
    upward = [
        f"{path}:{line}: {name}"
        for path in FILES
        for line, name in imports(path)
        if FLOORS[unit(name)] > FLOORS[unit(module_name(path))]
    ]
    assert not upward


def test_no_circles_between_units():
    assert not circle(needs())


def test_a_circle_would_be_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}})[-2:] in (["b", "c"], ["c", "b"])


def test_own_modules_are_imported_at_the_top():
    hidden = [
        f"{path}:{inner.lineno}: {name}"
        for path in FILES
        for outer in nodes_of(path)
        if isinstance(outer, ast.FunctionDef | ast.AsyncFunctionDef)
        for inner in ast.walk(outer)
        if isinstance(inner, ast.Import | ast.ImportFrom)
        for name in imported(inner, path)
    ]
    assert not hidden


def test_files_are_short():
    assert not [path for path in FILES if len(path.read_text(encoding="utf-8").splitlines()) > LONGEST]


def test_only_the_listed_imports_lead_up():
    for name, home in UPWARD.items():
        assert home.startswith("symmb.show.") and callable(getattr(importlib.import_module(home), name))
    by_name = {path.relative_to(ROOT).as_posix() for path in FILES if "import_module" in path.read_text("utf-8")}
    assert by_name == {
        "__init__.py",
        "_doors.py",
        "_options.py",
        "_presentation.py",
        "show/cli/__main__.py",
        "show/cli/scene_file.py",  # modules of users
    }


def modules_after(code: str) -> set[str]:
    """The modules that a fresh process has loaded after these statements."""
    code = f"import sys\n{code}\nprint(*sys.modules)"
    return {*subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()}


@pytest.mark.parametrize("names", ["", "[getattr(symmb, name) for name in symmb.__all__]"], ids=["none", "all"])
def test_import_is_lean(names):
    """Neither `import symmb` nor the first use of all its public names loads a heavy package."""
    assert not modules_after(f"import symmb\n{names}") & {*HEAVY}


PLAIN = "import symmb\nfrom symmb.models import {model}\nscene = {model}.scene()\nsymmb.simulate(scene)\n"
"""A first run, as in a notebook."""
NOT_FOR_A_RUN = """bound connect.executors connect.run_database declare.mechanics.actuator declare.mechanics.clutch
    declare.mechanics.flexible_body declare.mechanics.robots declare.structures equations.model.c_export
    equations.model.contact_equations equations.model.uncertainty_file prove results.files.formats results.plot.layout
    run.codegen.card run.integrate.registry run.linear run.simulation.sweep show study"""
NOT_FOR_BOUNDS = """bound.adaptive.oscillations bound.answers.contributions
    bound.answers.probabilities bound.answers.statistical bound.methods.optimization bound.methods.registry
    bound.methods.taylor_model prove.boxes prove.scene_problem"""
OF_OTHERS = "scipy numpy.f2py numpy.testing sympy matplotlib sqlite3 tomllib xml email importlib.metadata".split()


@pytest.mark.parametrize("model", ["double_pendulum", "four_bar"])
@pytest.mark.parametrize(
    "then, unneeded, most",
    [
        ("", NOT_FOR_A_RUN, 175),
        ("symmb.propagate(scene)", NOT_FOR_A_RUN.replace("bound ", "").replace(" prove ", " ") + NOT_FOR_BOUNDS, 255),
    ],
    ids=["run", "bounds"],
)
def test_a_first_answer_loads_what_its_scene_needs(model, then, unneeded, most):
    """A module takes 0.6 ms, most of it for dataclasses, so that all modules would take longer than the answer.

    The limits are a few modules above what the two scenes load. If a feature exceeds them, use its names as
    `room.Name`, so that the scenes with the feature load it; see `_doors`.
    """
    loaded = modules_after(PLAIN.format(model=model) + then)
    unneeded = [*OF_OTHERS, *(f"symmb.{name}" for name in unneeded.split())]
    opened = {f"symmb.{name}" for name in (*WINGS, *ROOMS)}  # doors cost little
    found = [name for name in loaded - opened if any(name == own or name.startswith(f"{own}.") for own in unneeded)]
    assert not found
    assert len([name for name in loaded if name.split(".")[0] == "symmb"]) <= most


def test_doors_list_names_of_their_rooms():
    """Each listed name exists, and stays what it is when its module, or a module with this name, is loaded."""
    for path in ROOT.rglob("__init__.pyi"):
        door = importlib.import_module(module_name(path.with_suffix(".py")))
        for name in door.__all__:
            value = getattr(door, name)
            assert not isinstance(value, ModuleType) and getattr(door, name) is value
            assert name in dir(door)


def room(module: str) -> str:
    """The folder that holds a module, as a dotted name: "symmb.study" for its modules and for itself."""
    return module if (ROOT.parent / module.replace(".", "/")).is_dir() else module.rpartition(".")[0]


def test_rooms_are_entered_by_their_door():
    """Other rooms import from a room's `__init__`, not from its modules; a room inside another sees the outer one."""
    past_the_door = [
        f"{path}:{node.lineno}: {node.module}"
        for path in FILES
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "symmb"
        if (target := room(node.module)) not in ("symmb", own := room(module_name(path)))
        if not f"{own}.".startswith(f"{target}.")
        if node.module != target
    ]
    assert not past_the_door


def test_private_names_stay_in_their_room():
    private = [
        f"{path}:{node.lineno}: {node.module}.{alias.name}"
        for path in FILES
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom) and node.module
        if room(node.module) not in ("symmb", room(module_name(path)))
        for alias in node.names
        if alias.name.startswith("_")
    ]
    assert not private


def test_no_circles_between_modules():
    graph: dict[str, set[str]] = {}
    for path in FILES:
        names = {name for _, name in imports(path)}
        graph[module_name(path)] = names - {module_name(path)}
    doors = {name for name in graph if (ROOT.parent / name.replace(".", "/")).is_dir()}
    assert not circle({name: others & (graph.keys() - doors) for name, others in graph.items() if name not in doors})


def test_files_of_tests_have_names_of_their_own():
    """pytest imports them without their folders."""
    names = sorted(path.name for path in Path(__file__).parent.rglob("test_*.py"))
    assert [name for name, following in itertools.pairwise(names) if name == following] == []


def test_nothing_strange_is_in_the_repository():
    """Runs that write into the checkout leave files that a commit would take up."""
    top = ROOT.parent
    if not (top / ".git").exists():
        pytest.skip("this is no checkout")
    files = subprocess.run(["git", "ls-files"], cwd=top, capture_output=True, text=True, check=True).stdout
    known = ".ci .github .gitignore CITATION.cff LICENSE README.md examples findings models pyproject.toml symmb tests"
    assert {name.split("/")[0] for name in files.splitlines()} <= {*known.split()}
