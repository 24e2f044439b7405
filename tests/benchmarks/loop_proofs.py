"""Proved bounds of random mechanisms with loops against closed forms: python tests/benchmarks/loop_proofs.py.

    PYTHONPATH=. python tests/benchmarks/loop_proofs.py [number] [first seed] [points] [several]

Mechanisms are four-bars, six-bars, slider-cranks, parallelograms, five-bars with a gear, and four-bars with ball joints
(RSSR), in the plane or of spatial bodies, free or driven, with springs, dampers and torques of time. One or two of
their lengths, density, stiffness, start and speed are uncertain, or with `several` three to five of them. The
references are `_loops`: no symmb in them. At some of the mechanisms the motion ends or branches within the box, or
there are parameters without a start: no bounds may be told from then on.

It prints what is wrong: bounds that a run leaves, finite bounds where there is no solution, crashes, proofs that take
too long, and infinite bounds without a word. Then follow the times that are proved, how wide bounds are, and refusals.
"""

import sys
import time
import traceback
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import _isolated
import casadi as ca
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
import _loops as loops
from _loops import Case, planar_case

import symmb as mb

INSIDE = 1e-9
"""Error of runs over the size of an output."""
LIMIT = 400.0
"""Seconds that a case may take."""
SLOW = 60.0
"""Seconds of a proof that are told."""


def random_case(seed: int, several: bool = False) -> Case:
    """A random mechanism. One in four ends or branches, or has no start for some parameters, but not with several."""
    rng = np.random.default_rng(seed)
    kinds = _SPECIAL if rng.random() < 0.25 and not several else _REGULAR
    case = kinds[int(rng.integers(len(kinds)))](rng)
    return _with_several(case, rng) if several else case


def _with_several(case: Case, rng: np.random.Generator) -> Case:
    """The same mechanism with three to five uncertain parameters, of up to 0.3 %."""
    box = case.scene.box
    values = {name: float(value) for name, value in case.scene.system.parameters.items()}
    others = [name for name in values if values[name] and name not in box.names]
    names = [*box.names, *rng.permutation(others)][: int(rng.integers(3, 6))]
    spread = 10.0 ** rng.uniform(-3.5, -2.5)
    wide = {name: tuple(sorted((values[name] * (1 - spread), values[name] * (1 + spread)))) for name in names}
    return replace(case, scene=case.scene.with_box(mb.Box(**wide)))


def _box(rng: np.random.Generator, values: dict[str, float], names: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    chosen = rng.choice(names, 1 + int(rng.random() < 0.3), replace=False).tolist()
    spread = 10.0 ** rng.uniform(-3, -2)
    return {name: tuple(sorted((values[name] * (1 - spread), values[name] * (1 + spread)))) for name in chosen}


def _times(rng: np.random.Generator, end: float = 0.3) -> np.ndarray:
    return rng.choice([0.0, -0.7, 1.3]) + np.linspace(0.0, end * rng.uniform(0.5, 1.0), 5)


def _forces(rng: np.random.Generator, body: str) -> Callable[[loops.Plan, Any], loops.Plan]:
    """What adds a torque or a spring to a plan, or none."""
    kind = rng.choice(["torque", "spring", "none"])
    damping, place = rng.uniform(0, 2), (rng.uniform(-1, 1), rng.uniform(2, 3))

    def add(plan: loops.Plan, P: Any) -> loops.Plan:
        if kind == "torque":
            plan.push = "crank", lambda angle, rate, t: P.k * 0.1 * ca.sin(5 * t) - damping * rate - ca.sin(angle)
        elif kind == "spring":
            plan.spring = body, place, P.k, damping, 1.0
        return plan

    return add


_OTHERS = ("rho", "tilt", "spin", "k")


def _values(rng: np.random.Generator, **lengths: float) -> dict[str, float]:
    spin = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 3.0)
    tilt = rng.uniform(0.2, 1.4) + rng.integers(4) * np.pi / 2
    return {name: value * rng.uniform(0.95, 1.05) for name, value in lengths.items()} | {
        "rho": rng.uniform(0.5, 2.0), "k": rng.uniform(5, 50), "spin": spin, "tilt": tilt,
    }  # fmt: skip


