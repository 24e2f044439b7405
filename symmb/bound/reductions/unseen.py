"""Elements that act in a small part of the box, in which no run of a study was: a further study of this part.

A contact, a stop, a rope or the condition of a scalar output acts on one side of a switch. The distance that a run
keeps from a switch varies smoothly over the box, even where the outputs do not vary. If this distance may be 0
somewhere, local searches make runs there.
"""

from dataclasses import replace

import numpy as np

from symmb._errors import PropagationError
from symmb._names import counted
from symmb._types import Array
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method, PolynomialChaos, bounds_of
from symmb.bound.polynomials import TotalDegree, basis_values
from symmb.bound.reductions.absences import bounds_with_absences, with_never
from symmb.bound.reductions.hull import distance, hull_of
from symmb.bound.responses import RunsOverBox, parameter_columns, parameter_samples
from symmb.bound.searches import direct_search
from symmb.connect import Simulator, note_attained, run_blocks
from symmb.equations.model import Box
from symmb.run.simulation import FigureSimulator, SceneSimulator

_SLACK = 2.0
"""Factor of the largest residual of a polynomial. The polynomial of a distance may be too high by this product. Smaller
factors miss elements, larger factors cause more searches. tests/benchmarks/unseen_elements.py"""
_KNOWN, _HIGHEST = 1.5, 2
"""Number of runs, divided by the number of terms of a polynomial, from which on its residuals show how good it is.
Highest degree of these polynomials."""
_STARTS = 4
"""Number of runs closest to a switch from which a search starts."""
_LEAST_RUNS = 100
"""Number of runs of all searches after a small study. After other studies, it is the number of runs of the study."""
_ROOM, _LEAST_HALF = 1.3, 0.05
"""Size of the part of the box, over that of a box around all runs in which an element acts. Its least half width."""
_FEW = 0.25
"""Largest share of the runs of a study that reach a switch, if a search is necessary. If more runs reach it, the study
sees how outputs depend on its element."""


def bounds_with_unseen(method: Method, runs: RunsOverBox) -> Bounds:
    """Bounds by a method. `PolynomialChaos()` also looks for elements that act where none of its runs was."""
    found, simulator = bounds_with_absences(method, runs), runs.simulator
    if not isinstance(method, PolynomialChaos) or method.order is not None or found.attaining is None:
        return found
    if not isinstance(simulator, SceneSimulator) or not found.attaining.reach:
        return found
    own = runs.of(simulator.continued() if isinstance(simulator, FigureSimulator) else simulator)
    search = _Search(own, found)
    most = max(found.evaluations, _LEAST_RUNS)
    if method.budget is not None:
        most = min(most, method.budget - found.evaluations)
    try:
        seen = bounds_of(method, own, lambda _: search.extremes(most))
    except PropagationError:  # all runs of the search fail
        return found
    if not own.evaluations:
        return found
    parts = [found, _of_events(seen, found, own.simulator)]
    for box in search.parts():
        part = method
        if method.budget is not None:
            part = replace(method, budget=max(method.budget - sum(each.evaluations for each in parts), 1))
        try:
            parts.append(bounds_with_absences(part, runs.of(simulator, box)))
        except PropagationError as error:
            reason = str(error).splitlines()[0]
            told = f"In the part {box!r}, an element acts that does not act elsewhere. It has no bounds: {reason}"
            parts[0] = replace(found, run_doubts=(*found.run_doubts, told))
    return _joined(parts)


def _of_events(seen: Bounds, found: Bounds, simulator: Simulator) -> Bounds:
    """Extremes of further runs. If a condition never holds in a run, the run has no value of `value_at`."""
    if not isinstance(simulator, FigureSimulator):
        return seen
    seen = with_never(seen, simulator)
    columns = [seen.names.index(name) for name, end in simulator.ends.items() if end is None]
    lower, upper = np.array(seen.lower), np.array(seen.upper)
    lower[:, columns], upper[:, columns] = found.lower[:, columns], found.upper[:, columns]
    return replace(seen, lower=lower, upper=upper, inner=(lower, upper))


def _joined(parts: list[Bounds]) -> Bounds:
    """The bounds over the whole box, from its study, from further runs, and from studies of parts of the box."""
    whole, _, *others = parts
    remarks = [
        f"In the part {part.box!r}, an element acts that acts in none or few of the first "
        f"{counted(whole.evaluations, 'run')}. {counted(part.evaluations, 'further run')} bound this part."
        for part in others
    ]
    doubts = dict.fromkeys(doubt for part in parts for doubt in part.run_doubts)
    result = replace(hull_of(parts), run_doubts=tuple(doubts), remarks=(*whole.remarks, *remarks))
    if whole.surrogate is None:
        return result
    # The polynomials do not know the part. There they are wrong by up to the distance of its bounds from theirs.
    off = np.maximum(distance(whole.lower, result.lower), distance(result.upper, whole.upper))
    return replace(result, surrogate=whole.surrogate.changed(lambda own: own, np.maximum(whole.surrogate.error, off)))


