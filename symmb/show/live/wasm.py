"""The WebAssembly module of a live page: the runs of a scene, and the bounds of its outputs, in compiled C."""

import itertools
from collections.abc import Sequence
from functools import cache
from importlib.resources import files as resources

from symmb._progress import Progress
from symmb.bound.nodes import Grid, line
from symmb.bound.polynomials.ranges import Exact, range_tables
from symmb.run.codegen import SceneSource, c_source, c_tables, quoted, scene_source, web_module
from symmb.run.simulation import FigureSimulator, never_holds

MOST_VARIED = 8
"""Largest number of parameters with tolerances at the same time. More parameters take too many runs for a page."""
_MOST_NODES = 400
"""Largest number of nodes of a level."""
_DEGREES = 0, 2, 4, 8
"""Degrees of one parameter in the levels. The nodes of each level contain the nodes of the level before."""
_TENSORS = 3
"""Up to this number of parameters, levels are tensor grids if these are small. Sparse grids have fewer nodes."""


def module(n: int, source: SceneSource | None = None, figures: FigureSimulator | None = None) -> bytes:
    """The module for n parameters: bounds, the runs of a scene if `source` is given, and scalar outputs.

    With `figures`, the last outputs of the scene are the curves of the scalar outputs.

    Raises
    ------
    NoCompilerError        if the package ziglang is not installed
    """
    grids = list(itertools.chain(*levels(n)))
    headers, ranges = _tables(grids)
    names = ["kernel.c", "ranges.c", "runs.c"]
    own = {name: (resources("symmb.show.live") / name).read_text(encoding="utf-8") for name in names}
    search = "\n".join(f"#define {name.upper()} {value!r}" for name, value in vars(Exact()).items())
    files = {"levels.h": headers, "kernel.c": "\n".join([c_source("lanes", "tensor_fit"), own["kernel.c"]])}
    files["ranges.c"] = "\n".join([c_source("polynomial_ranges"), search, own["ranges.c"], ranges])
    if source is None:
        names.remove("runs.c")
    else:
        files |= scene_source(source) | {"rules.h": _rules(figures, source.lanes.f.numel_out("outputs"))}
        files["runs.c"] = own["runs.c"]
    with Progress("live page: compiling; the first page on a machine takes half a minute"):
        return web_module(files, names, "A live page")


@cache
def levels(n: int) -> list[list[Grid]]:
    """The nodes of each level, for one varied parameter, for two, and so on up to n of them."""
    return [_levels(d) for d in range(1, min(n, MOST_VARIED) + 1)]


def _levels(d: int) -> list[Grid]:
    """Levels of d parameters: tensor grids for a few parameters, otherwise sparse grids (Smolyak 1963)."""
    found, grid = list[Grid](), Grid(d)
    for level in range(1, len(_DEGREES)):
        degree, low = _DEGREES[level], _DEGREES[1]
        if d <= _TENSORS and (degree + 1) ** d <= _MOST_NODES:
            largest = [(degree,) * d]
        elif d <= _TENSORS:  # each parameter has the highest degree, but not several of them in one term
            largest = [tuple(degree if k == one else low for k in range(d)) for one in range(d)]
        else:
            several = itertools.combinations_with_replacement(range(d), level)
            largest = [tuple(_DEGREES[axes.count(k)] for k in range(d)) for axes in several]
        new = grid.missing(largest)
        if d > _TENSORS and len(grid.row) + len(new) > _MOST_NODES:
            break
        grid = grid.grown(new)
        found.append(grid)
    return found


def _rules(figures: FigureSimulator | None, n: int) -> str:
    """The rules of scalar outputs in C. The last of all n outputs are the curves of the rules."""
    if figures is None:
        return "#define N_RULES 0"
    rules = figures.rules
    parts = len({k for rule in rules for k in (rule.expression, rule.margin) if k >= 0})
    own = len(figures.curves.outputs) - parts
    rows = [
        f"{{{r.kind.upper()}, {max(r.expression - own, 0)}, {max(r.margin - own, 0)}, {int(r.is_strict)}, "
        f"{figures.outputs.index(r.name)}, {r.window[0]!r}, {r.window[1]!r}, {r.per_second!r}}}"
        for r in rules
    ]
    faults = [quoted(never_holds(r.name)) for r in rules]
    return "\n".join(
        [
            f"#define N_RULES {len(rules)}",
            f"enum {{ N_CURVES = {parts}, FIRST_CURVE = {n - parts} }};",
            f"static const Rule rules[] = {{{', '.join(rows)}}};",
            f"static const double least_sizes[] = {{{', '.join(map(repr, figures.rounding[own:].tolist()))}}};",
            f"static const char *const missing[] = {{{', '.join(faults)}}};",
        ]
    )


def _tables(grids: Sequence[Grid]) -> tuple[str, str]:
    """The tables of all levels in C: those of kernel.c, and those of ranges.c."""
    lines, others, rows = list[str](), list[str](), list[str]()
    for i, grid in enumerate(grids):
        tables, given = range_tables(grid.alpha)
        others.append(c_tables("Basis", f"own_{i}", tables))
        others.append(f"const void *const basis_{i} = &own_{i};")
        for name, numbers in (("degrees", grid.alpha), ("given", given)):
            lines.append(f"static const int {name}_{i}[] = {{{','.join(map(str, numbers.ravel().tolist()))}}};")
        lines.append(c_tables("Tensors", f"fit_{i}", grid.tables()))
        lines.append(f"extern const void *const basis_{i};")
        rows.append(f"{{{grid.d}, {len(grid.row)}, degrees_{i}, &fit_{i}, &basis_{i}, given_{i}}}")
    nodes = ",".join(map(repr, line(_DEGREES[-1] + 1).tolist()))
    lines.append(f"static const double line[] = {{{nodes}}};")
    lines.append(f"static const Level levels[] = {{{', '.join(rows)}}};")
    return "\n".join(lines), "\n".join(others)
