"""A thousand random mechanisms by the solver that symmb chooses, beside SciPy.

Most have a switch that acts for less than a tenth of a step, many have redundant rows, joint angles beyond pi, or
units from 1e-6 to 1e6. The reference is SciPy on the same equations, split at the switches (`_reference`). A scene is
drawn anew if SciPy at two tolerances does not agree with itself, so that chaos does not count as a fault of symmb.

A run is wrong if its error is above TOLERANCE and nobody says so. With `blind`, symmb does not see the switches: the
runs that are then wrong show what the benchmark detects.

    PYTHONPATH=. python tests/benchmarks/random_scenes.py [number] [seed] [first] [blind]
"""

import os
import sys
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module

import casadi as ca
import numpy as np
from _drawing import Mechanism, Units
from _isolated import outcomes
from _random_scenes import draw
from _random_switches import Switch, place
from _reference import Motion, Reference, UnusableError

import symmb as mb
from symmb._types import Array

TOLERANCE = 1e-5
"""Errors over the size of an output. Default tolerances are 1e-8 a step and below."""
FINE, COARSE, AGREEMENT = 1e-12, 1e-9, 1e-6
"""Tolerances of the reference, and how far the motions at both may lie apart."""
SLOW, HUNG = 30.0, 300.0
"""Seconds of processors, compilers included, that are too many for a run; and seconds of a run with its reference after
which it is ended."""
OUTPUTS = 41
"""Output times."""
SHORT = 0.1
"""Share of a default step below which an act of a switch is short."""


@dataclass(frozen=True)
class Case:
    """A scene with its reference."""

    scene: mb.Scene
    mechanism: Mechanism
    switches: tuple[Switch, ...]
    sizes: Array
    motion: Motion

    @property
    def shortest(self) -> float:
        """The shortest time between two switches, over the span; inf if there are none."""
        times = self.motion.passes
        return float(np.diff(times).min() / self.mechanism.span) if len(times) > 1 else np.inf


@dataclass(frozen=True)
class Verdict:
    """What became of a scene."""

    number: int
    kind: str
    switches: str
    outcome: str
    text: str = ""
    error: float = np.nan
    seconds: float = 0.0
    passes: int = 0
    is_short: bool = False
    redundant: bool = False
    turns: bool = False
    scaled: bool = False
    redrawn: tuple[str, ...] = field(default=(), repr=False)


def case(rng: np.random.Generator) -> Case:
    """A scene drawn from random numbers, with its reference."""
    m = draw(rng)
    switches: list[Switch] = []
    count = int(rng.choice([0, 1, 2], p=[0.15, 0.7, 0.15]))
    if count:
        dense = np.linspace(0, m.span, 2001)
        system, reference, start, sizes = _reference(m, ())
        moving = reference.run(start, dense, COARSE).values * sizes[: reference.n_q + reference.n_v]

        def along(expression: ca.SX) -> Array:
            f = ca.Function("along", [ca.vertcat(system.q, system.v)], [expression])
            return f(moving.T).full().ravel()

        placed = [place(f"switch{k}", m, dense * m.units.time, along) for k in range(count)]
        switches = [switch for switch in placed if switch is not None]
    system, reference, start, sizes = _reference(m, switches)
    times = np.linspace(0, m.span, OUTPUTS)
    motion, coarse = (reference.run(start, times, rtol) for rtol in (FINE, COARSE))
    if not _error(coarse.values, motion.values) < AGREEMENT:
        raise UnusableError("SciPy does not agree with itself")
    scene = mb.Scene(system, m.start, times * m.units.time, guess=m.pose, name=m.kind)
    return Case(scene, m, tuple(switches), sizes, motion)


def _reference(m: Mechanism, switches: Sequence[Switch]) -> tuple[mb.System, Reference, Array, Array]:
    """The system, its reference, the state at the start in natural units, and the sizes of the states."""
    system = mb.System(*m.elements, *(switch.element for switch in switches))
    c = system.collected
    names = [*c.q_names, *c.v_names, *(state.name for state in c.states)]
    sizes = np.array([_size(name, m) for name in names])
    given = m.values()
    q = np.array([given[name] for name in c.q_names])
    s = ca.Function("s", [system.q], [ca.vertcat(ca.SX(0, 1), *(state.value for state in c.states))])(q)
    crossings = [pair for switch in switches for pair in switch.crossings]
    reference = Reference(system, sizes, m.units.time, crossings)
    listed = {k: given[name] / sizes[len(q) + k] for k, name in enumerate(c.v_names) if name in given}
    start = reference.start(q / sizes[: len(q)], s.full().ravel(), listed)
    return system, reference, start, sizes


