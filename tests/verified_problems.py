"""Problems of verified integration with many uncertain numbers, from the ARCH competition for nonlinear systems.

Source: Geretti et al., ARCH-COMP category report: continuous and hybrid systems with nonlinear dynamics, EPiC Series in
Computing, 2020 (LALO20, QUAD20), 2021 (LOVO21), 2023 (CVDP23) and 2025 (ROBE25).
"""

import casadi as ca
import enclosure_samples
import numpy as np

import symmb as mb


def ode(name, names, rates, start, outputs, times, box, parameters=None):
    """A scene of first-order states. `outputs` is a function of the values of the states."""
    states = mb.States(names, rates)
    named = dict(zip(names, start, strict=True))
    system = mb.System(states, **({} if parameters is None else {"parameters": parameters}))
    return mb.Scene(system, named, times, outputs(*(state.value for state in states)), box=box, name=name)


def laub_loomis(spread, end=20.0):
    """Seven concentrations, each of them uncertain by `spread` at the start."""
    begin = (1.2, 1.05, 1.5, 2.4, 1.0, 0.1, 0.45)
    p = mb.Parameters(**{f"c{k}": value for k, value in enumerate(begin, 1)})

    def rates(a, b, c, d, e, f, g):
        return (1.4 * c - 0.9 * a, 2.5 * e - 1.5 * b, 0.6 * g - 0.8 * b * c, 2 - 1.3 * c * d, 0.7 * a - d * e,
                0.3 * a - 3.1 * f, 1.8 * f - 1.6 * b * g)  # fmt: skip

    names = [f"x{k}" for k in range(1, 8)]
    box = mb.Box(**{f"c{k}": (value - spread, value + spread) for k, value in enumerate(begin, 1)})
    start = [getattr(p, f"c{k}") for k in range(1, 8)]
    times = np.linspace(0.0, end, 1 + round(5 * end))
    return ode("LALO20", names, rates, start, lambda *x: {"x4": x[3]}, times, box, p)


def quadrotor(spread=0.4, end=5.0):
    """Twelve states of a quadrotor that rises to a height of 1 m. Position and velocity are uncertain by `spread`."""
    g, R, arm, rotor, hull = 9.81, 0.1, 0.5, 0.1, 1.0
    m = hull + 4 * rotor
    Jx = 2 / 5 * hull * R**2 + 2 * arm**2 * rotor
    Jz = 2 / 5 * hull * R**2 + 4 * arm**2 * rotor
    p = mb.Parameters(**{f"c{k}": 0.0 for k in range(1, 7)})

    def rates(_north, _east, h, u, v, w, roll, pitch, yaw, p, q, r):
        s, c = ca.sin, ca.cos
        lift = m * g - 10 * (h - 1) + 3 * w
        return (
            c(pitch) * c(yaw) * u + (s(roll) * s(pitch) * c(yaw) - c(roll) * s(yaw)) * v
            + (c(roll) * s(pitch) * c(yaw) + s(roll) * s(yaw)) * w,
            c(pitch) * s(yaw) * u + (s(roll) * s(pitch) * s(yaw) + c(roll) * c(yaw)) * v
            + (c(roll) * s(pitch) * s(yaw) - s(roll) * c(yaw)) * w,
            s(pitch) * u - s(roll) * c(pitch) * v - c(roll) * c(pitch) * w,
            r * v - q * w - g * s(pitch),
            p * w - r * u + g * c(pitch) * s(roll),
            q * u - p * v + g * c(pitch) * c(roll) - lift / m,
            p + s(roll) * ca.tan(pitch) * q + c(roll) * ca.tan(pitch) * r,
            c(roll) * q - s(roll) * r,
            s(roll) / c(pitch) * q + c(roll) / c(pitch) * r,
            ((Jx - Jz) * q * r - roll - p) / Jx,
            ((Jz - Jx) * p * r - pitch - q) / Jx,
            0 * p,
        )  # fmt: skip

    names = [f"x{k}" for k in range(1, 13)]
    start = [*(getattr(p, f"c{k}") for k in range(1, 7)), *[0.0] * 6]
    box = mb.Box(**{f"c{k}": (-spread, spread) for k in range(1, 7)})
    times = np.linspace(0.0, end, 1 + round(20 * end))
    return ode("QUAD20", names, rates, start, lambda *x: {"height": x[2]}, times, box, p)


def lotka_volterra(end=3.64):
    """Prey x and hunters y, with x = 1.3 +- 0.012 at the start."""
    p = mb.Parameters(x0=1.3)
    rates = lambda x, y: (3 * x - 3 * x * y, x * y - y)  # noqa: E731
    box, times = mb.Box(x0=(1.288, 1.312)), np.linspace(0.0, end, 92)
    return ode("LOVO21", ["x", "y"], rates, [p.x0, 1.0], lambda x, y: {"x": x, "y": y}, times, box, p)


