"""Random periodic machines against closed forms: wheels and laws that act for a part of each turn or period.

    python tests/benchmarks/periodic_machines.py [first seed] [number of machines]

A particle of 1 kg is pushed by a force of the angle of a wheel, which turns evenly or faster and faster, or of time.
The speed at the end is the integral of the force over time: it is taken piece by piece between jumps located on
a fine grid, with Gauss's rule in each of its cells. Runs are by the solver that is chosen, by the explicit
pair, by SUNDIALS and, with other parameters side by side, as an ensemble. It prints machines that are off by more than
1e-4 of the closed form without a doubt, and their numbers at the end.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

import symmb as mb
from symmb._types import Array

TOLERANCE = 1e-4
_GRID, _HALVINGS = 400_001, 45

Law = Callable[[ca.SX], ca.SX]


@dataclass(frozen=True)
class Machine:
    """A law of the angle rate t + growth t^2 / 2 of a wheel, or of time where the rate is None, until end [s]."""

    kind: str
    law: Law
    rate: float | None
    growth: float
    end: float


def draw(seed: int) -> Machine:
    """A random machine."""
    rng = np.random.default_rng(seed)
    of_time, turns = rng.random() < 0.4, rng.uniform(3, 25)
    rate = 10.0 ** rng.uniform(-0.5, 1.5) * rng.choice([-1, 1])
    period = 2 * np.pi if rng.random() < 0.5 else 10.0 ** rng.uniform(-0.5, 1)
    shift, width, teeth = rng.uniform(0, 2 * np.pi), 10.0 ** rng.uniform(-2.5, -0.5), int(rng.integers(1, 5))
    level = np.cos(np.pi * width)

    def phase(a: ca.SX) -> ca.SX:
        """From 0 to 1 in each period."""
        return (a - shift) / period - ca.floor((a - shift) / period)

    knots = [0.0, 0.3, 0.3 + width / 2, 0.3 + width, 1.0]
    laws: dict[str, Law] = {
        "kick": lambda a: ca.if_else(ca.cos(teeth * a + shift) > level, 1.0, 0.0),
        "cam": lambda a: ca.fmax(ca.cos(teeth * a + shift) - level, 0) / (1 - level),
        "commutator": lambda a: ca.sign(ca.sin(a + shift)) * ca.sin(a),
        "valve": lambda a: ca.fmin(ca.fmax(3 * ca.sin(a + shift) - 1, 0), 1),
        "window by floor": lambda a: ca.if_else(phase(a) < width, 1.0, 0.0),
        "window by fmod": lambda a: ca.if_else(ca.fabs(ca.fmod(a, period)) < width * period, 1.0, 0.0),
        "window by remainder": lambda a: ca.if_else(
            ca.fabs(ca.remainder(a - shift, period)) < width * period, 1.0, 0.0
        ),
        "sawtooth": phase,
        "steps": lambda a: ca.ceil(a / period) * 0.1,
        "table": lambda a: mb.Table(knots, [0, 0, 1, 0, 0])(phase(a)),
        "power": lambda a: ((1 + ca.cos(a - shift)) / 2) ** round(1 / width**2),
        "bump": lambda a: ca.fmax(0, 1 / (1 + (ca.sin((a - shift) / 2) / width) ** 2) - 0.5),
    }
    kind = str(rng.choice(list(laws)))
    long = turns * (2 * np.pi if kind in ("kick", "cam", "commutator", "valve", "bump", "power") else period)
    growth = 0.0 if of_time or rng.random() < 0.5 else rng.uniform(0.1, 1) * rate**2 / long
    end = (
        long
        if of_time
        else (np.sqrt(rate**2 + 2 * abs(growth) * long) - abs(rate)) / abs(growth)
        if growth
        else long / abs(rate)
    )
    return Machine(kind, laws[kind], None if of_time else rate, np.sign(rate) * abs(growth), float(end))


def scene(machine: Machine) -> mb.Scene:
    """The machine with a parameter, the size of the force."""
    p = mb.Parameters(force=1.0)
    body = mb.Body("body", 1.0, pose=mb.Particle())
    elements, start, angle = [body], {}, mb.t
    if machine.rate is not None:
        wheel = mb.Body("wheel", 1.0, 2.0)
        hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), wheel.point(0, 0))
        elements += [wheel, hinge, mb.Actuator("motor", hinge, 2.0 * machine.growth)]
        start, angle = {"hinge.angle": 0.0, "hinge.angle_rate": machine.rate}, hinge.angle
    push = mb.Force("push", body.point(0, 0, 0), (p.force * machine.law(angle), 0, 0))
    system = mb.System(*elements, push, parameters=p)
    return mb.Scene(system, start, np.linspace(0, machine.end, 11), {"v": body.vx}, box=mb.Box.around(p, 0.1))


def closed_form(machine: Machine) -> float:
    """The integral of the law over time: Gauss's rule between times and jumps, those of second differences."""
    a = ca.SX.sym("a")
    of_angle = ca.Function("law", [a], [machine.law(a)])

    def f(t: Array) -> Array:
        angle = t if machine.rate is None else machine.rate * t + machine.growth * t**2 / 2
        return np.array(of_angle(angle.reshape(1, -1))).reshape(t.shape)

    t = np.linspace(0, machine.end, _GRID)
    y = f(t)
    bends = np.abs(np.diff(y, 2))
    some = np.flatnonzero(bends > 1e-3 * np.abs(y).max() + 20 * np.median(bends))
    low, high = t[some], t[some + 2]
    for _ in range(_HALVINGS if some.size else 0):  # the half that bends more
        parts = np.linspace(low, high, 5, axis=1)
        k = np.abs(np.diff(f(parts), 2)).argmax(axis=1)
        low, high = parts[np.arange(len(low)), k], parts[np.arange(len(low)), k + 2]
    ends = np.unique(np.concatenate([t, (low + high) / 2]))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half = np.diff(ends)[:, None] / 2
    return float((f(ends[:-1, None] + half * (1 + nodes)) * half * weights).sum())


