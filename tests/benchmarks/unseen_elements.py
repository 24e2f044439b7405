"""Elements that act in 0.01 to 3 % of the box: what a default study says about them.

    PYTHONPATH=. python tests/benchmarks/unseen_elements.py [SEED] [CASES] [KIND ...]

An oscillator with four to ten uncertain parameters reaches a stop, a wall with impacts, a rope, a switch of its law, a
condition of its parameters, or the condition of a scalar output, in a small part of its box. For each element: cases,
silent errors (bounds, widened by the estimated error, miss more than 2 % of the width without a warning), warnings
about bounds that are right, and the median of runs. True ranges are those of random runs, corners, and runs around the
most extreme ones.
"""

import itertools
import sys
import warnings
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

import symmb as mb
from symmb.run.simulation import FigureSimulator, Subject

MISS = 0.02
KINDS = "stop", "impact", "rope", "law", "time", "value", "parameters"
_DRAWN = 4000


class Case(NamedTuple):
    """A scene, and the share of its box in which the element acts."""

    kind: str
    scene: mb.Scene
    share: float


def case(rng: np.random.Generator, kind: str) -> Case:
    """A random oscillator whose element acts in a small part of the box."""
    d, resonant = int(rng.integers(4, 13)), bool(rng.integers(2))
    alone = bool(rng.integers(2))
    nominal = {"mass": 1.0, "stiffness": 100.0, "speed": 1.0, "gap": 0.0, "damping": 1.0, "start": 0.0}
    nominal |= {"force": 0.5, "rate": rng.uniform(0.8, 1.2) * 10.0 if resonant else 3.0, "load": 1.0, "lag": 0.2}
    nominal |= {"push": 0.1, "pull": 0.1}
    spread = {"gap": 2e-3, "start": 1e-3, "lag": 0.05}
    nominal["speed"] = 0.1 if resonant else 1.0
    order = ["stiffness", "rate", "force", "damping", *nominal] if resonant else [*nominal]
    chosen = list(dict.fromkeys(order))[:d]
    widths = {n: spread.get(n, rng.uniform(0.01, 0.06) * nominal[n]) for n in chosen}  # half widths
    if resonant and "rate" in chosen:
        widths["rate"] = 0.15 * nominal["rate"]
    box = mb.Box(**{n: (nominal[n] - w, nominal[n] + w) for n, w in widths.items()})
    horizon, middle = 3.0 if resonant else 0.5, rng.uniform(-0.8, 0.8) if kind == "parameters" else 0.0

    def scene(level: float | None) -> mb.Scene:
        p = mb.Parameters(**nominal)
        ground, block = mb.Ground(), mb.Body("block", p.mass, 1.0)
        rail = mb.Prismatic("rail", ground.point(0, 0), block.point(0, 0), axis=(1, 0, 0))
        x, v = rail.displacement, rail.displacement_rate
        force = (
            p.force * ca.cos(p.rate * mb.t - p.lag) + 0.1 * p.load + p.push - p.pull - p.stiffness * x - p.damping * v
        )
        limit, elements, outputs = (0.0 if level is None else level) + p.gap, [], {"x": x, "v": v}
        among = sum((getattr(p, n) - nominal[n]) / widths[n] for n in chosen[: 1 + d % 3])
        if d % 2:  # a layer inside the box
            among = -ca.fabs(among - middle)
        if level is not None and kind == "stop":
            elements.append(mb.Stop("end", rail, upper=limit, law=mb.KelvinVoigt(10.0 ** rng.uniform(3, 5), 5.0)))
            outputs["blow"] = "end"
        elif level is not None and kind == "impact":
            elements.append(mb.Stop("end", rail, upper=limit, restitution=0.5))
        elif level is not None and kind == "rope":
            ends = [ground.point(-1.0, 0), block.point(0, 0)]
            elements.append(mb.Rope("rope", ends, 1e4, 1.0 + limit))
            outputs["pull"] = "rope"
        elif level is not None and kind == "law":
            force += ca.if_else(x > limit, -2e3 * (x - limit), 0.0)
        elif level is not None and kind == "parameters":
            force += ca.if_else(among > limit, 3.0, 0.0)
        elif level is not None:
            late = mb.first_time(x >= limit) if kind == "time" else mb.value_at(v, x >= limit)
            outputs = {"late": late, "reach": mb.maximum(x)}
        elements.append(mb.Actuator("spring", rail, force))
        system = mb.System(block, rail, *elements, parameters=p)
        outputs = {name: system.force(own) if isinstance(own, str) else own for name, own in outputs.items()}
        if alone and len(outputs) > 2:  # the force of the element, without the motion
            outputs = dict([list(outputs.items())[-1]])
        if level is None:
            outputs = {"beyond": (among if kind == "parameters" else x) - p.gap}
        start = {"rail.displacement": p.start, "rail.displacement_rate": p.speed}
        return mb.Scene(system, start, np.linspace(0.0, horizon, 201), outputs, box)

    reach = runs_of(scene(None))(rng.uniform(-1, 1, (_DRAWN, d))).max(axis=(1, 2))
    share = float(10.0 ** rng.uniform(-3.5, -1.5))
    top, whole = np.sort(reach)[-3:], float(np.ptp(reach))
    level = float(np.quantile(reach, 1 - share)) if share > 1e-3 else float(top[-1] + 0.02 * whole * rng.uniform())
    return Case(kind, scene(level), float((reach > level).mean()))


