"""Random calibrations from starts up to 50 % off: right, doubted or wrong in silence, and how often boxes hold.

    PYTHONPATH=. python tests/benchmarks/calibrations.py [FAMILIES ...] [--seed 0] [--number 20] [--precise]

Chains of masses, vehicles, pendulums, contacts, impacts, friction and switch times, with one to six parameters, noise
of 0.1 to 3 % that is told or not, and outliers in some. Data come from runs with the true parameters. A fit is wrong
in silence if an estimate is more than SIGMAS deviations off and nothing is doubted.

With --precise, the noise of the data is 0, 1e-8 or 0.1 to 3 % of their spread, some parameters have priors, and there
are no outliers. Data of smooth scenes come from a tighter solver, and those of springs and decays from closed forms.
Of 60 calibrations (--number 6), at least 55 must be inside of their 95 % boxes, or be doubted.
"""

import argparse
import time
import warnings
from collections import Counter

import casadi as ca
import numpy as np

import symmb as mb

SIGMAS = 4.5
"""Deviations beyond which an estimate is wrong: of 1,000 right ones less than one is."""


def particle(name, mass):
    return mb.Body(name, mass, pose=mb.Particle())


def chain(rng):
    """One to three masses between springs with dampers, which oscillate some three to ten times."""
    n = int(rng.integers(1, 4))
    truth = {f"k{i}": rng.uniform(5, 20) for i in range(n)} | {f"c{i}": rng.uniform(0.02, 0.3) for i in range(n)}

    def scene(values):
        p, ground = mb.Parameters(**values), mb.Ground()
        masses = [particle(f"m{i}", 1.0) for i in range(n)]
        ends = [ground.point(0, 0), *(m.point(0, 0) for m in masses)]
        springs = [
            mb.SpringDamper(f"s{i}", ends[i], ends[i + 1], getattr(p, f"k{i}"), getattr(p, f"c{i}"), 1.0)
            for i in range(n)
        ]
        start = {f"m{i}.x": 1.0 + i + 0.3 * (i + 1 == n) for i in range(n)} | {f"m{i}.y": 0.0 for i in range(n)}
        outputs = {f"x{i}": m.x for i, m in enumerate(masses)}
        return mb.Scene(mb.System(*masses, *springs, parameters=p), start, np.linspace(0, 8, 121), outputs)

    return scene, truth


def quarter_car(rng):
    """Wheel and body over a step of 50 mm at 0.2 s."""
    truth = dict(
        body=rng.uniform(250, 400),
        spring=rng.uniform(1e4, 2e4),
        damper=rng.uniform(800, 2000),
        tyre=rng.uniform(1.5e5, 2.5e5),
    )

    def scene(values):
        p = mb.Parameters(**values)
        body, wheel = particle("body", p.body), particle("wheel", 40.0)
        road = 0.025 * (1 + ca.tanh((mb.t - 0.2) / 0.02))
        lift = p.spring * (wheel.y - body.y) + p.damper * (wheel.vy - body.vy)
        suspension = mb.Force("suspension", body.point(0, 0), (0, lift))
        reaction = mb.Force("reaction", wheel.point(0, 0), (0, p.tyre * (road - wheel.y) - lift))
        system = mb.System(body, wheel, suspension, reaction, parameters=p)
        outputs = {"body": body.y, "wheel": wheel.y}
        return mb.Scene(system, {"body.y": 0.0, "wheel.y": 0.0}, np.linspace(0, 3, 151), outputs)

    return scene, truth


def pendulum(rng):
    """The lengths of two rods, from the angle of the first and the place of the second one's end."""
    truth = dict(l1=rng.uniform(0.8, 1.2), l2=rng.uniform(0.8, 1.2))

    def scene(values):
        p, ground = mb.Parameters(**values), mb.Ground()
        rods = [
            mb.Body(f"rod{i}", getattr(p, f"l{i}"), getattr(p, f"l{i}") ** 3 / 12, pose=mb.Planar()) for i in (1, 2)
        ]
        ends = [[rod.point(side * getattr(p, f"l{i}") / 2, 0) for side in (-1, 1)] for i, rod in enumerate(rods, 1)]
        first = mb.Revolute("first", ground.point(0, 0), ends[0][0])
        second = mb.Revolute("second", ends[0][1], ends[1][0])
        system = mb.System(*rods, first, second, mb.Gravity(0, -9.81), parameters=p)
        start = {"rod1.theta": 0.3, "rod2.theta": -0.2}
        return mb.Scene(system, start, np.linspace(0, 2, 81), {"angle": rods[0].theta, "x": rods[1].x})

    return scene, truth