def robertson(beta, gamma, end=40.0):
    """A stiff chemical reaction without uncertain numbers. The sum of the states is 1."""
    p = mb.Parameters(a=0.4)
    rates = lambda x, y, z: (-p.a * x + beta * y * z, p.a * x - beta * y * z - gamma * y**2, gamma * y**2)  # noqa: E731
    outputs = lambda x, y, z: {"sum": x + y + z, "x": x}  # noqa: E731
    box, times = mb.Box(a=(0.4, 0.4)), np.linspace(0.0, end, 41)
    return ode("ROBE25", ["x", "y", "z"], rates, [1.0, 0.0, 0.0], outputs, times, box, p)


def van_der_pols(end=7.0, b=(1.0, 3.0)):
    """Two coupled van der Pol oscillators with an uncertain coupling b and uncertain starts."""
    p = mb.Parameters(b=2.0, a1=1.4, b1=2.4, a2=1.4, b2=2.4)

    def rates(x, y, u, v):
        return (y, (1 - x**2) * y + p.b * (u - x) - x, v, (1 - u**2) * v - p.b * (u - x) - u)

    box = mb.Box(b=b, a1=(1.25, 1.55), b1=(2.35, 2.45), a2=(1.25, 1.55), b2=(2.35, 2.45))
    outputs = lambda x, y, u, v: {"y1": y, "y2": v}  # noqa: E731
    return ode("CVDP23", ["x1", "y1", "x2", "y2"], rates, [p.a1, p.b1, p.a2, p.b2], outputs,
               np.linspace(0.0, end, 141), box, p)  # fmt: skip


def random_system(seed):
    """Random smooth rates of two to six states with three to twelve uncertain start values and parameters."""
    rng = np.random.default_rng(seed)
    d, n = int(rng.integers(3, 13)), int(rng.integers(2, 7))
    begin = int(rng.integers(0, min(d, n) + 1))  # number of uncertain start values
    c, radius, middle = rng.uniform(-1, 1, (n, 10)), 10 ** rng.uniform(-3, -0.8, d), rng.uniform(-1, 1, d)

    def rates(x, p, t):
        a, b, z = x[0], x[1], x[n - 1]
        own = [p[k] for k in range(begin, d)] or [ca.SX(0.3)]
        features = [a, b, a * z, ca.sin(a + sum(own)), ca.exp(-(b**2)), own[0] * own[-1] * z, a / (2 + ca.cos(b)),
                    ca.cos(2 * t) * sum(own), ca.sqrt(1 + z**2), x[n // 2]]  # fmt: skip
        return [sum(k * g for k, g in zip(row, features, strict=True)) for row in c]

    times = np.linspace(0, rng.choice([0.5, 1.5, 3.0]), 7)
    start = lambda p: [p[k] if k < begin else 0.2 * k + 0.05 * p[d - 1] for k in range(n)]  # noqa: E731
    return enclosure_samples.ode(rates, start, np.stack([middle - radius, middle + radius], axis=1), times)


def random_oscillator(seed, wide=False):
    """A pendulum, a hardening or a linear spring over 4 to 12 periods, with three to five uncertain numbers.

    Their frequency, amplitude, stiffness, damping and first rate are uncertain. Every fourth one is driven a little.
    """
    rng = np.random.default_rng(seed)
    kind, d = rng.integers(3), int(rng.integers(3, 6))
    spread = 10 ** rng.uniform(*((-1.9, -1.1) if wide else (-2.7, -1.7))) / d
    middle = rng.uniform([1, 0.5, 0.2, 0.0, -0.3], [3, 2.0, 1.0, 0.05, 0.3])
    radius = np.where(np.arange(5) < d, spread * np.array([1, 1, 1, 0.2, 0.5]), 0.0)

    def rates(x, p, t):
        force = [ca.sin(x[0]), x[0] + p[2] * x[0] ** 3, x[0]][kind]
        return [x[1], 0.02 * (seed % 4 == 0) * ca.sin(t) - p[0] ** 2 * force - p[3] * x[1]]

    times = np.linspace(0.0, rng.uniform(4, 12) * 2 * np.pi / middle[0], 41)
    outputs = lambda x, p, t: [x[0], x[1] * p[2] + 0.1 * t, x[0] ** 2]  # noqa: E731
    return enclosure_samples.ode(rates, lambda p: [p[1], p[4]], np.transpose([middle - radius, middle + radius]), times,
                                 outputs)  # fmt: skip
