"""A thousand random mechanisms by the solver that symmb chooses: trees and loops, in plane and space.

Each is labelled before it runs. Solvable ones are consistent, with masses over twelve decades from scene to scene and
over four within one, springs from 0.1 to 3000 rad/s, damping from none to a thousand times critical. The others have a
fault planted: bars that do not reach, speeds that contradict, a torque that runs away, a mass below zero, a body
without mass that nothing carries. Planar trees without springs are run in exudyn too, where it has converged itself.

    PYTHONPATH=. python tests/benchmarks/random_mechanisms.py [number] [seed]
"""

import sys
from collections import Counter
from dataclasses import dataclass
from functools import partial

import exudyn as exu
import numpy as np
from _exudyn_planar import planar
from _isolated import outcomes

import symmb as mb

SPAN = 1.0
"""Seconds that the scenes last."""
POSITION, ENERGY, LIMIT, PEER = 1e-5, 1e-3, 90.0, 5e-3
"""Allowed drift of positions over the size, of energy over the largest kinetic one; seconds; difference to exudyn."""


@dataclass(frozen=True)
class Verdict:
    """What became of a scene; `fault` is what was planted, "" for a solvable one."""

    number: int
    kind: str
    fault: str
    outcome: str
    told: str = ""
    difference: float = float("nan")

    @property
    def good(self) -> bool:
        return self.outcome == ("refused" if self.fault else "solved")


FAULTS = ("too short", "contradicting speeds", "runs away", "negative mass", "nothing carries it")