def runs_of(scene: mb.Scene) -> Callable[[np.ndarray], np.ndarray]:
    """A function of points (N, d) of the unit box with the outputs (N, n_t, n_y) of their runs."""
    simulator = Subject.of(scene).over(scene.box)[0]
    absent = isinstance(simulator, FigureSimulator) and [name for name, end in simulator.ends.items() if end is None]
    names = list(simulator.parameters)
    columns = [names.index(n) for n in scene.box.names]

    def values(X: np.ndarray) -> np.ndarray:
        P = np.tile(np.array(list(simulator.parameters.values())), (len(X), 1))
        P[:, columns] = scene.box.from_unit(X)
        if not absent:
            return simulator.run(P).Y
        Y = simulator.continued().run(P).Y
        Y[~simulator.continued([]).run(P).ok, :, [scene.output_names.index(name) for name in absent]] = np.nan
        return Y

    return values


def true_range(scene: mb.Scene, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest values (n_t, n_y). Scalar outputs that never come are infinite."""
    values, d = runs_of(scene), len(scene.box)
    corners = np.array([*itertools.product((-1.0, 1.0), repeat=d)])
    X = np.vstack([corners, rng.uniform(-1, 1, (_DRAWN, d))])
    low = high = None
    for scale in (0.3, 0.1, 0.03, 0.01, 0.0):
        Y = values(X)
        ends = np.fmin.reduce(Y, axis=0), np.fmax.reduce(Y, axis=0)
        low, high = ends if low is None else (np.fmin(low, ends[0]), np.fmax(high, ends[1]))
        if not scale:
            break
        lowest = np.where(np.isnan(Y), np.inf, Y).argmin(axis=0)
        highest = np.where(np.isnan(Y), -np.inf, Y).argmax(axis=0)
        best = np.unique(np.concatenate([lowest.ravel(), highest.ravel()]))
        near = np.repeat(X[rng.choice(best, min(40, len(best)), replace=False)], 25, axis=0)
        X = np.clip(near + scale * rng.normal(size=near.shape) * (rng.uniform(size=near.shape) < 0.5), -1, 1)
    assert low is not None and high is not None
    return low, high


def main(seed: int, number: int, kinds: list[str]) -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    print("element  cases  silent  needless  largest  runs")
    for kind in kinds or KINDS:
        silent, needless, counts = [], 0, []
        for k in range(number):
            rng = np.random.default_rng([seed, KINDS.index(kind), k])
            own = case(rng, kind)
            try:
                bounds = mb.propagate(own.scene)
            except mb.SymmbError as error:
                print(kind, k, "raised", str(error)[:150])
                continue
            low, high = true_range(own.scene, rng)
            if kind in ("time", "value"):  # the runs in which the condition holds
                never = bounds.upper[0, 0] == np.inf
                high[:, 0] = np.where(kind == "time" and never, np.inf, high[:, 0])
            inner = [np.where(np.isfinite(end), end, np.nan) for end in bounds.inner or (low, high)]
            low, high = np.fmin(low, inner[0]), np.fmax(high, inner[1])
            outer = [np.asarray(end) for end in bounds.outer]
            with np.errstate(invalid="ignore"):
                off = np.fmax(np.fmax(outer[0] - low, high - outer[1]), 0.0)
                wrong = np.fmax(np.abs(bounds.lower - low), np.abs(bounds.upper - high))
            width = np.where(np.isfinite(high - low), high - low, np.maximum(np.abs(low), 1e-9)).max(axis=0)
            width = np.where(width > 0, width, 1.0)
            missed, error = (float(np.nanmax(each / width)) for each in (off, wrong))
            counts.append(bounds.evaluations)
            if missed > MISS and not bounds.doubts:
                silent.append(missed)
                print(f"  {kind} {k}: d {len(own.scene.box)}, share {own.share:.4f}, missed {missed:.2f}", flush=True)
            needless += bool(bounds.doubts) and error <= MISS
        median = np.median(counts) if counts else 0
        print(
            f"{kind:7s}  {number:5d}  {len(silent):6d}  {needless:8d}  {max(silent, default=0):7.2f}  {median:4.0f}",
            flush=True,
        )


if __name__ == "__main__":
    numbers = [int(each) for each in sys.argv[1:3]]
    main(*numbers, *(0, 10)[len(numbers) :], sys.argv[3:])
