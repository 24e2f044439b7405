"""`live`: a page in which a reader changes parameters and tolerances."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._units import typeset, units_of_parameters
from symmb.bound.answers import Limits, limit_pairs
from symmb.bound.methods import possible_values
from symmb.equations.model import Scene, require_only_intervals
from symmb.results.plot import labels
from symmb.run.simulation import DAESimulator, FigureSimulator, Subject, motion_of, scene_of, simulate
from symmb.show.drawing import Page, surveyed
from symmb.show.exchange import exported
from symmb.show.live.live_page import json_number, page_data, require_page, written
from symmb.show.live.wasm import module


@kept_interrupts()
def live(scene: Scene | DAESimulator, path: str | Path | None = None, limits: Limits | None = None) -> Page | None:
    """Write a page with a slider for each parameter and its tolerance. The page computes runs, bounds and limits.

    The page is one HTML file. It needs neither a network nor Python: it contains the C code of the scene, compiled to
    WebAssembly by the package ziglang. After each change, the page runs the scene, and then computes bounds of its
    outputs from runs at more and more nodes, as ``PolynomialChaos(order=...)``. Up to eight parameters may have
    tolerances at the same time.

    Parameters
    ----------
    scene : Scene
        a scene with a box, or a prepared scene. The middle of the box is the first value of its parameters
    path : str or Path
        .html; default: a page that a notebook shows below its cell
    limits : dict
        limits (low, high) of outputs, as for ``Bounds.check``; one end may be None. The page shows their margins

    Returns
    -------
    Page or None
        the page if no path is given. Its `text` is HTML

    Raises
    ------
    DeclarationError
        If the scene has no box, if a part of the scene needs Python, or if a limit is not valid
    NoCompilerError
        If the package ziglang is not installed

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(g=9.81)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> system = mb.System(ball, mb.Gravity(0, -p.g), parameters=p)
    >>> fall = mb.Scene(system, times=[0.0, 0.5, 1.0], box=mb.Box(g=(9.0, 10.0)))
    >>> mb.live(fall, "fall.html", {"ball.y": (-6.0, None)})  # doctest: +SKIP
    """
    return live_from(scene, path, limits)


def live_from(
    scene: Scene | DAESimulator, path: str | Path | None = None, limits: Limits | None = None, source: str = ""
) -> Page | None:
    """Write a page as `live`. `source` are lines of Python that define the scene, if they are known."""
    require_page(path)
    own = scene_of(scene)
    if own.box is None:
        raise DeclarationError("live: the scene has no box of tolerances. Give it one by scene.with_box(Box(...)).")
    require_only_intervals("live", own.box)
    pairs = limit_pairs("live", limits, own.output_names, own.units, needed=False)
    simulator = Subject.of(scene).simulator
    figures, motion = simulator if isinstance(simulator, FigureSimulator) else None, motion_of(simulator)
    others = [name for name, f in own.figures.items() if f.kind in ("rms", "percentile", "psd", "probability")]
    if motion is None or others:
        which = ", ".join(map(repr, others or own.figures))
        raise DeclarationError(f"live: a page cannot compute {which}. Remove random inputs, rms, psd and the like.")
    drawing, survey, rows = surveyed(simulate(motion))
    driven = tuple(survey.driven(drawing.shapes))
    columns = ca.vertsplit(ca.vertcat(ca.SX(0, 1), *(one.expression for one in driven)))
    curves = dict(zip(motion.outputs, ca.vertsplit(own.curves.y), strict=True))
    outputs = {name: curves.pop(name, ca.SX(0)) for name in own.output_names}  # the page computes scalar outputs
    outputs |= {f"drawing {k} of {own.name}": column for k, column in enumerate(columns)} | curves
    model = exported(Subject(motion.scene.with_outputs(outputs), motion.solver).motion)
    drawing = replace(drawing, outputs=labels(own.output_names, own.units), values=np.zeros((1, len(own.output_names))))
    names, nominal = list(own.system.parameters), model.source.nominal.tolist()
    units, known = units_of_parameters(own.system.parameters), _possible(motion)
    box = own.box.with_units(units)
    values = dict(zip(names, nominal, strict=False)) | dict(zip(box.names, box.center.tolist(), strict=True))
    tolerances = dict(zip(box.names, box.radius.tolist(), strict=True))
    parameters = [
        _parameter(name, typeset(units.get(name, "")), values[name], tolerances.get(name, 0.0), name in box.percents)
        for name in names
    ]
    wasm = module(len(names), model.source, figures)
    data = page_data(own.output_names, own.units, own.figures, pairs, parameters, motion.times, wasm) | {
        "inputs": nominal[len(names) :],
        "source": source,
        "n_out": len(own.output_names) + len(columns),
        "pictures": rows.tolist(),
        "possible": [known.get(name, [None, None]) for name in own.output_names],
    }
    return written(drawing, driven, data, path)


def _possible(simulator: DAESimulator) -> dict[str, list[float | None]]:
    """Smallest and largest possible value of each output for all parameters, such as 0 for a gap; None if unknown."""
    low, high = possible_values(simulator, None)
    ends = zip(low.min(axis=0), high.max(axis=0), strict=True)
    return {name: [json_number(end) for end in pair] for name, pair in zip(simulator.outputs, ends, strict=True)}


def _parameter(name: str, unit: str, value: float, tolerance: float, in_percent: bool) -> dict[str, Any]:
    """A parameter with the ends of its sliders. A value keeps its sign."""
    reach = max(4 * tolerance, abs(value) / 2) or 1.0
    low, high = value - reach, value + reach
    if value:
        low, high = (max(low, value / 10), high) if value > 0 else (low, min(high, value / 10))
    most = max(4 * tolerance, abs(value) / 5) or 1.0
    ends = {"low": low, "high": high, "most": most, "in_percent": in_percent}
    return {"name": name, "unit": unit, "value": value, "tolerance": tolerance, **ends}