class Mechanism:
    """Bodies on a tree of joints, some loops closed by bars, springs and dampers between them."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.spatial = bool(rng.random() < 0.3)
        self.fault = str(rng.choice(FAULTS)) if rng.random() < 0.15 else ""
        self.size = 10.0 ** rng.uniform(-3, 3)
        self.n = int(rng.integers(2, 7))
        self.kind = ("spatial" if self.spatial else "planar") + (" loops" if rng.random() < 0.5 else " tree")
        if self.fault == "runs away" and "loops" in self.kind:  # which may hold it
            self.fault = ""
        self.mass = 10.0 ** rng.uniform(-6, 6)

    def scene(self) -> mb.Scene:
        rng, size = self.rng, self.size
        bodies: list[mb.Body] = []
        elements: list[object] = []
        start: dict[str, object] = {}
        guess: dict[str, object] = {}
        places: list[tuple[np.ndarray, np.ndarray]] = []  # position and rotation (3, 3) by forward kinematics
        ground = mb.Ground()
        for i in range(self.n):
            length, m = size * rng.uniform(0.3, 2), self.mass * 10.0 ** rng.uniform(-2, 2)
            if self.fault == "negative mass" and i == self.n - 1:
                m = -m
            inertia = abs(m) * length**2 * rng.uniform(0.05, 0.2)
            parent = int(rng.integers(-1, i))
            if self.spatial:
                thick = (inertia, inertia * rng.uniform(1, 1.5), inertia * rng.uniform(1, 1.5))
                body = mb.Body(f"b{i}", m, thick, mb.Spatial())
                R = _rotation(rng)
            else:
                body = mb.Body(f"b{i}", m, inertia, mb.Planar())
                R = _about_z(rng.uniform(-np.pi, np.pi))
            hang = np.array([-length / 2, 0.0, 0.0])
            if parent < 0:
                at = np.array([*rng.uniform(-size, size, 2), 0.0])
                base = ground.point(*at) if self.spatial else ground.point(*at[:2])
            else:
                local = np.array([*(size * rng.uniform(-0.5, 0.5, 2)), 0.0])
                base = bodies[parent].point(*local) if self.spatial else bodies[parent].point(*local[:2])
                at = places[parent][0] + places[parent][1] @ local
            hinge = body.point(*hang) if self.spatial else body.point(*hang[:2])
            elements.append((mb.Spherical if self.spatial else mb.Revolute)(f"j{i}", base, hinge))
            r = at - R @ hang
            places.append((r, R))
            bodies.append(body)
            if self.spatial:
                start[f"b{i}.rotation"] = mb.rotation(*_axis_angle(R))
            else:
                start[f"b{i}.theta"] = float(np.arctan2(R[1, 0], R[0, 0]))
            guess |= {f"b{i}.{c}": float(v) for c, v in zip("xyz" if self.spatial else "xy", r, strict=False)}
            if "loops" not in self.kind or i == 0:
                speed = rng.normal(size=3) if self.spatial else float(rng.normal() * 3)
                start[f"b{i}.omega"] = tuple(speed) if self.spatial else speed
        loops = int(rng.integers(1, max(2, self.n - 1))) if "loops" in self.kind and self.n > 2 else 0
        for k in range(loops):
            i = self.n - 1 - k
            tip = np.array([size * rng.uniform(0.2, 1), size * rng.uniform(0.1, 0.5), 0.0])
            at = places[i][0] + places[i][1] @ tip
            anchor = at + size * rng.uniform(0.5, 2) * _direction(rng, self.spatial)
            reach = float(np.linalg.norm(anchor - at))
            ends = (ground.point(*anchor), bodies[i].point(*tip)) if self.spatial else (
                ground.point(*anchor[:2]), bodies[i].point(*tip[:2]))  # fmt: skip
            elements.append(mb.Distance(f"bar{k}", *ends, reach))
        self._springs(bodies, ground, elements)
        self._plant(bodies, ground, elements, start)
        elements.append(mb.Gravity(0, -9.81, 0) if self.spatial else mb.Gravity(0, -9.81))
        return mb.Scene(
            mb.System(*bodies, *elements), start, np.linspace(0, SPAN, 21), guess=guess, name=f"{self.kind} of {self.n}"
        )

    def _springs(self, bodies: list[mb.Body], ground: mb.Ground, elements: list[object]) -> None:
        rng = self.rng
        for k in range(int(rng.integers(0, 3))):
            body = bodies[int(rng.integers(0, self.n))]
            omega = 10.0 ** rng.uniform(-1, 3.5)
            m = float(body.mass)
            ratio = 0.0 if rng.random() < 0.5 else 10.0 ** rng.uniform(-2, 3)
            far = self.size * 3 * _direction(rng, self.spatial)
            zero = (0, 0, 0) if self.spatial else (0, 0)
            a, b = ground.point(*far[: len(zero)]), body.point(*zero)
            elements.append(mb.SpringDamper(f"s{k}", a, b, m * omega**2, 2 * ratio * m * omega, self.size * 2))

    def _plant(
        self, bodies: list[mb.Body], ground: mb.Ground, elements: list[object], start: dict[str, object]
    ) -> None:
        zero, far = ((0, 0, 0), (0, 0, 1e3)) if self.spatial else ((0, 0), (0, 1e3))
        far = tuple(self.size * c for c in far)
        if self.fault == "too short":
            elements.append(mb.Distance("short", ground.point(*far), bodies[0].point(*zero), self.size))
        elif self.fault == "contradicting speeds":
            start["b0.vx"] = 1e3 * self.size
            start["b0.vy"] = 1e3 * self.size
            start["b0.omega"] = (0, 0, 0) if self.spatial else 0.0
        elif self.fault == "runs away":
            inertia = float(np.max(bodies[-1].inertia)) if self.spatial else float(bodies[-1].inertia)
            spin = bodies[-1].omega
            rate = 1e7 * inertia * (1 + (spin.T @ spin if self.spatial else spin**2))
            elements.append(mb.Torque("run", bodies[-1], (rate, 0, 0) if self.spatial else rate))
        elif self.fault == "nothing carries it":
            loose = mb.Body("loose", 0.0, (0, 0, 0) if self.spatial else 0.0, bodies[0].pose)
            bodies.append(loose)
            elements.append(mb.Force("push", loose.point(*zero), (1.0, 0, 0) if self.spatial else (1.0, 0)))


def judge(number: int, seed: int) -> Verdict:
    mechanism = Mechanism(np.random.default_rng([seed, number]))
    kind, fault = mechanism.kind, mechanism.fault
    try:
        scene = mechanism.scene()
        run = mb.simulate(scene)
    except mb.SymmbError as error:
        return Verdict(number, kind, fault, "refused", f"{type(error).__name__}: {str(error).splitlines()[0][:160]}")
    if not np.isfinite(run.x).all():
        return Verdict(number, kind, fault, "NaN in silence")
    drift, energy = run.position_drift / mechanism.size, run.energy_drift
    told = f"position {drift:.1e}, energy {energy:.1e}, {run.solver}"
    if not (drift < POSITION and energy < ENERGY):
        return Verdict(number, kind, fault, "drifted", told)
    return Verdict(number, kind, fault, "solved", told, _difference(scene, run, mechanism))


def _difference(scene: mb.Scene, run: mb.Trajectory, mechanism: Mechanism) -> float:
    """To exudyn at the end, over the size; nan where it has no counterpart or does not finish."""
    if mechanism.kind != "planar tree" or any(isinstance(e, mb.SpringDamper) for e in scene.system.elements):
        return float("nan")
    try:
        coarse, fine = (planar(scene)(steps)[0][:, :2] for steps in (15_000, 30_000))
    except exu.SolverError:
        return float("nan")
    if np.abs(fine - coarse).max() > 3 * PEER * mechanism.size:  # errors of second order: what is left is a third
        return float("nan")
    names = [body.name for body in scene.system.bodies]
    own = np.array([[run[f"{name}.{c}"][-1] for c in ("x", "y")] for name in names])
    return float(np.abs(fine + (fine - coarse) / 3 - own).max() / mechanism.size)


def _rotation(rng: np.random.Generator) -> np.ndarray:
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def _axis_angle(R: np.ndarray) -> tuple[tuple[float, ...], float]:
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return tuple(axis / np.linalg.norm(axis)), float(np.arctan2(np.linalg.norm(axis), np.trace(R) - 1))


def _direction(rng: np.random.Generator, spatial: bool) -> np.ndarray:
    d = rng.normal(size=3) * (1, 1, float(spatial))
    return d / np.linalg.norm(d)


def main() -> None:
    count, seed = (int(a) for a in (*sys.argv[1:], *("1000", "0")[len(sys.argv) - 1 :]))
    found = []
    for number, verdict in outcomes(partial(judge, seed=seed), range(count), LIMIT):
        if isinstance(verdict, str):
            mechanism = Mechanism(np.random.default_rng([seed, number]))
            verdict = Verdict(number, mechanism.kind, mechanism.fault, verdict)
        found.append(verdict)
        if not verdict.good or verdict.difference > PEER:
            print(verdict, flush=True)
    for what, some in (("solvable", [v for v in found if not v.fault]), ("faulty", [v for v in found if v.fault])):
        share = np.mean([v.good for v in some])
        print(f"{what}: {len(some)}, {share:.1%} as labelled; {dict(Counter(v.outcome for v in some))}")
    print({fault: next((v.told for v in found if v.fault == fault), "") for fault in FAULTS})
    for kind in sorted({v.kind for v in found}):
        print(f"{kind}: {np.mean([v.good for v in found if v.kind == kind and not v.fault]):.1%}")
    beside = np.array([v.difference for v in found if np.isfinite(v.difference)])
    if beside.size:
        typical, largest = np.median(beside), beside.max()
        print(f"beside exudyn: {beside.size}, differences {typical:.1e} (median) to {largest:.1e} of the size")


if __name__ == "__main__":
    main()
