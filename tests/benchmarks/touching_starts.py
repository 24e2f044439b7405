"""Random machines whose contacts begin closed, or nearly: the processor time of blocks of runs, and their answers.

    touching_starts.py [machines, 30] [seed]

A gap of exactly 0, or of the rounding of the positions, must cost at most MOST times the time of a gap of 1e-5 m, and
all these small gaps must have the same answers.
"""

import sys
import warnings
from typing import Any

import casadi as ca
import numpy as np
from _timing import median

import symmb as mb

GAPS, CLEAR = (0.0, 1e-17, -1e-17, 1e-12, -1e-12), 1e-5
"""Gaps at the start, and the gap with which their times are compared [m]."""
MOST, SAME = 1.5, 1e-5
"""Largest ratio of times, and largest difference of answers over their range."""
LAWS = {
    "elastic": lambda p: mb.KelvinVoigt(p.k),
    "damped": lambda p: mb.KelvinVoigt(p.k, p.c),
    "Hertzian": lambda p: mb.HuntCrossley(p.k, restitution=p.e, speed=1.0),
    "impact": None,
}
LAWS_OF_KINDS = {
    "pusher": ("elastic", "damped", "Hertzian", "impact"),
    "row": ("elastic", "damped", "Hertzian"),
    "bats": ("damped", "Hertzian", "impact"),
    "balls": ("damped", "Hertzian", "impact"),
}
KINDS = [(kind, law) for kind, laws in LAWS_OF_KINDS.items() for law in laws]
NUMBERS = dict.fromkeys("mass other rate reach load k c e gap".split(), 1.0)
RAIL, LOADS = (1, 0, 0), (1.0, 0.5, 0.2)
GROUND = mb.Ground()


def surface(name: str, law: Any, p: mb.Parameters, upper: Any, lower: Any, gap: Any, axis: tuple) -> Any:
    """A contact between two points, or an impact."""
    if law is None:
        return mb.Impact(name, gap=gap, restitution=p.e)
    return mb.Contact(name, upper, lower, axis, law(p))


def scene(kind: str, law: str) -> mb.Scene:
    """A machine with all numbers as parameters. The contacts have the gap `gap` at the start."""
    p, make, elements, start = mb.Parameters(**NUMBERS), LAWS[law], [], {}
    if kind in ("pusher", "row"):  # sliders on one rail. A spring pushes the first, and the others lie before it
        n = 2 if kind == "pusher" else 4
        sliders = [mb.Body(f"s{i}", p.mass if i == 0 else p.other, 1.0, mb.Planar()) for i in range(n)]
        rails = [mb.Prismatic(f"r{i}", GROUND.point(0, 0), s.point(0, 0), axis=RAIL) for i, s in enumerate(sliders)]
        elements += [*sliders, *rails, mb.Actuator("spring", rails[0], -p.rate * rails[0].displacement)]
        for i in range(n - 1):
            ahead, behind = sliders[i + 1].point(0, 0), sliders[i].point(0, 0)
            gap = rails[i + 1].displacement - rails[i].displacement
            elements.append(surface(f"touch{i}", make, p, ahead, behind, gap, RAIL))
        start = {f"r{i}.displacement": -p.reach + i * p.gap for i in range(n)}
        outputs = {"last": sliders[-1].vx, "first": sliders[0].vx}
    else:  # rods on hinges, or balls, that a force presses on their stops and raises later
        n, outputs = 3, {}
        for i in range(n):
            inertia = {"inertia": p.mass * p.reach**2} if kind == "bats" else {"pose": mb.Particle()}
            body = mb.Body(f"b{i}", p.mass * (1 + 0.3 * i), **inertia)
            lift = LOADS[i] * (2 * ca.sin(ca.sqrt(p.rate / p.mass) * mb.t) - 1)
            tip = body.point(p.reach if kind == "bats" else 0, 0)
            foot = GROUND.point(0.1 * i, -p.gap)
            elements += [body, surface(f"stop{i}", make, p, tip, foot, tip.y + p.gap, (0, 1))]
            if kind == "bats":
                hinge = mb.Revolute(f"h{i}", GROUND.point(0, 0), body.point(0, 0))
                elements += [
                    hinge,
                    mb.Actuator(f"drive{i}", hinge, p.reach * lift * p.load - p.rate * p.reach**2 * hinge.angle),
                ]
            else:
                elements.append(mb.Force(f"push{i}", tip, (0, lift * p.load - p.rate * body.y)))
            outputs[f"v{i}"] = tip.y
    system = mb.System(*elements, parameters=p)
    return mb.Scene(system, start, [0.0, 1.0], outputs)


def draw(rng: np.random.Generator) -> tuple[dict[str, float], float]:
    """Random numbers, and the length of the run [s]: about a period of the drive."""
    n = dict(mass=10 ** rng.uniform(-2, 1), other=10 ** rng.uniform(-2, 1), reach=10 ** rng.uniform(-1, 0.3))
    rate = 10 ** rng.uniform(1, 4)
    n |= dict(rate=rate, load=rate * n["reach"] * 10 ** rng.uniform(-2, -0.5), k=rate * 10 ** rng.uniform(1, 3))
    n |= dict(c=rng.uniform(0.1, 1) * np.sqrt(n["k"] * n["mass"]), e=rng.uniform(0.2, 0.9))
    return n, float(np.sqrt(n["mass"] / rate) * rng.uniform(0.3, 3))


def runs(simulator: mb.DAESimulator, P: np.ndarray, gap: float) -> tuple[float, np.ndarray]:
    """The processor time of runs with a gap at the start [s], and their outputs; nan for runs that fail."""
    P = P.copy()
    P[:, list(simulator.parameters).index("gap")] = gap
    return median(lambda: simulator.run(P).Y, 7, 5), simulator.run(P).Y


def main() -> None:
    warnings.simplefilter("ignore")
    count, seed = (int(a) for a in (sys.argv[1:] + ["30", "0"][len(sys.argv) - 1 :]))
    rng, bad = np.random.default_rng(seed), 0
    for number in range(count):
        kind, law = KINDS[number % len(KINDS)]
        numbers, span = draw(rng)
        simulator = mb.DAESimulator(scene(kind, law).with_times(np.linspace(0, span, 11)))
        nominal = np.array([numbers.get(name, 0.0) for name in simulator.parameters])
        P = nominal * (1 + 0.03 * rng.uniform(-1, 1, (64, len(nominal))))
        clear, there = runs(simulator, P, CLEAR)
        times, answers = zip(*(runs(simulator, P, gap) for gap in GAPS), strict=True)
        scale = np.ptp(there, axis=(0, 1)).max()
        worst = max(times) / clear
        apart = max(float(np.max(abs(y - answers[0]) / scale)) for y in answers)
        fails = not (worst <= MOST and apart <= SAME)
        bad += fails
        print(
            f"{number:3} {kind:7} {law:9} {clear * 1e3:8.2f} ms, gaps of rounding "
            f"{' '.join(f'{t / clear:5.2f}' for t in times)}, answers apart {apart:.0e}{'  FAILS' if fails else ''}",
            flush=True,
        )
    print(f"{count - bad} of {count} machines are as fast and have the same answers")


if __name__ == "__main__":
    main()