def _law(times: np.ndarray) -> Callable[[Any, Any], Any]:
    """A motor that turns evenly, with a ripple."""
    return lambda P, t: P.tilt + P.spin * (t - times[0]) + 0.05 * ca.sin(4 * (t - times[0]))


def _evenly(times: np.ndarray) -> Callable[[Any, Any], Any]:
    return lambda P, t: P.tilt + P.spin * (t - times[0])


def _start(P: Any) -> tuple[Any, Any]:
    return P.tilt, P.spin


def _of(rng: np.random.Generator, kind: str, plan: Callable, values: dict[str, float], watched: tuple[str, str],
        lengths: tuple[str, ...], spatial: bool = False, end: float = 0.3) -> Case:  # fmt: skip
    """A mechanism that has a solution at all times, free or driven."""
    times, add = _times(rng, end), _forces(rng, "coupler")
    law = _law(times) if rng.random() < 0.3 else None
    box = _box(rng, values, (*lengths, *_OTHERS))
    kind += " of spatial bodies" * spatial + ", driven" * (law is not None)
    return planar_case(kind, values, lambda P, phi: add(plan(P, phi), P), _start, times, box, watched, law, spatial)


def _four_bar(rng: np.random.Generator, spatial: bool = False) -> Case:
    """Cranks that turn, and rockers on either side."""
    side = float(rng.choice([-1.0, 1.0]))
    values = _values(rng, **[{"a": 0.3, "b": 1.1, "c": 0.8, "d": 1.0}, {"a": 0.9, "b": 1.0, "c": 0.9, "d": 0.4},
                             {"a": 0.5, "b": 0.9, "c": 0.9, "d": 1.0}][int(rng.integers(3))])  # fmt: skip
    return _of(rng, "four-bar", lambda P, phi: loops._four_bar(P, phi, side), values, ("coupler", "C"),
               ("a", "b", "c", "d"), spatial, 0.2 if spatial else 0.3)  # fmt: skip


def _spatial_four_bar(rng: np.random.Generator) -> Case:
    return _four_bar(rng, spatial=True)


def _slider_crank(rng: np.random.Generator) -> Case:
    values = _values(rng, a=0.4, b=1.0, e=float(rng.choice([0.02, 0.2])))
    return _of(rng, "slider-crank", loops._slider_crank, values, ("coupler", "C"), ("a", "b", "e"))


def _six_bar(rng: np.random.Generator) -> Case:
    on, across = (("coupler", 0.4), ("rocker", 0.2))[int(rng.integers(2))]
    values = _values(rng, a=0.3, b=1.1, c=0.8, d=1.0)
    own = loops._six_bar(SimpleNamespace(**values), values["tilt"], None, on, across).bars
    lengths = own["link"].length, own["output"].length
    return _of(rng, f"six-bar on its {on}", lambda P, phi: loops._six_bar(P, phi, lengths, on, across), values,
               ("output", "E"), ("a", "b", "c", "d"), end=0.15)  # fmt: skip


def _five_bar(rng: np.random.Generator) -> Case:
    ratio = float(rng.choice([-1.0, 1.0, -0.5]))
    values = _values(rng, a=0.3, b=0.9, c=0.3, d=1.0)
    values["tilt"] = rng.uniform(-1.4, 1.4)  # a guess that is a turn off leads to another assembly
    return _of(rng, "five-bar with a gear", lambda P, phi: loops._five_bar(P, phi, ratio), values, ("coupler", "C"),
               ("a", "b", "c", "d"))  # fmt: skip


def _parallelogram(rng: np.random.Generator) -> Case:
    values = _values(rng, a=0.5, b=1.0)
    values["tilt"] = float(rng.choice([1.0, 2.0, 4.0]))
    return _of(rng, "parallelogram", loops._parallelogram, values, ("coupler", "C"), ("a", "b"))


def _rssr(rng: np.random.Generator) -> Case:
    values, times = _values(rng, a=0.3, b=0.9, c=0.7), _times(rng, 0.15)
    law = _law(times) if rng.random() < 0.3 else None
    box = _box(rng, values, ("a", "b", "c", "rho", "spin", "tilt"))
    return loops._rssr(values, rng.uniform(0.3, 1.2), times, box, bool(rng.random() < 0.5), law)


_REGULAR = (_four_bar, _four_bar, _spatial_four_bar, _slider_crank, _six_bar, _five_bar, _parallelogram, _rssr)


