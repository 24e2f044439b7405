"""Proved frequencies, damping and critical forces of random mechanisms against eigenvalues of their matrices by NumPy.

    python tests/benchmarks/mode_proofs.py [number] [first seed]

Chains of masses with springs and dampers, pendulums of several rods, parallelograms, and columns under a force that
follows. It prints how many values are outside of their bounds, which must be none, and the excess of the widths.
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[1]))
from columns import ziegler

import symmb as mb

POINTS = 400


def chain(rng):
    """Masses in a row between two walls: M x'' + C x' + K x = 0."""
    n = int(rng.integers(1, 5))
    masses, springs, dampers = rng.uniform(0.5, 3, n), rng.uniform(20, 900, n + 1), rng.choice([0, 1], n + 1)
    dampers = dampers * rng.uniform(0.1, 2, n + 1)
    p = mb.Parameters(k=float(springs[0]), m=float(masses[-1]), c=1.0)
    k, m, c = [p.k, *springs[1:]], [*masses[:-1], p.m], [p.c * d for d in dampers]
    bodies = [mb.Body(f"b{i}", mass=m[i], pose=mb.Particle()) for i in range(n)]
    x = [0.0, *(body.x for body in bodies), 0.0]
    v = [0.0, *(body.vx for body in bodies), 0.0]
    elements = list(bodies)
    for i, body in enumerate(bodies, start=1):
        pull = -k[i - 1] * (x[i] - x[i - 1]) - c[i - 1] * (v[i] - v[i - 1])
        pull += k[i] * (x[i + 1] - x[i]) + c[i] * (v[i + 1] - v[i])
        elements.append(mb.Force(f"f{i}", body.point(0, 0, 0), (pull, -1e6 * body.y, -2e6 * body.z)))

    def exact(values):
        own_k, own_c = np.array([values[0], *springs[1:]]), values[2] * dampers
        M = np.diag([*masses[:-1], values[1]])
        K, C = (np.diag(a[:-1] + a[1:]) - np.diag(a[1:-1], 1) - np.diag(a[1:-1], -1) for a in (own_k, own_c))
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        return np.linalg.eigvals(A)

    return mb.Scene(mb.System(*elements, parameters=p)), exact, n


def pendulum(rng):
    """Point masses on rods without mass that hang in a row: mass matrices of small angles."""
    n = int(rng.integers(1, 4))
    lengths, masses = rng.uniform(0.4, 1.5, n), rng.uniform(0.5, 2, n)
    p = mb.Parameters(l=float(lengths[0]), m=float(masses[-1]))
    own_l, own_m = [p.l, *lengths[1:]], [*masses[:-1], p.m]
    ground, elements, start, y = mb.Ground(), [mb.Gravity(0, -9.81)], {}, 0.0
    above = ground.point(0, 0)
    for i in range(n):
        body = mb.Body(f"b{i}", mass=own_m[i], inertia=1e-3, pose=mb.Planar())
        y = y - own_l[i]
        start[f"b{i}.y"] = y
        elements += [body, mb.Revolute(f"r{i}", above, body.point(0, own_l[i]))]
        above = body.point(0, 0)

    def exact(values):
        length, mass = np.array([values[0], *lengths[1:]]), np.array([*masses[:-1], values[1]])
        below = np.cumsum(mass[::-1])[::-1]
        M = np.array([[below[max(i, j)] * length[i] * length[j] for j in range(n)] for i in range(n)]) + 1e-3 * np.eye(
            n
        )
        squares = np.linalg.eigvals(np.linalg.solve(M, np.diag(9.81 * below * length)))
        return 1j * np.sqrt(squares.astype(complex))

    return mb.Scene(mb.System(*elements, parameters=p), start=start), exact, n


