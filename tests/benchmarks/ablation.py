"""What each tuned number of a package is worth: figures of bounds with the number halved and doubled.

    PYTHONPATH=. python tests/benchmarks/ablation.py [package] [names ...]

Numbers are those that names of modules and classes are given in the package, `bound/adaptive` unless another is
named. Parts of tuples are numbers of their own. Cases are in `_ablation.py`. Cases that call no function which reads a
number are not run for it. For each suite: all runs, the median and the largest error over the width, the median of the
estimate over the error, misses without a doubt, and doubts about bounds that are right. A row shows the figures that
change by more than SMALL.
"""

import ast
import importlib
import importlib.machinery
import multiprocessing
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

import numpy as np
from _ablation import Case, cases

import symmb

SMALL = 0.05
"""Share by which a figure changes that counts."""
MISS = 2e-2
"""Share of the width that counts as missed. Widths are root mean squares over time."""
FIGURES = "runs", "error", "largest", "ratio", "silent", "needless"
ROOT = Path(symmb.__file__).parent


class Number(NamedTuple):
    """A number that a name of a file is given, or the part of its tuple at a place."""

    path: Path
    name: str
    place: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.path.stem}.{self.name}{''.join(f'[{k}]' for k in self.place)}"


class Outcome(NamedTuple):
    """Runs, error of the bounds and of what `outer` misses, and estimate, over the width; whether there are doubts."""

    runs: int
    error: float
    missed: float
    estimate: float
    is_doubtful: bool


def numbers(package: str) -> Iterator[Number]:
    """The numbers of a package."""
    for path in sorted((ROOT / package).glob("*.py")):
        module = importlib.import_module(".".join(["symmb", *Path(package).parts, path.stem]))
        for name, _ in _assigned(ast.parse(path.read_text(encoding="utf-8"))):
            owner, _, own = name.rpartition(".")
            value = getattr(getattr(module, owner) if owner else module, own)
            yield from (Number(path, name, place) for place in _places(value))


def _assigned(tree: ast.Module) -> Iterator[tuple[str, ast.Assign]]:
    """Names that modules and classes give values, with their statements."""
    owners = [("", tree), *((f"{node.name}.", node) for node in tree.body if isinstance(node, ast.ClassDef))]
    for prefix, owner in owners:
        for node in owner.body:
            if isinstance(node, ast.Assign):
                target = node.targets[0]
                for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                    if isinstance(name, ast.Name):
                        yield prefix + name.id, node


def _places(value: Any) -> Iterator[tuple[int, ...]]:
    if isinstance(value, tuple):
        yield from ((k, *place) for k, part in enumerate(value) for place in _places(part))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield ()


def scaled_code(number: Number, factor: float) -> CodeType:
    """The code of a number's file with the number times a factor. Whole numbers stay whole, and positive."""
    tree = ast.parse(number.path.read_text(encoding="utf-8"))
    statement = next(node for name, node in _assigned(tree) if name == number.name)
    name = number.name.rpartition(".")[2]
    source = f"{name} = __import__('ablation').scaled({name}, {number.place}, {factor})"
    for owner in (tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))):
        if statement in owner.body:
            owner.body.insert(owner.body.index(statement) + 1, *ast.parse(source).body)
    return compile(ast.fix_missing_locations(tree), str(number.path), "exec")


