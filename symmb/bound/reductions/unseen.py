"""Elements that act in a small part of the box, in which no run of a study was: a further study of this part.

A contact, a stop, a rope or the condition of a scalar output acts on one side of a switch. The distance that a run
keeps from a switch varies smoothly over the box, even where the outputs do not vary. If this distance may be 0
somewhere, local searches make runs there.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import cast

import casadi as ca
import numpy as np

from symmb._doubt import Doubt
from symmb._errors import PropagationError
from symmb._magnitudes import SAME
from symmb._names import counted
from symmb._types import Array
from symmb._units import typeset
from symmb.bound import nodes, reductions, searches
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method, PolynomialChaos, bounds_of
from symmb.bound.polynomials import TotalDegree, basis_values
from symmb.bound.polynomials.ranges import attained_extremes
from symmb.bound.reductions.absences import bounds_with_absences, with_never
from symmb.bound.responses import (
    DOUBTFUL,
    FINE,
    RunsOverBox,
    parameter_columns,
    parameter_samples,
    with_tolerance_remark,
)
from symmb.connect import Ensemble, Simulator, note_attained, run_blocks
from symmb.declare.symbolic import batch
from symmb.equations.model import Box
from symmb.run.formulations import FAR
from symmb.run.simulation import FigureSimulator, SceneSimulator

_SLACK = 2.0
"""Factor of the largest residual of a polynomial. The polynomial of a distance may be too high by this product. Smaller
factors miss elements, larger factors cause more searches. tests/benchmarks/unseen_elements.py"""
_KNOWN, _HIGHEST = 1.5, 2
"""Number of runs, divided by the number of terms of a polynomial, from which on its residuals show how good it is.
Highest degree of these polynomials."""
_STARTS = 4
"""Number of runs closest to a switch from which a search starts."""
_LEAST_RUNS, _FINDING = 60, 0.6
"""Number of runs of all searches after a small study, for each parameter. After other studies, it is the number of runs
of the study. Share of these runs after which a search ends if it has not found a run that reaches the switch."""
_RAYS = 0.5 ** np.arange(-1.0, 5.0)
"""Distances from the deepest place, along each axis, of runs that show where an element acts."""
_LOOKS = 4096
"""Number of places at which a condition of parameters is evaluated, which takes no runs, and of steps of its search."""
_SPREAD, _WIDER = 64, 2.0
"""Number of runs that are spread over a part, which is wider than that of earlier runs by a factor. They show where an
element acts far from the axes through the deepest place."""
_ROOM, _LEAST_HALF = 1.5, 0.05
"""Size of the part of the box, over that of a box around all runs in which an element acts. Its least half width."""
_MOST_OF_BOX = 0.5
"""Share of the box from which on a part has no study of its own."""
_FEW = 0.25
"""Largest share of the runs of a study that reach a switch, if a search is necessary. If more runs reach it, the study
sees how outputs depend on its element."""

_Nearness = Callable[[Array, Ensemble], Array]


def bounds_with_unseen(method: Method, runs: RunsOverBox) -> Bounds:
    """Bounds by a method. `PolynomialChaos()` also looks for elements that act where none of its runs was."""
    found, simulator = bounds_with_absences(method, runs), runs.simulator
    if not isinstance(method, PolynomialChaos) or method.order is not None or found.attaining is None:
        return found
    if not isinstance(simulator, SceneSimulator) or not found.attaining.reach:
        return found
    own = runs.of(simulator.continued() if isinstance(simulator, FigureSimulator) else simulator)
    search = _Search(own, found, simulator.parameter_switches)
    most = max(found.evaluations, _LEAST_RUNS * len(runs.box))
    if method.budget is not None:
        most = min(most, method.budget - found.evaluations)
    try:
        seen = bounds_of(method, own, lambda _: search.extremes(most))
    except PropagationError:  # all runs of the search fail
        return found
    if not own.evaluations:
        return found
    parts = [found, _of_events(seen, found, own.simulator)]
    told = list[str]()
    for box in search.parts():
        part, where = method, f"An element acts where {_words(box, runs.box)}. None or few of the first runs are there."
        if method.budget is not None:
            part = replace(method, budget=max(method.budget - sum(each.evaluations for each in parts), 1))
        try:
            parts.append(bounds_with_absences(part, runs.of(simulator, box)))
        except PropagationError:  # too few runs are left, or runs fail
            doubt = f"{where} No study of this part was possible, so the bounds contain only the runs of a search."
            parts[0] = replace(found, run_doubts=(*found.run_doubts, doubt))
        else:
            told.append(f"{where} {counted(parts[-1].evaluations, 'further run')} bound this part.")
    return _joined(parts, told, method.tolerance)


def _words(part: Box, box: Box) -> str:
    """The intervals of a part that are smaller than those of the box, in words."""
    units = dict(zip(box.names, box.units, strict=False))
    ends = zip(part.names, part.bounds, part.radius < 0.99 * box.radius, strict=True)
    own = [
        f"{name} is from {low:.5g} to {high:.5g} {typeset(units.get(name, ''))}".rstrip()
        for name, (low, high), is_smaller in ends
        if is_smaller
    ]
    return " and ".join(filter(None, [", ".join(own[:-1]), *own[-1:]]))


def _of_events(seen: Bounds, found: Bounds, simulator: Simulator) -> Bounds:
    """Extremes of further runs. If a condition never holds in a run, the run has no value of `value_at`."""
    if not isinstance(simulator, FigureSimulator):
        return seen
    seen = with_never(seen, simulator)
    columns = [seen.names.index(name) for name, end in simulator.ends.items() if end is None]
    lower, upper = np.array(seen.lower), np.array(seen.upper)
    lower[:, columns], upper[:, columns] = found.lower[:, columns], found.upper[:, columns]
    attaining = seen.attaining
    if attaining is not None and found.attaining is not None:
        own = found.attaining
        attaining = replace(attaining, others={k: own.others.get(k, replace(own, others={})) for k in columns})
    return replace(seen, lower=lower, upper=upper, inner=(lower, upper), attaining=attaining)


def _joined(parts: list[Bounds], remarks: list[str], tolerance: float) -> Bounds:
    """The bounds over the whole box, from its study, from further runs, and from studies of parts of the box."""
    whole, _, *others = parts
    studies = reductions.hull_of([whole, *others])
    doubts = dict.fromkeys(doubt for part in parts for doubt in part.run_doubts)
    result = replace(reductions.hull_of(parts), run_doubts=tuple(doubts), remarks=(*whole.remarks, *remarks))
    if result.estimate is not None:  # runs of the search beyond the studies show an error of these
        beyond = np.maximum(
            reductions.distance(studies.lower, result.lower), reductions.distance(result.upper, studies.upper)
        )
        beyond = np.where(np.isfinite(beyond), beyond, 0.0)
        error, width = np.maximum(result.estimate, beyond), reductions.distance(result.upper, result.lower)
        trace = result.trace and result.trace.decided(beyond > result.estimate, "beyond")
        result = replace(result, estimate=error, trace=trace)
        told = with_tolerance_remark(result.remarks, result.names, tolerance, error, width)
        result = replace(result, remarks=told)
        is_off = np.greater(beyond, DOUBTFUL * width).any(axis=0)
        if names := np.array(result.names)[is_off].tolist():
            text = f"Runs of a search are beyond the studies of {', '.join(names)}. Others may be as well."
            result = replace(result, run_doubts=(*result.run_doubts, Doubt(text, names)))
    if whole.surrogate is None:
        return result
    # The polynomials do not know the parts. If these change the bounds, the polynomials have no known error.
    off = np.maximum(reductions.distance(whole.lower, result.lower), reductions.distance(result.upper, whole.upper))
    off[np.isnan(off)] = np.inf  # the first study has no run with a value
    is_new = off > FINE * reductions.distance(result.upper, result.lower)
    surrogate = whole.surrogate.changed(
        lambda own: own, np.where(is_new, np.inf, np.maximum(whole.surrogate.error, off))
    )
    return replace(result, surrogate=surrogate)


class _Search:
    """Local searches for places where a run reaches a switch that no run or few runs of a study have reached.

    The distance of a run from a switch is positive on the side of the runs of the study, and negative if the run
    reaches the other side.
    """

    def __init__(self, runs: RunsOverBox, found: Bounds, conditions: ca.Function | None) -> None:
        self._runs, self._varied = runs, runs.box.radius > 0
        assert found.attaining is not None
        P, reach = (np.concatenate(each) for each in zip(*found.attaining.reach, strict=True))
        ok = np.isfinite(reach).all(axis=(1, 2))
        self._X = runs.box.to_unit(P[:, parameter_columns(runs.simulator, runs.box)])[ok][:, self._varied]
        self._conditions, self._n_conditions = conditions, 0 if conditions is None else conditions.numel_out(0)
        self._sides = np.where((reach[ok][:, 0] > 0).mean(axis=0) > 0.5, 1.0, -1.0)
        self._distances = self._from(reach[ok])
        self._reached: list[Array] = []
        self._known: list[tuple[Array, Array]] = []
        self._ends = np.full(runs.shape, np.inf), np.full(runs.shape, -np.inf)

    def _from(self, reach: Array) -> Array:
        """Distances (N, m) from the switches, by their reach (N, 2, m)."""
        return np.where(self._sides > 0, reach[:, 0], -reach[:, 1])

    def extremes(self, most: int) -> tuple[Array, Array, Array]:
        """Lowest and highest outputs (n_t, n_y) of at most `most` runs of the searches, and their error, 0."""
        for starts, of_runs, of_places in self._searches():
            self._known = []
            left = most - self._runs.evaluations
            if left <= 0:
                break
            if of_places is not None and not len(starts := self._met_without_runs(of_places, starts)):
                continue

            def nearness(X: Array, of_runs: _Nearness = of_runs) -> Array:
                return self._nearness(X, of_runs, most)

            if of_places is None:
                best = searches.direct_search(nearness, starts, int(_FINDING * left), -np.finfo(float).tiny)
                if best.value < 0:
                    continue
                if most > self._runs.evaluations:
                    best = searches.direct_search(
                        nearness, best.place[None], most - self._runs.evaluations - self._runs_around
                    )
                place = best.place
            else:
                place = starts[0]
                nearness(starts)
                if not len(self._acting()):  # all runs fail
                    continue
            axes = np.concatenate([np.eye(len(place)), -np.eye(len(place))])
            nearness(np.clip(place + (_RAYS[:, None, None] * axes).reshape(-1, len(place)), -1.0, 1.0))
            low, high = _around(self._acting(), _WIDER)
            nearness(low + (nodes.Sobol().points(_SPREAD, len(low), seed=0) + 1) / 2 * (high - low))
            self._reached.append(self._acting())
        return self._ends[0], self._ends[1], np.zeros(self._runs.shape)

    def _searches(self) -> Iterator[tuple[Array, "_Nearness", "Callable[[Array], Array] | None"]]:
        """Starts (n, d) of each search, and the nearness (N,) of points (N, d), 0 or positive where an element acts.

        It follows from the points and their ensemble, and for elements that parameters alone decide also from the
        points.
        """
        if self._conditions is not None and len(self._X):
            n, values_of_runs = self._n_conditions, self._by_parameters(self._X)[1]
            few = np.flatnonzero((self._distances[:, :n] <= 0).mean(axis=0) <= _FEW).tolist()
            ends = np.stack([values_of_runs.min(axis=0), values_of_runs.max(axis=0)])
            least = np.ptp(ends, axis=0) + SAME * np.abs(ends).max(axis=0) + np.finfo(float).tiny

            def beyond(X: Array, j: int, end: int) -> Array:  # values that are far from those of the study
                return (2 * end - 1) * (self._by_parameters(X)[1][:, j] - ends[end, j]) - least[j]

            def passed(X: Array, k: int) -> Array:
                return -self._sides[k] * self._by_parameters(X)[0][:, k]

            of_values = [partial(beyond, j=j, end=end) for j in range(values_of_runs.shape[1]) for end in (0, 1)]
            for of_places in (*of_values, *(partial(passed, k=k) for k in few)):
                nearest = np.argsort(-of_places(self._X), kind="stable")[:_STARTS]
                yield self._X[nearest], lambda X, _, of=of_places: of(X), of_places
        for k, place in self._within_reach():
            starts = np.vstack([place, self._X[np.argsort(self._distances[:, k])[:_STARTS]]])
            yield starts, lambda _, runs, k=k: -self._from(cast(Array, runs.reach))[:, k], None

    def _by_parameters(self, X: Array) -> list[Array]:
        """Margins (N, m) and values (N, k) of conditions of parameters at points X (N, d)."""
        assert self._conditions is not None
        margins, values = batch(self._conditions, self._samples(X))
        return [np.nan_to_num(own.reshape(len(X), -1), posinf=FAR, neginf=-FAR) for own in (margins, values)]

    def _acting(self) -> Array:
        """The places (n, d) of runs of the present search that reach the switch."""
        X, nearness = (np.concatenate(each) for each in zip(*self._known, strict=True))
        return X[nearness >= 0]

    @property
    def _runs_around(self) -> int:
        return 2 * len(_RAYS) * int(self._varied.sum()) + _SPREAD

    def _met_without_runs(self, nearness: Callable[[Array], Array], starts: Array) -> Array:
        """Places (n, d) where an element that parameters alone decide acts: the best one, and some others."""
        candidates = np.vstack([starts, nodes.Sobol().points(_LOOKS, starts.shape[1], seed=0)])
        values = nearness(candidates)
        best = searches.direct_search(nearness, candidates[np.argsort(-values, kind="stable")[:_STARTS]], _LOOKS)
        return np.vstack([best.place, candidates[values >= 0][:_SPREAD]])[: _SPREAD * (best.value >= 0)]

    def _samples(self, X: Array) -> Array:
        """The samples (N, n_p) of points X (N, d) of the parameters that vary."""
        points = np.zeros((len(X), len(self._varied)))
        points[:, self._varied] = X
        return parameter_samples(self._runs.simulator, self._runs.box, points)

    def _nearness(self, X: Array, of_runs: "_Nearness", most: int) -> Array:
        """The nearness (N,) of runs at points X (N, d); -inf for failed runs, and without runs left."""
        runs, result = self._runs, np.full(len(X), -np.inf)
        X = X[: most - runs.evaluations]
        if not len(X):
            return result
        P = self._samples(X)
        ensemble = run_blocks(runs.simulator, P, runs.executor)
        runs.count(len(P))
        low, high = ensemble.extremes()
        note_attained(low, high, P)
        self._ends = np.minimum(self._ends[0], low), np.maximum(self._ends[1], high)
        own = of_runs(X, ensemble)
        result[: len(X)] = np.where(ensemble.ok & np.isfinite(own), own, -np.inf)
        self._known.append((X, result[: len(X)]))
        return result

    def parts(self) -> list[Box]:
        """Parts of the box around the runs that reach a switch. Parts that overlap are one part.

        A part that is most of the box is left out, because its study would be that of the box.
        """
        parts = list[tuple[Array, Array]]()
        for X in self._reached:
            low, high = _around(X, _ROOM)
            for k, (other_low, other_high) in enumerate(parts):
                if (np.maximum(low, other_low) < np.minimum(high, other_high)).all():
                    parts[k] = np.minimum(low, other_low), np.maximum(high, other_high)
                    break
            else:
                parts.append((low, high))
        return [self._box(low, high) for low, high in parts if np.prod((high - low) / 2) < _MOST_OF_BOX]

    def _within_reach(self) -> list[tuple[int, Array]]:
        """Numbers of the switches that no run or few runs have reached, and that a run may reach, the closest first.

        With each number, the place (d,) at which a polynomial of the distance is lowest.
        """
        (N, d), y = self._X.shape, self._distances
        few = (y <= 0).mean(axis=0) <= _FEW if N else np.zeros(y.shape[1], dtype=bool)
        own = np.flatnonzero(few & (np.ptp(y, axis=0) > 0) & (np.arange(y.shape[1]) >= self._n_conditions))
        places = np.zeros((len(own), d))
        for degree in range(1, _HIGHEST + 1):
            alpha = TotalDegree().indices(d, degree)
            if not own.size or (degree > 1 and N < _KNOWN * len(alpha)):
                break
            V = basis_values(alpha, self._X)
            c = np.asarray(np.linalg.lstsq(V, y[:, own])[0], dtype=float)
            off = np.abs(V @ c - y[:, own]).max(axis=0)
            lowest, _, places, _ = attained_extremes(alpha, c)
            near = np.minimum(lowest, y[:, own].min(axis=0)) <= _SLACK * off
            near |= N < _KNOWN * len(alpha)
            own, places = own[near], places[near]
        order = np.argsort(y[:, own].min(axis=0, initial=np.inf) / np.ptp(y[:, own], axis=0)) if own.size else own
        return [(int(own[j]), places[j]) for j in order]

    def _box(self, low: Array, high: Array) -> Box:
        box, ends = self._runs.box, np.array([[-1.0], [1.0]]) * np.ones(len(self._varied))
        ends[:, self._varied] = low, high
        values = np.clip(box.from_unit(ends), box.lower, box.upper)
        pairs = dict(zip(box.names, map(tuple, values.T.tolist()), strict=True))
        units = dict(zip(box.names, box.units, strict=False))
        return Box(**{name: (*pair, units[name]) if units.get(name) else pair for name, pair in pairs.items()})


def _around(X: Array, factor: float) -> tuple[Array, Array]:
    """Ends (d,), (d,) of a part of the unit box around places (n, d), wider than their range by a factor."""
    middle = (X.min(axis=0) + X.max(axis=0)) / 2
    half = np.maximum(factor * np.ptp(X, axis=0) / 2, _LEAST_HALF)
    return np.maximum(middle - half, -1.0), np.minimum(middle + half, 1.0)