def parallelogram(rng):
    """Two rods of mass m carry a plate of mass M, which does not turn."""
    width, M, c = rng.uniform(0.3, 2), rng.uniform(0.5, 4), rng.uniform(0, 0.5)
    p, ground = mb.Parameters(l=float(rng.uniform(0.5, 2)), m=float(rng.uniform(0.3, 2))), mb.Ground()
    plate = mb.Body("plate", mass=M, inertia=0.3, pose=mb.Planar())
    elements, start = [plate, mb.Gravity(0, -9.81)], {"plate.y": -p.l}
    for name, x in (("a", -width / 2), ("b", width / 2)):
        rod = mb.Body(name, mass=p.m, inertia=p.m * p.l**2 / 12, pose=mb.Planar())
        start |= {f"{name}.x": x, f"{name}.y": -p.l / 2}
        elements += [rod, mb.Revolute(f"u{name}", ground.point(x, 0), rod.point(0, p.l / 2))]
        elements += [mb.Revolute(f"l{name}", rod.point(0, -p.l / 2), plate.point(x, 0))]
    elements.append(mb.Force("drag", plate.point(0, 0), (-c * plate.vx, 0)))

    def exact(values):
        length, m = values
        inertia = (2 * m / 3 + M) * length**2
        return np.roots([inertia, c * length**2, 9.81 * length * (m + M)])

    return mb.Scene(mb.System(*elements, parameters=p), start=start), exact, 1


def judged_column(rng):
    """The same of a critical force."""
    column, exact = ziegler(rng, float(rng.uniform(0.1, 1.0)))
    box = mb.Box.around(column.system.parameters, float(rng.choice([0.01, 0.05])), ["k", "m"])
    limit, begin = mb.critical(column, "F", (0.1, 60.0)), time.process_time()
    bounds = mb.propagate(limit, mb.TaylorModel(int(rng.integers(4, 8))), box)
    seconds = time.process_time() - begin
    P = box.from_unit(np.vstack([rng.uniform(-1, 1, (30, 2)), rng.choice([-1, 1], (30, 2))]))
    Y, lower, upper = np.array([exact(*point) for point in P]), bounds.lower.item(), bounds.upper.item()
    wrong = int(((lower - 1e-10 > Y) | (upper + 1e-10 < Y)).sum())
    return wrong, (upper - lower) / np.ptp(Y) - 1, seconds, " ".join(bounds.doubts)


def judged(seed):
    """(wrong, excess, seconds, doubt) of one mechanism."""
    rng = np.random.default_rng(seed)
    if seed % 4 == 3:
        return judged_column(rng)
    scene, exact, n = (chain, pendulum, parallelogram)[seed % 4](rng)
    parameters = scene.system.parameters
    box = mb.Box.around(parameters, float(rng.choice([0.01, 0.05, 0.1])))
    modal, begin = mb.ModalSimulator(scene, count=n), time.process_time()
    bounds = mb.propagate(modal, mb.TaylorModel(int(rng.integers(4, 8))), box)
    seconds = time.process_time() - begin
    d = len(box)
    P = box.from_unit(np.vstack([rng.uniform(-1, 1, (POINTS // 2, d)), rng.choice([-1, 1], (POINTS // 2, d))]))
    values = [exact(point) for point in P]
    own = np.array([sorted(each[each.imag > 1e-9], key=abs)[: len(modal.outputs) // 2] for each in values])
    Y = np.concatenate([np.abs(own) / (2 * np.pi), -own.real / np.abs(own)], axis=1)
    rounding = 1e-11 * np.abs(own).max() / np.concatenate([np.full_like(own.real, 1), np.abs(own)], axis=1)
    wrong = int(((bounds.lower[0] - rounding > Y) | (bounds.upper[0] + rounding < Y)).sum())
    reached = np.ptp(Y, axis=0)
    with np.errstate(invalid="ignore"):
        excess = np.where(reached > 1e-9, (bounds.upper[0] - bounds.lower[0]) / np.maximum(reached, 1e-300) - 1, 0.0)
    return wrong, float(excess.max()), seconds, " ".join(bounds.doubts)


def main() -> None:
    number, first = (int(sys.argv[i]) if len(sys.argv) > i else default for i, default in ((1, 30), (2, 0)))
    warnings.simplefilter("ignore", mb.SymmbWarning)
    total = 0
    for seed in range(first, first + number):
        wrong, excess, seconds, doubt = judged(seed)
        total += wrong
        print(f"seed {seed}: {wrong} outside, excess {excess:.1e}, {seconds:.1f} s. {doubt}", flush=True)
    print(f"{total} outside of their bounds")


if __name__ == "__main__":
    main()
