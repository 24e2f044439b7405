"""Proved motions that pass switches of the state against SciPy's integrators, which restart at each pass.

    python tests/benchmarks/switch_proofs.py [number] [first seed] [samples]

Pendulums with a spring beyond an angle, drag by v |v|, masses that meet a buffer with and without a jump of the force,
dry friction that reverses or sticks, and forces that switch at a place and a time that parameters move. It prints how
many values are outside of their bounds, which must be none, until when motions are proved, and the excess of widths.
"""

import sys
import time
import warnings
from itertools import product
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[2]))
import symmb as mb

INSIDE = 1e-10
"""Least distance outside of bounds, over the size of an output, that is no rounding of the reference."""


def mass(times, law, start, nominal):
    """A mass of 1 kg under a force law(p, x, v, t), with its place, its speed and the force as outputs."""
    p = mb.Parameters(**nominal)
    body = mb.Body("m", 1.0, pose=mb.Particle())
    force = law(p, body.x, body.vx, mb.t)
    system = mb.System(body, mb.Force("f", body.point(0, 0), (force, 0)), parameters=p)
    begin = {"m.x": start[0], "m.vx": start[1]}
    return mb.Scene(system, begin, times, {"x": body.x, "v": body.vx, "force": force})


def pendulum(rng, times):
    """A rod with a spring that acts beyond an angle: (I + m / 4) angle'' = - m g / 2 cos(angle) - torque."""
    k, a = rng.uniform(5, 40), rng.uniform(-1.3, -0.9)
    p = mb.Parameters(k=k, a=a)
    arm = mb.Body("arm", 1.0, 0.1)
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), arm.point(-0.5, 0), axis=(0, 0, 1))
    torque = -p.k * ca.fmax(arm.theta - p.a, 0) - 0.1 * arm.omega
    system = mb.System(arm, hinge, mb.Torque("t", arm, torque), mb.Gravity(0, -9.81), parameters=p)
    angle = -np.pi / 2 - rng.uniform(0.5, 1.0)
    scene = mb.Scene(system, {"arm.theta": angle, "arm.omega": 0.0}, times,
                     {"x": arm.theta, "v": arm.omega, "force": torque})  # fmt: skip

    def force(t, x, v, p, side):
        return -p[0] * (x - p[1]) * (side > 0) - 0.1 * v

    return scene, force, lambda t, x, v, p: x - p[1], lambda t, x, v, p, f: (f - 4.905 * np.cos(x)) / 0.35, (angle, 0.0)


def free(t, x, v, p, f):
    """The acceleration of a mass of 1 kg."""
    return f


def drag(rng, times):
    """A spring and drag by v |v|, whose rate bends at each reversal."""
    k, c, x, v = rng.uniform(2, 20), rng.uniform(0.1, 1), rng.uniform(0.5, 1), rng.uniform(0.5, 2)
    scene = mass(times, lambda p, x, v, t: -p.k * x - p.c * v * ca.fabs(v), (x, v), {"k": k, "c": c})
    return scene, lambda t, x, v, p, side: -p[0] * x - p[1] * v * v * side, lambda t, x, v, p: v, free, (x, v)


def buffer(rng, times):
    """A mass that rolls against a buffer, whose force may jump, and perhaps back."""
    jump, c, pull = rng.choice([0, 1]) * rng.uniform(0.2, 3), rng.uniform(0, 1), rng.uniform(-0.5, 1)
    k, a, v = rng.uniform(3, 60), rng.uniform(0.3, 0.6), rng.uniform(1, 3)
    scene = mass(times, lambda p, x, v, t: pull - ca.if_else(x > p.a, p.k * (x - p.a) + c * v + jump, 0), (0.0, v),
                 {"k": k, "a": a})  # fmt: skip

    def force(t, x, v, p, side):
        return pull - (side > 0) * (p[0] * (x - p[1]) + c * v + jump)

    return scene, force, lambda t, x, v, p: x - p[1], free, (0.0, v)


def friction(rng, times):
    """Dry friction of a mass on a spring: it reverses, or sticks."""
    k, mu, x, v = rng.uniform(2, 15), rng.uniform(0.3, 3), rng.uniform(0.2, 1), rng.uniform(0.5, 2)
    scene = mass(times, lambda p, x, v, t: -p.k * x - p.mu * ca.sign(v), (x, v), {"k": k, "mu": mu})
    return scene, lambda t, x, v, p, side: -p[0] * x - p[1] * side, lambda t, x, v, p: v, free, (x, v)


