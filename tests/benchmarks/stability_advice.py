"""Whether `stability` is fooled: all settings that its advice names, against solutions that symmb did not compute.

Each solution is SciPy's DOP853 at 1e-12 on the equations of motion in terms of M, Q, G and gamma, whose multipliers
follow by least squares. Of the pendulum on a spring they are written by hand. Solutions that take longer than five
minutes are left out, and the setting is then not checked.

    PYTHONPATH=.:tests python tests/benchmarks/stability_advice.py [part of a scene's name ...]
"""

import itertools
import re
import sys
import time
from collections.abc import Callable, Iterator
from math import cos, sin

import bricard
import casadi as ca
import numpy as np
from mechanisms import double_pendulum
from scipy.integrate import ode

import symmb as mb
from models import car_axis, heavy_top, stick_slip
from symmb.run.simulation import DAESimulator
from symmb.study.stability import TIMES, Stability
from symmb.study.stress import lighter, stresses
from symmb.study.trials import Trial

GRAVITY, ANGLE = 9.81, 1.0
"""Of the pendulum on a spring, and its angle from the downward vertical at the start [rad]."""
LIMITS = {"To 0.001": 1e-3, "Largest": 0.1, "  ": 1e-3}
"""The errors that the lines of the advice promise, by how they begin."""
ENERGY, PATIENCE = 1e-3, 300.0


def main(parts: list[str]) -> None:
    for name, make, by_hand in scenes():
        if not parts or any(part in name for part in parts):
            begin = time.monotonic()
            found = mb.stability(make())
            print(f"\n{name} ({time.monotonic() - begin:.0f} s)\n{found.advice}")
            for line in verdicts(found, make().with_times(found.times), by_hand):
                print(f"    {line}", flush=True)


def scenes() -> Iterator[tuple[str, Callable[[], mb.Scene], Callable[[str], Callable] | None]]:
    for k in (1e2, 1e4, 1e6, 1e8, 1e10):
        for place, stretch in (("on", GRAVITY * np.cos(ANGLE) / k), ("off", 0.0)):
            yield (
                f"spring pendulum, k = {k:.0e}, {place} the slow manifold",
                lambda k=k, stretch=stretch: spring_pendulum(k, stretch),
                lambda stress, k=k: spring_pendulum_by_hand(k, stress),
            )
    yield "bricard", bricard.scene, None
    yield "heavy top", heavy_top.scene, None
    yield "car axis", car_axis.scene, None
    yield "stick-slip", stick_slip.scene, None
    yield "mass ratio 1e6", lambda: lighter(double_pendulum(np.linspace(0, 5, 101)), 1e6), None


def spring_pendulum(k: float, stretch: float) -> mb.Scene:
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    spring = mb.Spring("spring", mb.Ground().point(0, 0), ball.point(0, 0), k, 1.0)
    system = mb.System(ball, spring, mb.Motion("plane", ball.z, 0), mb.Gravity(0, -GRAVITY))
    x, y = (1 + stretch) * np.sin(ANGLE), -(1 + stretch) * np.cos(ANGLE)
    outputs = {"x": ball.x, "y": ball.y, "vx": ball.vx, "vy": ball.vy}
    return mb.Scene(system, {"ball.x": x, "ball.y": y}, np.linspace(0, 10, 101), outputs)


def spring_pendulum_by_hand(k: float, stress: str) -> Callable:
    """Rates of stretch, angle and both rates: a difference of lengths would lose digits where the spring is stiff."""
    kind, _, factor = stress.rpartition(" x ")
    k = k * float(factor) if kind == "stiffness" else k
    g = GRAVITY / float(factor) ** 2 if kind == "time scale" else GRAVITY

    def rate(_, z):
        stretch, angle, stretching, turning = z
        length = 1.0 + stretch
        return (
            stretching,
            turning,
            length * turning * turning + g * cos(angle) - k * stretch,
            -(2.0 * stretching * turning + g * sin(angle)) / length,
        )

    return rate


def cartesian(z: np.ndarray) -> np.ndarray:
    """x, y, vx, vy of the ball (n_t, 4)."""
    stretch, angle, stretching, turning = z.T
    outward, along = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    length = 1.0 + stretch
    return np.vstack([length * outward, stretching * outward + length * turning * along]).T


def verdicts(found: Stability, scene: mb.Scene, by_hand: Callable[[str], Callable] | None) -> Iterator[str]:
    """A line for each setting that the advice names."""
    made = {"": lambda: scene, **dict(stresses(scene))}
    solutions: dict[str, np.ndarray | None] = {}
    for trial, limit in named(found):
        name = trial.scene
        if name not in solutions:
            solutions[name] = solution(made[name](), by_hand(name) if by_hand else None)
        exact = solutions[name]
        error = np.nan if exact is None else distance(trial.values, exact)
        fooled = error > limit or trial.energy > ENERGY
        verdict = "FOOLED" if fooled else "not checked" if exact is None else "right"
        yield f"{verdict:11}  {name or 'as it is':18} {trial.solver:32} error {error:.1e}, energy {trial.energy:.1e}"


