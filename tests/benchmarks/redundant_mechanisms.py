"""Random redundant mechanisms: every run, study and linearisation against the same mechanism without redundant joints.

The truth is a run without the redundant joints in coordinates of bodies by CVODES at a tight tolerance. Compared are
runs with them in both coordinates, the runs of a study by its own solver at corners of the box, every fifth time bounds
by Vertex, and for open mechanisms every fifth time bounds by TaylorModel. The eigenvalues by linearize are compared
with those without redundant joints in coordinates of joints, and counted in those of bodies. Each line that differs is
printed, then the counts.

    PYTHONPATH=.:tests python tests/benchmarks/redundant_mechanisms.py [first seed] [number]
"""

import sys
import warnings
from collections import Counter
from dataclasses import replace

import numpy as np
from _isolated import outcomes
from redundant_scenes import Mechanism, mechanism

import symmb as mb

SAME, STUDY, LIMIT, OFTEN = 1e-6, 1e-5, 300.0, 5
"""Allowed difference over the largest value of each output: of runs, and of studies, whose solver has a tolerance of
1e-8 a step by default: where this takes more than SAME, a tighter one must not; seconds a mechanism may take; and how
rarely bounds are computed."""
LOOPS = ("four-bar", "cranks")
Verdict = tuple[str, str]
"""What was compared, and "right" or what is wrong."""


def judged(seed: int) -> tuple[str, list[Verdict]]:
    """The kind of a mechanism, and all verdicts on it."""
    warnings.simplefilter("ignore")
    m = mechanism(seed)
    verdicts: list[Verdict] = []

    def judge(what: str, make) -> None:
        try:
            verdicts.append((what, make()))
        except mb.SymmbError as error:
            verdicts.append((what, f"refused: {error}"[:220]))
        except Exception as error:  # a foreign exception is a fault
            verdicts.append((what, f"CRASH {type(error).__name__}: {error}"[:220]))

    plain, tight = m.plain(), mb.CVODES(rtol=1e-10)
    truth = mb.simulate(plain, tight)
    corners = [{"m": 0.9, "L": 0.97}, {"m": 1.1, "L": 1.03}]
    at_corners = np.array([mb.simulate(plain, tight, parameters=corner).values for corner in corners])
    for coordinates in ("body", "joint"):
        judge(coordinates, lambda c=coordinates: _run(mb.simulate(m.redundant(c), tight), truth.values))
    judge("study", lambda: _study(m, corners, at_corners))
    judge("linearize", lambda: _linear(m))
    if seed % OFTEN == 0:
        judge("propagate", lambda: _bounds(m, plain, tight))
    if seed % OFTEN == 1 and m.is_open:
        judge("proof", lambda: _proof(m, at_corners))
    return m.kind, verdicts


def _difference(Y: np.ndarray, truth: np.ndarray) -> float:
    size = np.abs(truth).max(axis=tuple(range(truth.ndim - 1)))
    return float((np.abs(Y - truth) / np.maximum(size, 1e-2 * size.max())).max())


def _verdict(difference: float, limit: float, doubts: tuple[str, ...]) -> str:
    if difference <= limit:
        return "right" if not doubts else f"right, doubted: {doubts}"[:220]
    return f"{'doubted' if doubts else 'SILENT'} {difference:.1e} {doubts}"[:220]


def _run(run: mb.Trajectory, truth: np.ndarray) -> str:
    return _verdict(_difference(run.values, truth), SAME, run.doubts)


def _study(m: Mechanism, corners: list[dict[str, float]], truth: np.ndarray) -> str:
    simulator = mb.DAESimulator(m.redundant(None))
    P = np.array([list(corner.values()) for corner in corners])
    ensemble = simulator.run(P)
    if not ensemble.ok.all():
        return f"FAILED {ensemble.status.tolist()}"
    difference, doubts = _difference(ensemble.Y, truth), tuple(simulator.start.doubts)
    if SAME < difference <= STUDY:
        return _verdict(_difference(simulator.tighter().run(P).Y, truth), SAME, doubts)
    return _verdict(difference, SAME, doubts)


def _linear(m: Mechanism) -> str:
    # Beside steady motions eigenvalues depend on coordinates: loops are compared where they balance.
    def scene(subject: mb.Scene) -> mb.Scene:
        if m.is_open or m.kind not in LOOPS:
            return subject
        guess = {**subject.guess, **{k: v for k, v in subject.start.items() if not k.endswith(("rate", "omega"))}}
        return replace(subject, start={}, guess=guess, equilibrium=True)

    scenes = [scene(s) for s in (replace(m.plain(), coordinates="joint"), m.redundant("joint"), m.redundant("body"))]
    known, by_joints, by_bodies = (mb.linearize(s).eigenvalues for s in scenes)
    if not len(known) == len(by_joints) == len(by_bodies):
        return f"SILENT {len(known)} eigenvalues, {len(by_joints)} in joints, {len(by_bodies)} in bodies"
    if m.kind in LOOPS:  # the same scene in other coordinates may settle in another equilibrium
        at = [mb.simulate(replace(s, times=[0.0, 1e-3])).values[0] for s in scenes[:2]]
        if np.abs(at[0] - at[1]).max() > SAME:
            return "counted"
    size = np.abs(known).max(initial=0.0)
    apart = max((np.abs(known - value).min() for value in by_joints), default=0.0) / (size or 1.0)
    return "right" if apart <= SAME else f"SILENT {apart:.1e}"


def _bounds(m: Mechanism, plain: mb.Scene, tight: mb.CVODES) -> str:
    bounds = mb.propagate(m.redundant(None), mb.Vertex())
    runs = [mb.simulate(plain, tight, parameters={"m": a, "L": b}).values for a in (0.9, 1.1) for b in (0.97, 1.03)]
    ends = np.stack([np.min(runs, axis=0), np.max(runs, axis=0)])
    return _verdict(_difference(np.stack([bounds.lower, bounds.upper]), ends), STUDY, ())


def _proof(m: Mechanism, truth: np.ndarray) -> str:
    scene = m.redundant(None)
    scene = replace(scene, box=mb.Box(m=(0.99, 1.01), L=(0.999, 1.001)))
    bounds = mb.propagate(scene, mb.TaylorModel(order=4))
    run = mb.simulate(m.plain(), mb.CVODES(rtol=1e-10)).values
    slack = 1e-8 * np.abs(run).max()
    inside = ~((run < bounds.lower - slack) | (run > bounds.upper + slack)).any()
    width = np.nanmax(np.where(np.isfinite(bounds.upper), bounds.upper - bounds.lower, 0.0))
    known = np.isfinite(bounds.upper).mean()
    return "right" if inside else f"SILENT: a run leaves proved bounds of width {width:.1e}, {known:.0%} of them finite"


def main(first: int = 0, number: int = 400) -> None:
    """Judge the mechanisms of some seeds and print what differs."""
    counts: Counter[str] = Counter()
    for seed, outcome in outcomes(judged, range(first, first + number), LIMIT):
        if isinstance(outcome, str):
            counts[outcome] += 1
            print(seed, outcome, flush=True)
            continue
        kind, verdicts = outcome
        counts["mechanisms"] += 1
        for what, verdict in verdicts:
            counts[f"{what}: {verdict.split(':')[0].split()[0].rstrip(',')}"] += 1
            if verdict not in ("right", "counted"):
                print(seed, kind, "|", what, "|", verdict, flush=True)
    for what, count in sorted(counts.items()):
        print(f"{count:6d}  {what}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