class _Search:
    """Local searches for places where a run reaches a switch that no run or few runs of a study have reached.

    The distance of a run from a switch is positive on the side of the runs of the study, and negative if the run
    reaches the other side.
    """

    def __init__(self, runs: RunsOverBox, found: Bounds) -> None:
        self._runs, self._varied = runs, runs.box.radius > 0
        assert found.attaining is not None
        P, reach = (np.concatenate(each) for each in zip(*found.attaining.reach, strict=True))
        ok = np.isfinite(reach).all(axis=(1, 2))
        self._X = runs.box.to_unit(P[:, parameter_columns(runs.simulator, runs.box)])[ok][:, self._varied]
        self._sides = np.where((reach[ok][:, 0] > 0).mean(axis=0) > 0.5, 1.0, -1.0)
        self._distances = self._from(reach[ok])
        self._reached: list[Array] = []

    def _from(self, reach: Array) -> Array:
        """Distances (N, m) from the switches, by their reach (N, 2, m)."""
        return np.where(self._sides > 0, reach[:, 0], -reach[:, 1])

    def extremes(self, most: int) -> tuple[Array, Array, Array]:
        """Lowest and highest outputs (n_t, n_y) of at most about `most` runs of the searches, and their error, 0."""
        ends, runs = [np.full(self._runs.shape, np.inf), np.full(self._runs.shape, -np.inf)], self._runs
        for k in self._within_reach():
            known = list[tuple[Array, Array]]()

            def nearness(X: Array, k: int = k, known: list[tuple[Array, Array]] = known) -> Array:
                """The negative distance (N,) from switch k of the runs at points (N, d)."""
                points = np.zeros((len(X), len(self._varied)))
                points[:, self._varied] = X
                P = parameter_samples(runs.simulator, runs.box, points)
                ensemble = run_blocks(runs.simulator, P, runs.executor)
                runs.count(len(P))
                low, high = ensemble.extremes()
                note_attained(low, high, P)
                ends[:] = np.minimum(ends[0], low), np.maximum(ends[1], high)
                assert ensemble.reach is not None
                distances = self._from(ensemble.reach)[:, k]
                known.append((X, distances))
                return np.where(np.isfinite(distances), -distances, -np.inf)

            starts = np.vstack([self._X[np.argsort(self._distances[:, k])[:_STARTS]], self._lowest(k)])
            left = most - runs.evaluations
            if left <= 0:
                break
            best = direct_search(nearness, starts, left, -np.finfo(float).tiny)
            if best.value < 0:
                continue
            direct_search(nearness, best.place[None], most - runs.evaluations)
            X, distances = (np.concatenate(each) for each in zip(*known, strict=True))
            self._reached.append(X[distances <= 0])
        return ends[0], ends[1], np.zeros(runs.shape)

    def parts(self) -> list[Box]:
        """Parts of the box around the runs that reach a switch. Parts that overlap are one part."""
        parts = list[tuple[Array, Array]]()
        for X in self._reached:
            middle = (X.min(axis=0) + X.max(axis=0)) / 2
            half = np.maximum(_ROOM * np.ptp(X, axis=0) / 2, _LEAST_HALF)
            low, high = np.maximum(middle - half, -1.0), np.minimum(middle + half, 1.0)
            for k, (other_low, other_high) in enumerate(parts):
                if (np.maximum(low, other_low) < np.minimum(high, other_high)).all():
                    parts[k] = np.minimum(low, other_low), np.maximum(high, other_high)
                    break
            else:
                parts.append((low, high))
        return [self._box(*ends) for ends in parts]

    def _within_reach(self) -> list[int]:
        """Numbers of the switches that no run or few runs have reached, and that a run may reach, the closest first."""
        (N, d), y = self._X.shape, self._distances
        own = np.flatnonzero(((y <= 0).mean(axis=0) <= _FEW) & (np.ptp(y, axis=0) > 0)) if N else np.empty(0, dtype=int)
        for degree in range(1, _HIGHEST + 1):
            alpha = TotalDegree().indices(d, degree)
            if not own.size or N < _KNOWN * len(alpha):
                break
            V = basis_values(alpha, self._X)
            c = np.linalg.lstsq(V, y[:, own])[0]
            off = np.abs(V @ c - y[:, own]).max(axis=0)
            # Legendre polynomials are at most 1.
            lowest = np.minimum(c[0] - np.abs(c[1:]).sum(axis=0), y[:, own].min(axis=0))
            own = own[lowest <= _SLACK * off]
        return own[np.argsort(y[:, own].min(axis=0) / np.ptp(y[:, own], axis=0))].tolist() if own.size else []

    def _lowest(self, k: int) -> Array:
        """The corner (d,) at which a linear polynomial of the distance from switch k is lowest."""
        V = np.column_stack([np.ones(len(self._X)), self._X])
        slope = np.linalg.lstsq(V, self._distances[:, k])[0][1:]
        return np.where(slope > 0, -1.0, 1.0)

    def _box(self, low: Array, high: Array) -> Box:
        box, ends = self._runs.box, np.array([[-1.0], [1.0]]) * np.ones(len(self._varied))
        ends[:, self._varied] = low, high
        values = np.clip(box.from_unit(ends), box.lower, box.upper)
        pairs = dict(zip(box.names, map(tuple, values.T.tolist()), strict=True))
        units = dict(zip(box.names, box.units, strict=False))
        return Box(**{name: (*pair, units[name]) if units.get(name) else pair for name, pair in pairs.items()})