# Motions that end or branch, and parameters without a start


def _end_of(reach: Callable[[np.ndarray, float], float], times: np.ndarray) -> Callable[[np.ndarray], float]:
    """The first time, about, at which `reach` of parameters and time is negative."""
    fine = np.linspace(times[0], times[-1], 4001)

    def ends(p: np.ndarray) -> float:
        stuck = np.array([reach(p, t) < 0 for t in fine])
        return float(fine[stuck.argmax()]) if stuck.any() else np.inf

    return ends


def _locked_four_bar(rng: np.random.Generator) -> Case:
    """A motor drives the crank beyond the limit of the bars, for some or all parameters of the box."""
    values = {"a": 0.5, "b": 0.6, "c": 0.5, "d": 0.7, "rho": 1.0, "k": 1.0, "spin": 2.0, "tilt": 1.5}
    names, times = list(values), np.linspace(0.0, 0.4, 9)
    far = np.hypot(values["a"] * np.cos(2.0) - values["d"], values["a"] * np.sin(2.0) - 0.1)
    values["b"] = far - values["c"]  # in line at the angle 2, which is reached at 0.25 s
    if grashof := bool(rng.random() < 0.5):  # in line at the angle where ground and crank are, or never
        values["b"] = values["a"] + np.hypot(values["d"], 0.1) - values["c"]
        values["tilt"] = np.pi + np.arctan2(0.1, values["d"]) - 0.4
    spread = 10.0 ** rng.uniform(-3, -2)
    box = {name: (values[name] * (1 - spread), values[name] * (1 + spread))
           for name in rng.choice(["a", "b", "c", "d"], int(rng.integers(1, 3)), replace=False)}  # fmt: skip

    def room(p: np.ndarray, t: float) -> float:
        P = dict(zip(names, p, strict=True))
        phi = P["tilt"] + P["spin"] * t
        return P["b"] + P["c"] - np.hypot(P["a"] * np.cos(phi) - P["d"], P["a"] * np.sin(phi) - 0.1)

    return planar_case("Grashof's limit" if grashof else "a motor against a dead centre", values, loops._four_bar,
                       _start, times, box, ("coupler", "C"), _evenly(times), ends=_end_of(room, times))  # fmt: skip


def _locked_slider_crank(rng: np.random.Generator) -> Case:
    """A coupler that is as long as the crank, or shorter."""
    ratio = float(rng.choice([1.0, 0.9]))
    values = {"a": 0.5, "b": 0.5 * ratio, "e": 0.0, "rho": 1.0, "k": 1.0, "spin": 2.0,
              "tilt": float(np.arcsin(ratio)) - 0.4}  # fmt: skip
    names, times = list(values), np.linspace(0.0, 0.4, 9)
    box = {name: (values[name] * 0.997, values[name] * 1.003) for name in (["b"], ["a", "b"])[int(rng.integers(2))]}

    def room(p: np.ndarray, t: float) -> float:
        P = dict(zip(names, p, strict=True))
        return P["b"] - P["a"] * abs(np.sin(P["tilt"] + P["spin"] * t))

    return planar_case("a slider-crank that locks", values, loops._slider_crank, _start, times, box, ("coupler", "C"),
                       _evenly(times), ends=_end_of(room, times))  # fmt: skip


def _change_point(rng: np.random.Generator) -> Case:
    """A parallelogram without weight turns evenly through the position where it may fold over."""
    values = {"a": 0.5, "b": 1.0, "rho": 1.0, "k": 1.0, "spin": 2.0, "tilt": np.pi - 0.4}
    times = np.linspace(0.0, 0.4, 9)
    law = _evenly(times) if rng.random() < 0.5 else None
    box = {str(rng.choice(["a", "b", "spin", "tilt", "rho"])): ()}
    box = {name: (values[name] * 0.998, values[name] * 1.002) for name in box}
    names = list(values)

    def ends(p: np.ndarray) -> float:
        P = dict(zip(names, p, strict=True))
        return (np.pi - P["tilt"]) / P["spin"]

    return planar_case("a change point is passed", values, loops._parallelogram, _start, times, box, ("coupler", "C"),
                       law, gravity=0.0, ends=ends)  # fmt: skip


