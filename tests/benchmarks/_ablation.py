"""The cases on which tuned numbers are judged: functions that cost milliseconds, with their ranges."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import _engineering
import _known_ranges
import numpy as np
from _directions import directions

import symmb as mb
from models import double_pendulum
from symmb._types import Array

MOST_PARAMETERS = 6
"""Most parameters of functions with one value: response surfaces of more, and of Genz's, take seconds."""


@dataclass(frozen=True, eq=False)
class Case:
    """A response (n_t, n_y) of parameters in a box, and its range: lower and upper (n_t, n_y)."""

    suite: str
    name: str
    f: Callable[..., Array]
    box: dict[str, tuple[float, float]]
    lower: Array
    upper: Array


def cases() -> Iterator[Case]:
    """Cases of few parameters, of many with one value, and of many with values over time, and the double pendulum."""
    for case in _known_ranges.cases(0):
        if case.d <= 3 or (case.d <= MOST_PARAMETERS and case.kind != "Genz"):
            yield _of_known(case)
    some = _engineering.cases(0), _engineering.monotone_series(0), directions(0, d=(4, 5))
    yield from map(_of_formula, itertools.chain(*some))
    yield _pendulum()


def _of_known(case: _known_ranges.Case) -> Case:
    def f(**p: float) -> Array:
        return case.f(np.array([list(p.values())]))[0][:, None]

    box = {f"x{i}": (-1.0, 1.0) for i in range(case.d)}
    return Case("few" if case.d <= 3 else "one", case.name, f, box, case.lower[:, None], case.upper[:, None])


def _of_formula(case: _engineering.Case) -> Case:
    def f(**p: float) -> Array:
        return np.broadcast_to(case.f(case.t, **p), case.t.shape)[:, None]

    return Case("many", case.name, f, case.box, case.lower[:, None], case.upper[:, None])


def _pendulum() -> Case:
    """The paper's double pendulum at 201 times, as an expansion of high order: a run of it takes milliseconds."""
    scene = double_pendulum.scene()
    bounds = mb.propagate(scene.with_times(scene.times[::5]), mb.PolynomialChaos(order=24))
    box, expansion = bounds.box, bounds.expansion
    assert box is not None and expansion is not None

    def f(**p: float) -> Array:
        return expansion.values(box.to_unit(np.array([list(p.values())])))[0]

    ends = dict(zip(box.names, box.bounds, strict=True))
    return Case("pendulum", "double pendulum", f, ends, bounds.lower, bounds.upper)
