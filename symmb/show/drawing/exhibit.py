"""Contents of one picture: a run, the runs that attain bounds, and the region that a point reaches."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import NOTHING, SAME
from symmb._names import ByName
from symmb._options import require_name
from symmb._types import Array, Indices
from symmb._units import label, units_of_parameters, with_units
from symmb.bound.answers import Bounds, unit_suffix
from symmb.bound.nodes import grid
from symmb.bound.propagation import Study
from symmb.bound.responses import SIDES, Sample, parameter_samples, row_of
from symmb.declare.mechanics import Point
from symmb.equations.model import Box, require_only_intervals
from symmb.run.simulation import Subject, Sweep, Trajectory, simulate
from symmb.show.drawing.draw import draw
from symmb.show.drawing.shapes import Drawing

LOWER, UPPER = "#b3541e", "#5b3fa0"
"""Colours of the runs that attain the lower and the upper bound."""
_SAMPLES_PER_PARAMETER = 6
"""Number of samples of each parameter for the region of a point, if there are one or two parameters."""
_MOST_RUNS = 500
"""Largest number of runs of a page with sliders."""


@dataclass(frozen=True, eq=False)
class Ghost:
    """A run that attains a bound, beside the nominal run."""

    label: str
    tint: str
    drawing: Drawing


@dataclass(frozen=True, eq=False)
class Region:
    """The positions of a point for all parameters of the box: n samples (n_f, n, 3), and corners (3 m, 2) of triangles.
    The triangles cover the region in the xy plane, or only the paths of the samples if samples are far apart."""

    name: str
    points: Array
    sweep: Array


@dataclass(frozen=True, eq=False)
class PicturedBounds:
    """Bounds of the outputs at the times of the pictures, (n_f, n_y), and the selected output and time."""

    lower: Array
    upper: Array
    output: int
    time: float


@dataclass(frozen=True, eq=False)
class Slider:
    """A parameter with its unit, its values in the runs, and the number of the initial value."""

    name: str
    values: Array
    at: int


@dataclass(frozen=True, eq=False)
class Exhibit:
    """All contents of a page, a still or a film. `picture` is the initial picture.

    `family` contains the runs over the grid of sliders. The last slider changes fastest. `drawing` is one of the runs.
    """

    drawing: Drawing
    ghosts: tuple[Ghost, ...] = ()
    bounds: PicturedBounds | None = None
    region: Region | None = None
    picture: int = 0
    sliders: tuple[Slider, ...] = ()
    family: tuple[Drawing, ...] = ()


def of_run(run: Trajectory, time: float | str | None, point: Point | None) -> Exhibit:
    """Only one run, without bounds."""
    row = 0 if time is None else row_of("view", run.t, time)
    drawing = draw(run, also=[row, *_extremes(run.values, run.values)], point=point)
    return Exhibit(drawing, picture=_picture(drawing, run.t[row]))


def of_sweep(sweep: Sweep, time: float | str | None, point: Point | None) -> Exhibit:
    """The runs over a grid, and a slider for each parameter of the grid."""
    if sweep.simulator is None or not sweep.grid:
        raise DeclarationError(
            "view draws sweeps over a grid of a scene's parameters: sweep(scene, {name: values}). This sweep "
            + ("has no grid." if sweep.simulator else "has no scene: it has another simulator, or is from a file.")
        )
    if not sweep.ok.all() or len(sweep) > _MOST_RUNS:
        why = f"has {len(sweep)} runs." if sweep.ok.all() else f"has failed runs. {sweep.doubts[0]}"
        raise DeclarationError(f"view draws sweeps of up to {_MOST_RUNS} runs that did not fail. This sweep {why}")
    nominal, units = sweep.simulator.parameters, units_of_parameters(sweep.parameters)
    sliders = tuple(
        Slider(label(name, units.get(name, "")), values, int(np.abs(values - nominal[name]).argmin()))
        for name, values in sweep.grid.items()
    )
    box = Box(**{name: (values.min(), values.max()) for name, values in sweep.grid.items()})
    samples = [Sample(np.nan, p[None], 0) for p in np.stack([*sweep.parameters.values()], axis=1)]
    runs = attaining_runs(Study(sweep.simulator, box), samples)
    row = 0 if time is None else row_of("view", sweep.t, time)
    most = max(20_000 // len(runs), 101)  # pictures of a run, for a page of about 10 MB
    family = tuple(draw(run, also=[row], point=point, most=most) for run in runs)
    drawing = family[int(np.ravel_multi_index([s.at for s in sliders], [len(s.values) for s in sliders]))]
    return Exhibit(drawing, picture=_picture(drawing, runs[0].t[row]), sliders=sliders, family=family)


def of_bounds(bounds: Bounds, output: str | None, time: float | str | None, point: Point | None) -> Exhibit:
    """The nominal run, the runs that attain the bounds of an output at a time, and the region of a point."""
    study = bounds.study
    if not isinstance(study, Study):
        if bounds.box is not None:
            require_only_intervals("draw", bounds.box)
        raise DeclarationError(
            "These bounds have no scene: they were read from a file. Draw the result of propagate(scene, method)."
        )
    scene = study.scene
    if output is not None:
        require_name("view", "output", output, bounds.names)
    column = bounds.names.index(output) if output else _widest(bounds)
    name, width = bounds.names[column], bounds.upper[:, column] - bounds.lower[:, column]
    times = scene.times if name in bounds.figures else bounds.t  # a scalar output has the same bounds at all times
    widest = len(times) // 2 if name in bounds.figures else int(width.argmax())
    at = widest if time is None else row_of("view", times, time)
    row, t = min(at, len(bounds.t) - 1), float(times[at])
    value_of = name if name in bounds.figures else f"{name}({t:g} s)"
    if bounds.attaining is None:
        raise DeclarationError(
            f"{bounds.method} stores no runs that attain its bounds, so view cannot draw such runs. "
            "Use PolynomialChaos() or Vertex()."
        )
    samples = bounds.attaining.samples([(side, row, column) for side in SIDES])
    middle = Sample(np.nan, np.array([[*study.simulator.parameters.values()]]), 0)
    nominal, lowest, highest = attaining_runs(study, [middle, *samples])
    if not np.isfinite(nominal.x).all():
        nominal = simulate(scene, study.solver)  # this call raises the reason
    also = [at, *_extremes(bounds.lower, bounds.upper)]
    drawing = draw(nominal, also=also)

    acting, unit = bounds._acting(study.box, [column]), unit_suffix(bounds, column)

    def value(run: Trajectory, bound: float) -> str:
        attained, of_bound = f"{run.values[row, column]:.6g}{unit}", f"{bound:.6g}{unit}"
        return attained if attained == of_bound else f"{attained} (bound {of_bound})"

    ghosts = [
        Ghost(f"{side} {value_of} = {value(run, bound)}{_place(run, acting)}", tint, draw(run, also=also))
        for side, tint, run, bound in (
            ("lowest", LOWER, lowest, bounds.lower[row, column]),
            ("highest", UPPER, highest, bounds.upper[row, column]),
        )
    ]
    rows = np.minimum(np.searchsorted(bounds.t, drawing.t), len(bounds.t) - 1)  # scalar outputs have one time
    return Exhibit(
        drawing,
        tuple(ghosts),
        PicturedBounds(bounds.lower[rows], bounds.upper[rows], column, t),
        None if point is None else _region(study, point, drawing),
        _picture(drawing, t),
    )


def attaining_runs(study: Study, samples: Sequence[Sample]) -> list[Trajectory]:
    """The exactly repeated runs of samples. They contain all states, but neither work nor events.

    Studies store only the outputs of the scene, so states are outputs of a second simulator. All runs use the same
    simulator, because a large model takes half a minute to compile.
    """
    scene, solver = study.scene, study.solver
    system = scene.system
    states = ca.vertsplit(ca.vertcat(system.q, system.v, system.s))
    named = {f"x{i}": x for i, x in enumerate(states)}
    simulator = Subject(scene.with_outputs(named or {"t": 0.0}), solver).motion
    runs = []
    for sample in samples:
        x = simulator.run(sample.P).Y[sample.index][:, : len(states)]
        own = study.simulator.parameters
        values = ByName(zip(own, sample.P[sample.index].tolist(), strict=True), units_of_parameters(own))
        unknown, rest = np.full(len(x), np.nan), ({}, np.nan, np.nan)
        known = Trajectory(scene, study.prepared.program, values, repr(solver), "", simulator.times, x, unknown, *rest)
        if scene.figures:
            columns = [study.simulator.outputs.index(name) for name in scene.figures]
            y = study.simulator.run(sample.P).Y[sample.index][0, columns]
            known = replace(known, figures=dict(zip(scene.figures, y.tolist(), strict=True)))
        runs.append(known)
    return runs


def _region(study: Study, point: Point, drawing: Drawing) -> Region:
    """Positions of a point for samples of the box, and the area that the point covers over time."""
    scene = study.scene.with_outputs({"x": point.x, "y": point.y, "z": point.z})
    simulator = Subject(scene, study.solver).motion
    d = len(study.box)
    unit = grid(np.linspace(-1, 1, _SAMPLES_PER_PARAMETER), d) if d <= 2 else _many(d)
    ensemble = simulator.run(parameter_samples(simulator, study.box, unit))
    ways = ensemble.Y.transpose(1, 0, 2)
    points = ways[np.searchsorted(simulator.times, drawing.t)]
    corners = _cells(unit) if d <= 2 else [np.arange(len(unit))]
    scales = 0.05 * drawing.size, 0.5 * drawing.unit
    sweep = _swept(ways[:, :, :2], corners, *scales) if drawing.planar else np.zeros((0, 2))
    return Region(f"{points.shape[1]} samples of the box", points[:, ensemble.ok], sweep)


def _many(d: int, n: int = 64) -> Array:
    """Samples of a box with many parameters: n random corners, and n random points inside."""
    random = np.random.default_rng(0)
    return np.vstack([random.choice([-1.0, 1.0], (n, d)), random.uniform(-1, 1, (n, d))])


def _cells(unit: Array) -> list[Indices]:
    """Indices of the samples at the corners of each cell of the grid."""
    step = 2 / (_SAMPLES_PER_PARAMETER - 1) * (1 + SAME)
    lower = [k for k in range(len(unit)) if (unit[k] < 1 - SAME).all()]
    return [np.flatnonzero(((unit >= unit[k] - SAME) & (unit <= unit[k] + step)).all(axis=1)) for k in lower]


def _swept(points: Array, cells: Sequence[Indices], close: float, side: float, spans: int = 150) -> Array:
    """Corners (3 m, 2) of m triangles that cover the sweep of the cells of samples (n_t, n, 2) over time.

    The time is divided into spans. If the extent of a cell in a span is at most `close` [m], its convex hull is
    covered. A larger hull may contain places that no parameters reach, such as the inside of a circular path. The path
    of each sample is then covered, with the width `side` [m].
    """
    triangles, ways = [np.zeros((0, 2))], []
    rows = np.unique(np.linspace(0, len(points) - 1, spans).astype(int))
    for before, after in pairwise(rows.tolist()):
        for cell in cells:
            reached = points[before : after + 1][:, cell]
            reached = reached[:, np.isfinite(reached).all(axis=(0, 2))]
            places = reached.reshape(-1, 2)
            if len(places) and np.ptp(places, axis=0).max() > close:
                ways.append(np.stack([reached[:-1], reached[1:]], axis=2).reshape(-1, 2, 2))
                continue
            corners = convex_hull(places)
            for i in range(1, len(corners) - 1):
                triangles.append(corners[[0, i, i + 1]])
    return np.vstack([*triangles, _squares(np.vstack(ways), side)] if ways else triangles)


def _squares(ways: Array, side: float) -> Array:
    """Corners (3 m, 2) of triangles that cover straight paths (n, 2, 2). Squares cover a path, and are then merged."""
    begin, along = ways[:, 0], ways[:, 1] - ways[:, 0]
    count = int(np.ceil(np.abs(along).max() / side)) + 1
    cells = np.zeros((0, 2), dtype=int)
    for share in np.linspace(0, 1, count + 1):
        cells = np.unique(np.vstack([cells, np.floor((begin + share * along) / side).astype(int)]), axis=0)
    cuts = np.flatnonzero((np.diff(cells[:, 0]) != 0) | (np.diff(cells[:, 1]) != 1)) + 1
    low, high = side * cells[[0, *cuts]], side * (cells[[*(cuts - 1), -1]] + 1)
    corners = [low, np.stack([high[:, 0], low[:, 1]], axis=1), high, np.stack([low[:, 0], high[:, 1]], axis=1)]
    return np.stack([corners[k] for k in (0, 1, 2, 0, 2, 3)], axis=1).reshape(-1, 2)


def convex_hull(points: Array) -> Array:
    """Corners (m, 2) of the convex hull of points (n, 2) in the plane, anticlockwise (Andrew's monotone chain)."""
    order = sorted(set(map(tuple, points.tolist())))
    if len(order) < 3:
        return np.array(order)
    halves = []
    for ordered in (order, order[::-1]):
        chain: list[tuple[float, float]] = []
        for p in ordered:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        halves += chain[:-1]
    return np.array(halves)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _widest(bounds: Bounds) -> int:
    """The output with the largest width relative to its range."""
    width = (bounds.upper - bounds.lower).max(axis=0)
    extent = bounds.upper.max(axis=0) - bounds.lower.min(axis=0)
    return int(np.argmax(width / np.maximum(extent, NOTHING)))


def _extremes(lower: Array, upper: Array) -> list[int]:
    """Numbers of the times at which outputs (n_t, n_y) are lowest or highest. The page prints these values."""
    return [*lower.argmin(axis=0).tolist(), *upper.argmax(axis=0).tolist()]


def _picture(drawing: Drawing, time: float) -> int:
    return int(np.abs(drawing.t - time).argmin())


def _place(run: Trajectory, names: Sequence[str]) -> str:
    values = ", ".join(with_units({name: f"{run.parameters[name]:.4g}" for name in names}, run.parameters))
    return f" at {values}" if values else ""