def named(found: Stability) -> Iterator[tuple[Trial, float]]:
    """The settings that the advice names, with the error that it promises."""
    for line in found.advice.splitlines():
        limit = next((limit for begin, limit in LIMITS.items() if line.startswith(begin)), None)
        if limit is None or "no setting is known" in line:
            continue
        stress = re.split(r"  +", line.strip())[0] if line.startswith("  ") else ""
        for trial in found.stress if stress else found.trials:
            text = f"{trial.family} {trial.setting:.2g} s" if line.startswith("Largest") else f"{trial.solver} ("
            if trial.scene == stress and text in line:
                yield trial, limit


def distance(values: np.ndarray, exact: np.ndarray) -> float:
    """Largest over outputs of the root mean square error over the deviation; of constants, over their size."""
    size, deviation = np.abs(exact).max(axis=0), exact.std(axis=0)
    scale = np.where(deviation > 1e-12 * size, deviation, size)
    counted = size > 1e-12 * size.max()
    return float((np.sqrt(np.mean((values - exact) ** 2, axis=0)) / scale)[counted].max())


def solution(scene: mb.Scene, by_hand: Callable | None) -> np.ndarray | None:
    """Outputs at the times (n_t, n_y), None if it takes too long."""
    simulator = DAESimulator(scene, mb.CVODES())
    system, times, p = scene.system, np.linspace(scene.times[0], scene.times[-1], TIMES), simulator.dae.p_nominal
    x0 = simulator.start.states(p[None])[0][0]
    if by_hand:
        x, y = x0[:2]
        found = integrated(by_hand, np.array([np.hypot(x, y) - 1.0, np.arctan2(x, -y), 0.0, 0.0]), times)
        return None if found is None else cartesian(found)
    symbols = [system.q, system.v, system.s, system.p, mb.t]
    parts = ca.Function("parts", symbols, [system.qdot, system.s_rate, system.M, system.Q, system.G, system.gamma])
    outputs = ca.Function("outputs", [*symbols, system.lam, system.vdot], [scene.y])
    n_q, n_v = system.q.numel(), system.v.numel()

    def solved(t, x):
        state = x[:n_q], x[n_q : n_q + n_v], x[n_q + n_v :]
        q_rate, s_rate, M, Q, G, gamma = (part.full() for part in parts.call([*state, p, t]))
        zero = np.zeros((len(gamma), len(gamma)))
        both = solve(np.block([[M, G.T], [G, zero]]), np.concatenate([Q, gamma])[:, 0])
        return state, np.concatenate([q_rate[:, 0], both[:n_v], s_rate[:, 0]]), both

    rows = ca.Function("rows", symbols, [system.Phi, system.Phi_q, system.Phi_dot, system.G])

    def projected(t, x):
        """On the constraints, from which index-reduced equations drift."""
        q, v, s = x[:n_q].copy(), x[n_q : n_q + n_v].copy(), x[n_q + n_v :]
        for _ in range(3 if system.G.shape[0] else 0):
            Phi, Phi_q, Phi_dot, G = (part.full() for part in rows.call([q, v, s, p, t]))
            q -= Phi_q.T @ solve(Phi_q @ Phi_q.T, Phi[:, 0])
            v -= G.T @ solve(G @ G.T, Phi_dot[:, 0])
        return np.concatenate([q, v, s])

    states = integrated(lambda t, x: solved(t, x)[1], x0, times, projected)
    if states is None:
        return None
    values = []
    for t, x in zip(times, states, strict=True):
        state, _, both = solved(t, x)
        values.append(outputs(*state, p, t, both[n_v:], both[:n_v]).full()[:, 0])
    return np.array(values)


def solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """By elimination, which keeps zeros such as coordinates out of a plane, where they may be unstable.

    With redundant rows by least squares.
    """
    try:
        with np.errstate(all="ignore"):
            x = np.linalg.solve(A, b)
        if np.abs(x).max(initial=0.0) < 1e10 and np.allclose(
            A @ x, b, rtol=1e-9, atol=1e-9 * np.abs(b).max(initial=1.0)
        ):
            return x
    except np.linalg.LinAlgError:
        pass
    return np.linalg.lstsq(A, b, rcond=1e-11)[0]


def integrated(
    rate: Callable, x0: np.ndarray, times: np.ndarray, projected: Callable | None = None
) -> np.ndarray | None:
    """States (n_t, n_x), projected at every time, or None if they take too long."""
    end, calls = time.monotonic() + PATIENCE, itertools.count(1)
    late = False

    def timed(t, x):
        nonlocal late
        late = late or (not next(calls) % 1000 and time.monotonic() > end)
        return np.full(len(x), np.nan) if late else rate(t, x)

    solver = ode(timed).set_integrator("dop853", rtol=1e-12, atol=1e-15, nsteps=200_000)
    solver.set_initial_value(x0, times[0])
    states = [np.array(x0)]
    for t in times[1:]:
        states.append(solver.integrate(t))
        if late or not solver.successful():
            return None
        if projected is not None:
            states[-1] = projected(t, states[-1])
            solver.set_initial_value(states[-1], t)
    return np.array(states)


if __name__ == "__main__":
    main(sys.argv[1:])