def floor(rng):
    """A ball that falls on a compliant floor, by an `if_else` of its height or a contact."""
    truth = dict(k=rng.uniform(1e3, 4e3), c=rng.uniform(1, 5), m=rng.uniform(0.3, 0.8))
    is_contact = bool(rng.integers(2))

    def scene(values):
        p = mb.Parameters(**values)
        ball = particle("ball", p.m)
        touch = (
            mb.Contact("floor", ball.point(0, 0), mb.Ground().point(0, 0), (0, 1), mb.KelvinVoigt(p.k, p.c))
            if is_contact
            else mb.Force("floor", ball.point(0, 0), (0, ca.if_else(ball.y < 0, -p.k * ball.y - p.c * ball.vy, 0)))
        )
        push = mb.Force("weight", ball.point(0, 0), (0, -4.9))  # of known size: the mass shows
        system = mb.System(ball, touch, push, parameters=p)
        return mb.Scene(system, {"ball.y": 1.0}, np.linspace(0, 3, 151), {"y": ball.y})

    return scene, truth


def switch(rng):
    """A mass on a spring that is pushed from one time to another."""
    truth = dict(k=rng.uniform(10, 40), c=rng.uniform(0.2, 0.8), on=rng.uniform(0.8, 2.0), push=rng.uniform(0.5, 2))

    def scene(values):
        p = mb.Parameters(**values)
        mass = particle("mass", 1.0)
        push = ca.if_else(mb.t > p.on, p.push, 0.0)
        law = mb.Force("push", mass.point(0, 0), (-p.k * mass.x - p.c * mass.vx + push, -mass.y))
        return mb.Scene(mb.System(mass, law, parameters=p), {"mass.x": 0.2}, np.linspace(0, 5, 101), {"x": mass.x})

    return scene, truth


def impacts(rng):
    """A ball that bounces with restitution."""
    truth = dict(e=rng.uniform(0.4, 0.65), g=rng.uniform(6, 12))

    def scene(values):
        p = mb.Parameters(**values)
        ball = particle("ball", 1.0)
        ground = mb.Impact("floor", ball.y, restitution=p.e)
        system = mb.System(ball, ground, mb.Gravity(0, -p.g), parameters=p)
        return mb.Scene(system, {"ball.y": 1.0}, np.linspace(0, 1.6, 81), {"y": ball.y})

    return scene, truth


def friction(rng):
    """A mass on a spring that dry friction slows."""
    truth = dict(k=rng.uniform(10, 40), f=rng.uniform(0.1, 0.4))

    def scene(values):
        p = mb.Parameters(**values)
        mass = particle("mass", 1.0)
        law = mb.Force("law", mass.point(0, 0), (-p.k * mass.x - p.f * ca.tanh(mass.vx / 1e-2), -mass.y))
        return mb.Scene(mb.System(mass, law, parameters=p), {"mass.x": 0.5}, np.linspace(0, 4, 101), {"x": mass.x})

    return scene, truth


def spring(rng):
    """A mass on a spring, of which the data determine the ratio of stiffness and mass."""
    truth = dict(m=rng.uniform(0.5, 2), k=rng.uniform(4, 12), a=rng.uniform(0.2, 0.6))

    def scene(values):
        p = mb.Parameters(**values)
        mass = particle("mass", p.m)
        law = mb.Spring("spring", mb.Ground().point(0, 0), mass.point(0, 0), p.k)
        return mb.Scene(mb.System(mass, law, parameters=p), {"mass.x": p.a}, np.linspace(0, 3, 61), {"x": mass.x})

    return scene, truth


def spring_function(rng):
    """The same as a function."""
    _, truth = spring(rng)
    t = np.linspace(0, 3, 61)
    return lambda values: mb.FunctionSimulator(lambda m, k, a: a * np.cos(np.sqrt(k / m) * t), values, t, ["x"]), truth


def decays(rng):
    """A sum of two decays and a constant as a function, as in many of NIST's problems."""
    truth = dict(a=rng.uniform(1, 2), b=rng.uniform(1, 2), fast=rng.uniform(2, 3), slow=rng.uniform(0.3, 0.6), c=0.5)
    t = np.linspace(0, 5, int(rng.integers(16, 60)))

    def run(a, b, fast, slow, c):
        return a * np.exp(-fast * t) + b * np.exp(-slow * t) + c

    return lambda values: mb.FunctionSimulator(run, values, t, ["y"]), truth