def place(rng, times):
    """A force that begins where two parameters say, at x + w t = a, for one that starts at its own speed."""
    a, w, v, push = rng.uniform(0.3, 0.8), rng.uniform(-0.5, 0.5), rng.uniform(0.8, 2), rng.uniform(-3, 3)
    scene = mass(times, lambda p, x, v, t: ca.sin(2 * t) + ca.if_else(x + p.w * t < p.a, 0, push * x), (0.0, v),
                 {"a": a, "w": w})  # fmt: skip
    return (scene, lambda t, x, v, p, side: np.sin(2 * t) + (side > 0) * push * x,
            lambda t, x, v, p: x + p[1] * t - p[0], free, (0.0, v))  # fmt: skip


KINDS = pendulum, drag, buffer, friction, place


def run(force, switch, acceleration, start, times, p):
    """Outputs (n_t, 3) for parameters p, not numbers from the time on at which it sticks."""
    t, z, Y = times[0], np.array(start), np.full((len(times), 3), np.nan)
    rates = [lambda t, z, side=side: [z[1], acceleration(t, *z, p, force(t, *z, p, side))] for side in (-1, 1)]

    def of(side):
        return rates[int(side > 0)]

    def slope(t, z, side, h=1e-6):
        ahead = np.array(z) + h * np.array(of(side)(t, z))
        return (switch(t + h, *ahead, p) - switch(t, *z, p)) / h

    side = np.sign(switch(t, *z, p)) or np.sign(slope(t, z, 1))
    while True:
        own = np.flatnonzero(times >= t)

        def event(t, z):
            return switch(t, *z, p)

        event.terminal, event.direction = True, -side
        found = solve_ivp(of(side), (t, times[-1]), z, "DOP853", times[own], events=event, rtol=1e-13, atol=1e-14)
        for k, (when, state) in enumerate(zip(found.t, found.y.T, strict=True)):
            Y[own[k]] = *state, force(when, *state, p, side)
        if found.status != 1:
            return Y
        t, z, side = found.t_events[0][0], found.y_events[0][0], -side
        if slope(t, z, side) * side <= 1e-5 or (times[-1] - t) < 1e-12:
            return Y


def judged(seed, samples, order=None):
    """(wrong, proved share of the horizon, excess, seconds, text) of one scene.

    Where a sample sticks to a switch, nothing must be proved.
    """
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, float(rng.uniform(0.5, 2.0)), 41)
    scene, *laws = KINDS[seed % len(KINDS)](rng, times)
    box = mb.Box.around(scene.system.parameters, float(rng.choice([0.002, 0.01, 0.03])))
    names = list(box.names)
    if rng.random() < 0.3:
        name = str(rng.choice(names))
        box = mb.Box(**{name: (box.lower[names.index(name)], box.upper[names.index(name)])})
    order, begin = order or int(rng.integers(2, 7)), time.process_time()
    bounds = mb.propagate(scene, mb.TaylorModel(order=order), box)
    seconds = time.process_time() - begin
    d, nominal = len(box), mb.Box.around(scene.system.parameters, 0.1).center
    P = np.tile(nominal, (samples, 1))
    corners = np.array([*product((-1.0, 1.0), repeat=d)])
    xi = np.vstack([corners, rng.uniform(-1, 1, (samples - len(corners), d))])
    P[:, [names.index(name) for name in box.names]] = box.from_unit(xi)
    Y = np.array([run(*laws, times, p) for p in P])
    size, finite = np.nanmax(np.abs(Y), axis=(0, 1)), np.isfinite(bounds.upper)
    outside = (bounds.lower - INSIDE * size > Y) | (bounds.upper + INSIDE * size < Y)
    wrong = int((finite & (np.isnan(Y) | outside)).sum())
    reached = np.ptp(Y, axis=0)
    with np.errstate(all="ignore"):
        excess = np.where(finite & (reached > 1e-6 * size), (bounds.upper - bounds.lower) / reached - 1, 0.0)
    return wrong, float(finite.all(axis=1).mean()), excess.max(axis=0), seconds, " ".join(bounds.doubts)


def main() -> None:
    number, first, samples = (
        int(sys.argv[i]) if len(sys.argv) > i else default for i, default in ((1, 30), (2, 0), (3, 60))
    )
    warnings.simplefilter("ignore", mb.SymmbWarning)
    total = whole = 0
    for seed in range(first, first + number):
        wrong, share, excess, seconds, text = judged(seed, samples)
        total, whole = total + wrong, whole + (share == 1)
        kind, of = KINDS[seed % len(KINDS)].__name__, ", ".join(f"{value:.0e}" for value in excess)
        print(f"seed {seed} ({kind}): {wrong} outside, {share:.0%} proved, excess {of}, {seconds:.1f} s. {text}",
              flush=True)  # fmt: skip
    print(f"{total} outside of their bounds; {whole} of {number} proved to the end")


if __name__ == "__main__":
    main()