def _start_at_a_change_point(rng: np.random.Generator) -> Case:
    values = {"a": 0.5, "b": 1.0, "rho": 1.0, "k": 1.0, "spin": 1.0, "tilt": float(rng.choice([0.0, np.pi]))}
    shift = float(rng.choice([0.0, 0.004, 0.009]))
    values["tilt"] += shift
    box = {"tilt": (values["tilt"] - 0.01, values["tilt"] + 0.01)}
    return planar_case("a start at a change point", values, loops._parallelogram, _start, np.linspace(0, 0.1, 3), box,
                       ("coupler", "C"), starts=False)  # fmt: skip


def _start_beyond_a_dead_centre(rng: np.random.Generator) -> Case:
    """The rocker's angle is given, up to its extreme one or beyond."""
    values = {"a": 0.3, "b": 1.1, "c": 0.8, "d": 1.0, "rho": 1.0, "k": 1.0, "spin": 0.0, "tilt": 0.0}
    far, d = values["a"] + values["b"], np.hypot(values["d"], 0.1)
    at_D = np.arccos((values["c"] ** 2 + d**2 - far**2) / (2 * values["c"] * d))
    extreme = np.pi + np.arctan2(0.1, values["d"]) - at_D  # crank and coupler are in line
    phi = np.arctan2(0.1 + values["c"] * np.sin(extreme), values["d"] + values["c"] * np.cos(extreme))
    inside = float(rng.choice([0.0, 0.004, 0.009]))
    values |= {"tilt": extreme + inside, "phi": phi - 0.3}
    box = {"tilt": (values["tilt"] - 0.01, values["tilt"] + 0.01)}
    return planar_case("a start beyond a dead centre", values, loops._four_bar, lambda P: (P.phi, 0.0),
                       np.linspace(0, 0.1, 3), box, ("coupler", "C"), starts=False,
                       start_of={"rocker.theta": "tilt"})  # fmt: skip


def _start_that_does_not_reach(rng: np.random.Generator) -> Case:
    """The crank's angle is given, up to its limit or beyond."""
    values = {"a": 0.5, "b": 0.6, "c": 0.5, "d": 0.7, "rho": 1.0, "k": 1.0, "spin": 0.0, "tilt": 2.0}
    far = np.hypot(values["a"] * np.cos(2.0) - values["d"], values["a"] * np.sin(2.0) - 0.1)
    values["b"] = far - values["c"]
    values["tilt"] -= float(rng.choice([0.002, 0.008, 0.0099]))
    box = {"tilt": (values["tilt"] - 0.01, values["tilt"] + 0.01)}
    return planar_case("a start that does not reach", values, loops._four_bar, _start, np.linspace(0, 0.1, 3), box,
                       ("coupler", "C"), starts=False)  # fmt: skip


_SPECIAL = (_locked_four_bar, _locked_slider_crank, _change_point, _start_at_a_change_point,
            _start_beyond_a_dead_centre, _start_that_does_not_reach)  # fmt: skip


# Checks


@dataclass
class Found:
    """What became of a case.

    Attributes
    ----------
    outside : how far runs are outside, over the size of the output
    fault : what is wrong
    proved : share of the times, up to the end of the motion, that have bounds
    refused : the sentence of a refusal, or of what ended a proof
    ratio : median width over that of the runs
    seconds : of a processor that the proof took
    """

    kind: str
    outside: float = -np.inf
    fault: str = ""
    proved: float = 0.0
    refused: str = ""
    ratio: float = np.nan
    seconds: float = 0.0