FAMILIES = {f.__name__: f for f in (chain, quarter_car, pendulum, floor, switch, impacts, friction)}
PRECISE = FAMILIES | {f.__name__: f for f in (spring, spring_function, decays)}
TIGHT = {chain, quarter_car, pendulum}


def exact_outputs(name, build, truth, is_precise):
    """The outputs (n_t,) of the true parameters by name."""
    if name in ("spring", "spring_function"):
        t = np.linspace(0, 3, 61)
        return {"x": truth["a"] * np.cos(np.sqrt(truth["k"] / truth["m"]) * t)}
    if name == "decays":
        return {"y": build(truth).run(np.array([[*truth.values()]])).Y[0, :, 0]}
    solver = mb.CVODES(rtol=1e-12, atol=1e-14) if is_precise and PRECISE[name] in TIGHT else None
    run = mb.simulate(build(truth), solver)
    return {n: run[n] for n in run.names}


def outcome(name, rng, is_precise=False):
    """What a random calibration comes to, whether its box holds the truth, and a line about it."""
    build, truth = PRECISE[name](rng)
    names = [*truth]
    free = sorted(rng.choice(len(names), int(rng.integers(1, len(names) + 1)), replace=False))
    nominal = {n: v * (rng.uniform(0.5, 1.5) if i in free else 1.0) for i, (n, v) in enumerate(truth.items())}
    run, scene = exact_outputs(name, build, truth, is_precise), build(nominal)
    level, priors = 10 ** rng.uniform(-3, -1.5), {}
    if is_precise:
        level = rng.choice([0.0, 1e-8, level])
        for i in free:
            if rng.random() < 0.4:
                size = abs(truth[names[i]]) * 10 ** rng.uniform(-3, -1)
                priors[names[i]] = (truth[names[i]] + size * rng.standard_normal(), size)
    noise = {n: level * float(np.ptp(run[n])) for n in run}
    data = {n: run[n] + noise[n] * rng.standard_normal(len(run[n])) for n in noise}
    has_outliers, is_told = rng.random() < 0.15 and not is_precise, rng.random() < 0.5 and level > 0
    if has_outliers:
        some = next(iter(data))
        data[some][rng.integers(len(run[some]), size=2)] += 30 * noise[some]
    begin, where = time.process_time(), f"{name} {[names[i] for i in free]} noise {level:.2g} priors of {[*priors]}"
    try:
        fit = mb.calibrate(scene, data, [names[i] for i in free], noise=noise if is_told else None, priors=priors)
    except mb.SymmbError as error:
        return "refused", None, f"{where}: {error}"
    off = max(abs(fit.parameters[n] - truth[n]) / fit.deviations[n] for n in fit.parameters)
    is_open = name.startswith("spring") and {"m", "k"} <= {*fit.parameters} and not {"m", "k"} & {*priors}
    doubts, is_right = fit.doubts, off < SIGMAS
    if is_open:  # only the ratio is determined
        return "right" if fit.undetermined else "WRONG", None, f"{where}: {' '.join(doubts)}"
    kind = ("needlessly doubted" if is_right else "doubted") if doubts and not has_outliers else "right"
    kind = kind if is_right or doubts else "WRONG"
    if has_outliers and not any("outlier" in doubt for doubt in doubts):
        kind = "OUTLIERS PASS"
    held = None
    if not doubts:
        box = fit.box(0.95)
        held = all(low <= truth[n] <= high for n, (low, high) in zip(box.names, box.bounds, strict=True))
    seconds = time.process_time() - begin
    return kind, held, f"{where}: {off:.1f} sigma, {fit.evaluations} runs, {seconds:.1f} s, {' '.join(doubts)}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="*")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--number", type=int, default=20, help="of calibrations of each family")
    parser.add_argument("--precise", action="store_true")
    asked = parser.parse_args()
    warnings.simplefilter("ignore", mb.SymmbWarning)
    kinds, holds = Counter(), Counter()
    for family in asked.families or (PRECISE if asked.precise else FAMILIES):
        for k in range(asked.number):
            kind, held, line = outcome(family, np.random.default_rng([asked.seed, k, *family.encode()]), asked.precise)
            kinds[kind] += 1
            holds[held] += 1
            if kind != "right" or (asked.precise and held is False):
                print(f"{kind}: {k} {line}", flush=True)
    print(dict(kinds), f"boxes of 95 % hold the truth in {holds[True]} of {holds[True] + holds[False]}")