def scaled(value: Any, place: tuple[int, ...], factor: float) -> Any:
    """A value, or a part of it, times a factor."""
    if place:
        first, *rest = place
        return tuple(scaled(part, tuple(rest), factor) if k == first else part for k, part in enumerate(value))
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def outcome_of(case: Case) -> Outcome:
    """Bounds of a case beside its range. They have time: figures do not depend on the machine."""
    mb = importlib.import_module("symmb")
    middle = {name: sum(ends) / 2 for name, ends in case.box.items()}
    n_t, n_y = case.lower.shape
    simulator = mb.FunctionSimulator(case.f, middle, np.arange(n_t, dtype=float), [f"y{k}" for k in range(n_y)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        bounds = mb.propagate(simulator, mb.PolynomialChaos(seconds=60.0), mb.Box(**case.box))
    error = np.maximum(np.abs(bounds.lower - case.lower), np.abs(bounds.upper - case.upper))
    missed = np.maximum(np.maximum(bounds.outer[0] - case.lower, case.upper - bounds.outer[1]), 0.0)
    width = _rms(case.upper - case.lower)
    error, missed, estimate = (float((_rms(each) / width).max()) for each in (error, missed, bounds.estimate))
    return Outcome(bounds.evaluations, error, missed, estimate, bool(bounds.doubts))


def _rms(a: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(a), axis=0))


def figures(some: list[Case], outcomes: list[Outcome]) -> dict[str, tuple[float, ...]]:
    """The figures of each suite."""
    by_suite = defaultdict(list[Outcome])
    for case, outcome in zip(some, outcomes, strict=True):
        by_suite[case.suite].append(outcome)
    table = {}
    for suite, own in by_suite.items():
        errors = np.array([max(o.error, 1e-6) for o in own])
        ratios = np.array([o.estimate for o in own]) / errors
        is_bad, doubtful = np.array([o.missed > MISS for o in own]), np.array([o.is_doubtful for o in own])
        silent, needless = (is_bad & ~doubtful).sum(), (doubtful & (errors <= MISS)).sum()
        runs = sum(o.runs for o in own)
        table[suite] = (runs, float(np.median(errors)), errors.max(), float(np.median(ratios)), silent, needless)
    return table


def changes(before: dict[str, tuple[float, ...]], after: dict[str, tuple[float, ...]]) -> str:
    """The figures that differ, in words."""
    told = []
    for suite, old in before.items():
        for k, (name, a, b) in enumerate(zip(FIGURES, old, after[suite], strict=True)):
            if k >= 4 and a != b:
                told.append(f"{suite} {name} {a:g} -> {b:g}")
            elif k < 4 and abs(b / a - 1) > SMALL:
                told.append(f"{suite} {name} {b / a - 1:+.0%}")
    return ", ".join(told) or "-"


def called_names(case: Case, package: str) -> tuple[Outcome, set[str]]:
    """The outcome of a case, and the names that functions of a package read in it."""
    codes = set[CodeType]()

    def note(frame: FrameType, event: str, argument: object) -> None:
        codes.add(frame.f_code)

    sys.setprofile(note)
    try:
        outcome = outcome_of(case)
    finally:
        sys.setprofile(None)
    own = (code for code in codes if Path(code.co_filename).parent == ROOT / package)
    return outcome, {name for code in own for name in code.co_names}


def readers(package: str) -> dict[str, set[str]]:
    """The names whose values depend on that of a name."""
    parts = defaultdict[str, set[str]](set)
    for path in (ROOT / package).glob("*.py"):
        for name, node in _assigned(ast.parse(path.read_text(encoding="utf-8"))):
            parts[name.rpartition(".")[2]] |= {each.id for each in ast.walk(node.value) if isinstance(each, ast.Name)}
    return {name: {name, *(other for other, used in parts.items() if name in used)} for name in parts}


def outcomes_with(number: Number, factor: float, some: list[Case]) -> list[Outcome] | str:
    """Outcomes with a number times a factor, in a process whose symmb is loaded anew; an error's text."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send_outcomes, args=(number, factor, some, sender))
    process.start()
    found = receiver.recv()
    process.join()
    return found


def _send_outcomes(number: Number, factor: float, some: list[Case], sender: Any) -> None:
    code, loader = scaled_code(number, factor), importlib.machinery.SourceFileLoader
    original = loader.get_code

    def get_code(self: importlib.machinery.SourceFileLoader, fullname: str) -> CodeType | None:
        return code if self.path == str(number.path) else original(self, fullname)

    loader.get_code = get_code
    for name in [name for name in sys.modules if name.split(".")[0] == "symmb"]:
        del sys.modules[name]
    try:
        sender.send([outcome_of(case) for case in some])
    except Exception as error:  # a number may have to be what it is
        sender.send(f"{type(error).__name__}: {error}".splitlines()[0])


def main(package: str, names: list[str]) -> None:
    """Print the table."""
    some = list(cases())
    for case in some:
        outcome_of(case)  # what is compiled once is not measured below
    base, read, seconds = [], [], time.perf_counter()
    for case in some:
        outcome, called = called_names(case, package)
        base.append(outcome)
        read.append(called)
    before, all_numbers = figures(some, base), list(numbers(package))
    print(f"{len(all_numbers)} numbers in {package}, {len(some)} cases in {time.perf_counter() - seconds:.0f} s")
    print(f"{'':12s}" + "".join(f"{name:>10s}" for name in FIGURES))
    for suite, row in before.items():
        print(f"{suite:12s}" + "".join(f"{figure:10.3g}" for figure in row), flush=True)
    depends = readers(package)
    for number in all_numbers:
        name = number.name.rpartition(".")[2]
        if names and name not in names:
            continue
        rows = [k for k, called in enumerate(read) if called & depends[name]]
        for factor in (0.5, 2.0):
            found = outcomes_with(number, factor, [some[k] for k in rows])
            told = found
            if not isinstance(found, str):
                after = base.copy()
                for k, outcome in zip(rows, found, strict=True):
                    after[k] = outcome
                told = changes(before, figures(some, after))
            print(f"{number!s:45s} x {factor:<4g}{len(rows):4d} cases  {told}", flush=True)


if __name__ == "__main__":
    sys.modules["ablation"] = sys.modules["__main__"]
    package, *names = sys.argv[1:] or ["bound/adaptive"]
    main(package, names)