def samples(box: mb.Box, values: dict[str, float], count: int, seed: int = 0) -> np.ndarray:
    """(count + 5, n_p) parameters: the middle, corners, points of edges, and others of the box."""
    rng = np.random.default_rng(seed)
    names, (low, high) = list(values), np.array(box.bounds, dtype=float).T
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(len(low), -1).T
    inner = low + (high - low) * rng.random((count, len(low)))
    for k in range(count // 2):
        j = int(rng.integers(len(low)))
        inner[k, j] = rng.choice([low[j], high[j]]) if len(low) > 1 else inner[k, j]
    own = np.vstack([0.5 * (low + high), corners, inner])
    P = np.tile(np.array(list(values.values()), dtype=float), (len(own), 1))
    P[:, [names.index(name) for name in box.names]] = own
    return P


def check(case: Case, order: int = 5, count: int = 8) -> Found:
    """Bounds of a case against runs."""
    scene, begin = case.scene, time.process_time()
    found = Found(case.kind)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.SymmbWarning)
        try:
            bounds = mb.propagate(scene, mb.TaylorModel(order=order))
        except mb.SymmbError as error:
            found.refused = f"{type(error).__name__}: {str(error).splitlines()[0][:300]}"
            found.fault = f"refused: {found.refused}" if case.starts else ""
            found.seconds = time.process_time() - begin
            return found
    found.seconds = time.process_time() - begin
    finite, told = np.isfinite(bounds.upper), " ".join(bounds.doubts)
    found.refused = told
    if not case.starts:
        found.fault = "bounds, although it cannot be started everywhere" if finite.any() else ""
        found.proved = 1.0
        return found
    values = {name: float(scene.system.parameters[name]) for name in scene.system.parameters}
    assert scene.box is not None and scene.outputs is not None
    P = samples(scene.box, values, count)
    Y = case.runs(P)
    end = min(case.ends(p) for p in P)
    late = scene.times > end + 1e-3 * np.ptp(scene.times)
    if finite[late].any():
        found.fault = f"bounds at {scene.times[late][0]:g} s, although the motion ends or branches at {end:g} s"
    known = finite & np.isfinite(Y).all(axis=0) & ~late[:, None]
    size = np.maximum(np.nanmax(np.abs(Y[:, ~late]), axis=(0, 1)), 1e-6)
    off = np.where(known, np.maximum(bounds.lower - Y, Y - bounds.upper), -np.inf) / size
    found.outside = float(off.max())
    if not finite.all() and not told:
        found.fault = "infinite bounds without a word"
    unnamed = [name for k, name in enumerate(scene.outputs) if not finite[:, k].any() and name not in told]
    if finite.any() and unnamed:
        found.fault = found.fault or f"{', '.join(unnamed)} infinite at all times, which is not told: {told}"
    found.proved = float(finite[~late].mean())
    if known.any():
        sampled = np.ptp(Y, axis=0)
        wide = known & (sampled > 1e-6 * size)
        if wide.any():
            found.ratio = float(np.median((bounds.upper - bounds.lower)[wide] / sampled[wide]))
    return found


def judge(seed: int, several: bool = False, count: int = 8) -> Found:
    case = random_case(seed, several)
    try:
        return check(case, order=(3 if several else 4) + seed % 3, count=count)
    except Exception:
        return Found(case.kind, fault=traceback.format_exc())


def main() -> None:
    several = "several" in sys.argv
    numbers = [a for a in sys.argv[1:] if a != "several"]
    count, first, points = (int(a) for a in (*numbers, *("100", "0", "8")[len(numbers) :]))
    _isolated.WORKERS = 1
    begin, all_found, wrong = time.perf_counter(), [], 0
    for seed, found in _isolated.outcomes(
        partial(judge, several=several, count=points), range(first, first + count), LIMIT
    ):
        if isinstance(found, str):
            found = Found(random_case(seed, several).kind, fault=f"{found} (limit {LIMIT:g} s)", seconds=LIMIT)
        all_found.append(found)
        if found.outside > INSIDE or found.fault or found.seconds > SLOW:
            wrong += found.outside > INSIDE or bool(found.fault)
            print(f"seed {seed}, {found.kind}, {found.seconds:.0f} s: outside by {found.outside:.1e} {found.fault}",
                  flush=True)  # fmt: skip
    of_kind = defaultdict(list)
    for found in all_found:
        of_kind[found.kind].append(found)
    print(f"{count} mechanisms in {time.perf_counter() - begin:.0f} s: {wrong} with something wrong")
    for kind, some in sorted(of_kind.items()):
        ratios = [f.ratio for f in some if np.isfinite(f.ratio)]
        print(
            f"  {kind}: {len(some)}, {np.mean([f.proved for f in some]):.0%} of times proved, width over that of runs "
            f"{np.median(ratios) if ratios else np.nan:.3f}, {np.median([f.seconds for f in some]):.0f} s"
        )
    reasons = Counter(_reason(found.refused) for found in all_found if found.refused)
    for reason, number in reasons.most_common():
        print(f"  {number} times: {reason}")


def _reason(told: str) -> str:
    """A sentence without its numbers."""
    return "".join(c for c in told if not c.isdigit())


if __name__ == "__main__":
    main()