def results(machine: Machine) -> dict[str, tuple[float, tuple[str, ...]]]:
    """Speeds at the end for a force of 1 N, and doubts: of runs, and of an ensemble."""
    own, found = scene(machine), {}
    for solver in (None, mb.DormandPrince(), mb.CVODES()):
        try:
            run = mb.simulate(own, solver)
        except mb.SimulationError as error:
            found[repr(solver) if solver else "chosen"] = float("nan"), (str(error),)
        else:
            found[repr(solver) if solver else "chosen"] = float(run["v"][-1]), run.doubts
    bounds = mb.propagate(own, mb.Scanning(9))
    found["ensemble"] = float(bounds["v"][1][-1] + bounds["v"][0][-1]) / 2, bounds.doubts
    return found


def main(first: int, count: int) -> None:
    """Machines of the seeds from `first` on."""
    wrong = doubted = 0
    for seed in range(first, first + count):
        machine = draw(seed)
        exact = closed_form(machine)
        for name, (value, doubts) in results(machine).items():
            if not abs(value - exact) <= TOLERANCE * max(abs(exact), 1e-3 * machine.end):
                wrong, doubted = wrong + (not doubts), doubted + bool(doubts)
                print(f"seed {seed}, {machine.kind} of {'time' if machine.rate is None else 'angle'}, {name}: "
                      f"{value:.8g}, exact {exact:.8g}, doubts {doubts}", flush=True)  # fmt: skip
    print(f"{count} machines from seed {first}: {wrong} results wrong in silence, {doubted} wrong and doubted")


if __name__ == "__main__":
    main(*(int(a) for a in (sys.argv[1:] + ["0", "30"][len(sys.argv) - 1 :])))