def _size(name: str, m: Mechanism) -> float:
    body, _, part = name.rpartition(".")
    length, rate = m.units.length * m.sizes.get(body, 1.0), 1 / m.units.time
    if part in ("x", "y", "z"):
        return length
    if part in ("vx", "vy", "vz"):
        return length * rate
    return rate if part.startswith("omega") else 1.0


def _error(values: Array, known: Array) -> float:
    """Largest error of values (n_t, n) in natural units, over the size of each column or 1 if it is smaller."""
    return float((np.abs(values - known) / np.maximum(1.0, np.abs(known).max(axis=0))).max(initial=0.0))


def _turns(drawn: Case) -> bool:
    """Whether the angle of a body that turns about z leaves -pi ... pi."""
    columns = dict(zip(drawn.scene.system.collected.q_names, drawn.motion.values.T, strict=False))
    angles = [values for name, values in columns.items() if name.endswith(".theta")]
    for name, real in columns.items():
        body, _, part = name.rpartition(".")
        if part == "e0" and not any(columns[f"{body}.{tilt}"].any() for tilt in ("e1", "e2")):
            angles.append(np.unwrap(2 * np.arctan2(columns[f"{body}.e3"], real)))
    return any(bool((np.abs(values) > np.pi).any()) for values in angles)


def judge(number: int, seed: int, blind: bool) -> Verdict:
    """Draw the scene of a number until it has a reference, and run it."""
    redrawn: list[str] = []
    while True:
        try:
            drawn = case(np.random.default_rng([seed, number, len(redrawn)]))
            break
        except UnusableError as error:
            redrawn.append(str(error))
    if blind:  # in this process alone
        import_module("symmb.declare.symbolic.switching")._KINKS.clear()
    m, begin = drawn.mechanism, _seconds()
    known = {
        "kind": m.kind,
        "switches": ", ".join(switch.kind for switch in drawn.switches),
        "passes": len(drawn.motion.passes),
        "redundant": m.redundant,
        "turns": _turns(drawn),
        "scaled": m.units != Units(),
        "redrawn": tuple(redrawn),
    }
    try:
        with warnings.catch_warnings(action="ignore"):
            run = mb.simulate(drawn.scene)
    except mb.SymmbError as error:
        text = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
        return Verdict(number, outcome="refused", text=text, seconds=_seconds() - begin, **known)
    seconds, doubts = _seconds() - begin, getattr(run, "doubts", ())
    names = [*drawn.scene.system.collected.q_names, *drawn.scene.system.collected.v_names]
    values = np.column_stack([run[name] for name in names]) / drawn.sizes[: len(names)]
    error = _error(values, drawn.motion.values)
    is_right = error <= TOLERANCE
    outcome = ("right" if is_right else "wrong") + (", doubted" if doubts else "")
    steps = run.statistics["integrator"].get("steps", 0) or 30 * m.span
    text = f"{run.solver}, {run.reason[:120]}" + f"; doubts: {doubts}" * bool(doubts)
    known["is_short"] = drawn.shortest < SHORT / steps
    return Verdict(number, outcome=outcome, text=text, error=error, seconds=seconds, **known)


def _seconds() -> float:
    """Of processors, by this process and its compilers: others on the same machine have no effect."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main() -> None:
    blind = "blind" in sys.argv
    given = [int(a) for a in sys.argv[1:] if a != "blind"]
    count, seed, first = (*given, *(1000, 0, 0)[len(given) :])
    found, lost = [], 0
    for number, verdict in outcomes(partial(judge, seed=seed, blind=blind), range(first, first + count), HUNG):
        if isinstance(verdict, str):
            print(f"{number}: {verdict}", flush=True)
            lost += 1
            continue
        found.append(verdict)
        if verdict.outcome != "right" or verdict.seconds > SLOW:
            print(verdict, flush=True)
    _report(found, lost)


def _report(found: Sequence[Verdict], lost: int) -> None:
    n = len(found)
    print(f"{n} scenes of seed and number, {lost} lost: {dict(Counter(v.outcome for v in found))}")
    print(f"{sum(v.seconds > SLOW for v in found)} over {SLOW:g} s, longest {max(v.seconds for v in found):.1f} s")
    for what in ("is_short", "redundant", "turns", "scaled"):
        some = [v for v in found if getattr(v, what)]
        print(f"{what}: {len(some) / n:.0%}, {dict(Counter(v.outcome for v in some))}")
    print(f"redrawn: {dict(Counter(why for v in found for why in v.redrawn))}")
    errors = np.sort([v.error for v in found if np.isfinite(v.error)])
    print(f"errors: {np.median(errors):.1e} (median), {errors[int(0.95 * len(errors))]:.1e} (95 %), {errors[-1]:.1e}")
    for what in ("kind", "switches"):
        bad = Counter(part for v in found if v.outcome == "wrong" for part in getattr(v, what).split(", "))
        print(f"wrong by {what}: {dict(bad.most_common())}")


if __name__ == "__main__":
    main()
