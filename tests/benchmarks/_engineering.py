"""Closed-form formulas of engineers in four to twelve parameters over times or load cases, with their true ranges."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from symmb._types import Array

Formula = Callable[..., Array]
"""t, and arrays of the parameters, -> values, all of one shape."""
TIMES = (1, 1, 5, 20, 60, 200)
"""Numbers of times of which a case takes one."""
SPREADS = 0.01, 0.15
"""Least and largest half width of an interval over its middle; their logarithm is uniform."""
POINTS, STARTS = 1 << 11, 2
"""Points at which ranges are searched, beside all corners; best points from which searches start."""


@dataclass(frozen=True, eq=False)
class Case:
    """A formula, its intervals (d, 2), its times (n_t,), and its true range: lower and upper (n_t,)."""

    name: str
    f: Formula
    box: dict[str, tuple[float, float]]
    t: Array
    lower: Array
    upper: Array


def cases(seed: int, number: int | None = None) -> Iterator[Case]:
    """The formulas of a seed, each with its own intervals, middles and times; the first ones, or all."""
    rng = np.random.default_rng([seed, 37])
    for k in rng.permutation(len(FORMULAS))[:number]:
        f, nominal, (begin, end) = FORMULAS[k]
        middle = {name: value * rng.uniform(0.8, 1.25) for name, value in nominal.items()}
        share = np.exp(rng.uniform(*np.log(SPREADS), len(nominal)))
        box = {n: (m * (1 - s), m * (1 + s)) for (n, m), s in zip(middle.items(), share, strict=True)}
        n_t = int(rng.choice(TIMES))
        t = np.linspace(begin, end, n_t) if n_t > 1 else np.array([rng.uniform(begin + 0.3 * (end - begin), end)])
        name = f"{f.__name__.replace('_', ' ')}, {len(box)} parameters, {n_t} times"
        yield Case(name, f, box, t, *true_range(f, box, t, rng))


def monotone_series(seed: int, number: int = 12) -> Iterator[Case]:
    """Responses that rise or fall with each of 4 to 12 parameters at each time, or bend a little over some of them."""
    rng = np.random.default_rng([seed, 22])
    for k in range(number):
        d, n_t, t_end = int(rng.integers(4, 13)), int(rng.choice([21, 101, 201])), rng.uniform(2, 6)
        t, rates, phases = np.linspace(0, t_end, n_t), rng.uniform(0.3, 5, d), rng.uniform(0, 6, d)
        weights, bend = rng.uniform(0.2, 1, d) / d**0.5, 0.3 * rng.uniform(0, 1, d)
        law = (np.exp, lambda s: np.arctan(2 * s), lambda s: s + 0.2 * s**3, lambda s: 1 / (1.5 + 0.9 * np.tanh(s)))[
            k % 4
        ]

        def f(t: Array, *, law=law, weights=weights, rates=rates, phases=phases, bend=bend, **p: Array) -> Array:
            x = list(p.values())
            parts = (
                w * np.cos(r * t + a) * (y + b * np.sin(y) * np.sin(t))
                for w, r, a, y, b in zip(weights, rates, phases, x, bend, strict=True)
            )
            return law(1.2 * sum(parts))

        box = {f"x{i}": (-1.0, 1.0) for i in range(d)}
        yield Case(f"series {k % 4}, {d} parameters, {n_t} times", f, box, t, *true_range(f, box, t, rng))


def true_range(
    f: Formula, box: dict[str, tuple[float, float]], t: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Smallest and largest values (n_t,) at all corners, many points, and those that searches from the best reach."""
    d, (low, high) = len(box), np.array(list(box.values())).T

    def value(x: Array, t: Array | float) -> Array:
        p = low + (high - low) * (x + 1) / 2
        return f(t, **{name: p[..., i] for i, name in enumerate(box)})

    corners = np.indices((2,) * d).reshape(d, -1).T * 2.0 - 1.0
    X = np.concatenate([corners, 2 * qmc.Sobol(d, seed=rng).random(POINTS) - 1])
    step = 1e-5 * np.vstack([np.zeros(d), np.eye(d), -np.eye(d)])
    lower, upper = np.empty((2, len(t)))
    for k, time in enumerate(t):
        y = value(X, time)
        for ends, sign in ((lower, 1.0), (upper, -1.0)):

            def descent(
                x: Array, sign: float = sign, time: float = time, scale: float = np.ptp(y) or 1.0
            ) -> tuple[float, Array]:
                values = sign * value(x + step, time) / scale
                return float(values[0]), (values[1 : d + 1] - values[d + 1 :]) / 2e-5

            order = np.argsort(sign * y, kind="stable")
            least = sign * y[order[0]]
            for x in X[order[:STARTS]]:
                slope = descent(x)[1]
                if (np.where(np.abs(x) == 1, -slope * x, -np.abs(slope)) < -1e-9).any():  # no minimum yet
                    found = minimize(descent, x, jac=True, bounds=[(-1, 1)] * d, options={"maxiter": 60})
                    least = min(least, sign * float(value(found.x, time)))
            ends[k] = sign * least
    return lower, upper


def _cantilever(t, L, E, b, h, P):
    return P * t * L**3 / (3 * E * b * h**3 / 12)


def _crane_beam(t, L, E, J, w, P):
    """Deflection in the middle under its weight and a load that travels."""
    a = np.minimum(t, 1 - t) * L
    return 5 * w * L**4 / (384 * E * J) + P * a * (3 * L**2 - 4 * a**2) / (48 * E * J)


def _eccentric_column(t, F, e, b, h, L, E):
    """Secant formula."""
    area, r2 = b * h, h**2 / 12
    return t * F / area * (1 + e * h / 2 / r2 / np.cos(L / 2 * np.sqrt(t * F / (E * area * r2))))


def _shaft_stress(t, M, T, d, k, N):
    """Equivalent stress of a hollow shaft over a turn of its load."""
    W = np.pi * d**3 * (1 - k**4) / 32
    bending = M * np.cos(t) / W + N / (np.pi * d**2 / 4 * (1 - k**2))
    return np.sqrt(bending**2 + 3 * (T / (2 * W)) ** 2)


def _twist(t, T, L1, L2, G, d1, d2):
    return T * t * 32 / (np.pi * G) * (L1 / d1**4 + L2 / d2**4)


def _coil_spring(t, d, D, G, n, F):
    return 8 * F * t * D**3 * n / (G * d**4)


def _low_pass(t, R, C, Rl, V):
    return V * Rl / (R + Rl) / np.sqrt(1 + (t * C * R * Rl / (R + Rl)) ** 2)


def _resonant_circuit(t, R, L, C, V):
    return V / np.sqrt(R**2 + (t * L - 1 / (t * C)) ** 2)


def _second_order_filter(t, R1, R2, C1, C2, V):
    w0, a = 1 / np.sqrt(R1 * R2 * C1 * C2), (R1 + R2) * C2
    return V / np.hypot(1 - (t / w0) ** 2, t * a)


def _bridge(t, V, R1, R2, R3, R4, alpha):
    hot = R2 * (1 + alpha * t)
    return V * (hot / (R1 + hot) - R4 / (R3 + R4))


def _counterflow(t, U, A, mh, ch, mc, cc, Th, Tc):
    """Heat of a counterflow exchanger over the flow of its cold side."""
    hot, cold = mh * ch, mc * cc * t
    least = np.minimum(hot, cold)
    ratio, units = least / np.maximum(hot, cold), U * A / least
    decay = np.exp(-units * (1 - ratio))
    effectiveness = np.where(np.abs(1 - ratio) < 1e-9, units / (1 + units), (1 - decay) / (1 - ratio * decay + 1e-300))
    return effectiveness * least * (Th - Tc)


def _orifice(t, c, d, D, p, rho):
    return c * np.pi * d**2 / 4 * np.sqrt(2 * p * t / rho) / np.sqrt(1 - (d / D) ** 4)


def _cooling(t, Ta, T0, h, A, m, c):
    return Ta + (T0 - Ta) * np.exp(-h * A * t / (m * c))


def _free_oscillation(t, x0, m, k, c):
    decay = c / (2 * m)
    return x0 * np.exp(-decay * t) * np.cos(np.sqrt(k / m - decay**2) * t)


def _step_response(t, m, k, c, F):
    decay = c / (2 * m)
    w = np.sqrt(k / m - decay**2)
    return F / k * (1 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t)))


def _throw(t, v, angle, g, h):
    return h + v * np.sin(angle) * t - g * t**2 / 2


def _thick_cylinder(t, pi, po, ri, ro):
    """Hoop stress through the wall."""
    r = ri + t * (ro - ri)
    return (pi * ri**2 - po * ro**2) / (ro**2 - ri**2) + (pi - po) * ri**2 * ro**2 / ((ro**2 - ri**2) * r**2)


def _fin(t, h, k, s, L, w, T):
    """Heat of a fin over the speed of air."""
    m = np.sqrt(2 * h * t**0.8 / (k * s))
    return np.sqrt(2 * h * t**0.8 * k * s) * w * T * np.tanh(m * L)


def _pump_head(t, L, D, f, K, z, rho, Q):
    v = Q * t / (np.pi * D**2 / 4)
    return z + (f * L / D + K) * v**2 / (2 * 9.81) + 2e4 / (rho * 9.81)


def _contact_pressure(t, F, b, r1, r2, E1, E2, nu1, nu2):
    return np.sqrt(F * t / (np.pi * b) * (1 / r1 + 1 / r2) / ((1 - nu1**2) / E1 + (1 - nu2**2) / E2))


def _bolt_torque(t, F, p, mu_t, r_t, mu_n, r_n):
    return F * t * (p / (2 * np.pi) + mu_t * r_t / np.cos(np.pi / 6) + mu_n * r_n)


def _wall_temperature(t, h1, h2, k1, k2, k3, s1, s2, s3, Ti, To):
    """Temperature behind the first layer over the temperature outside."""
    R = 1 / h1 + s1 / k1 + s2 / k2 + s3 / k3 + 1 / h2
    return Ti - (Ti - To * t) / R * (1 / h1 + s1 / k1)


def _motor_speed(t, V, ke, R, J, T):
    rate = ke**2 / (R * J)
    return (V / ke - T * R / ke**2) * (1 - np.exp(-rate * t))


def _rocket(t, ve, m0, flow, g):
    return ve * np.log(m0 / (m0 - flow * t)) - g * t


def _slider_crank(t, r, L, e, w):
    return r * np.cos(w * t) + np.sqrt(L**2 - (r * np.sin(w * t) + e) ** 2)


def _transmission(t, m, k, c, a):
    """Amplitude beyond a mount over frequency."""
    return a * np.hypot(k, c * t) / np.hypot(k - m * t**2, c * t)


def _tank(t, A, a, c, h0, q):
    """Level of a tank that empties through an orifice, without inflow but for evaporation."""
    return np.maximum(np.sqrt(h0) - c * a * np.sqrt(2 * 9.81) / (2 * A) * t, 0.0) ** 2 - q * t


def _stack(t, a, b, c, d, e, f, g, h, i, j, k, m):
    """Gap of a chain of twelve lengths, two of which lie at an angle."""
    return a + b + c + d * np.cos(0.3 * t) - e - f - g + h * np.sin(0.5 * t) - i + j - k * m / a


def _belt(t, T, mu, wrap, v, rho):
    centrifugal = rho * (v * t) ** 2
    return (T - centrifugal) * (1 - np.exp(-mu * wrap)) * v * t


def _disc_stress(t, rho, w, ri, ro, nu):
    """Hoop stress of a spinning disc with a hole."""
    r = ri + t * (ro - ri)
    return (3 + nu) / 8 * rho * w**2 * (ri**2 + ro**2 + (ri * ro / r) ** 2 - (1 + 3 * nu) / (3 + nu) * r**2)


def _capacitor(t, V, R1, R2, C, leak):
    return (V * R2 / (R1 + R2) - leak * R1 * R2 / (R1 + R2)) * (1 - np.exp(-t * (R1 + R2) / (R1 * R2 * C)))


FORMULAS: tuple[tuple[Formula, dict[str, float], tuple[float, float]], ...] = (
    (_cantilever, {"L": 1.0, "E": 2e11, "b": 0.05, "h": 0.02, "P": 100.0}, (0.0, 5.0)),
    (_crane_beam, {"L": 6.0, "E": 2e11, "J": 8e-5, "w": 500.0, "P": 3e4}, (0.0, 1.0)),
    (_eccentric_column, {"F": 2.5e4, "e": 0.005, "b": 0.05, "h": 0.05, "L": 2.0, "E": 7e10}, (0.1, 1.0)),
    (_shaft_stress, {"M": 400.0, "T": 600.0, "d": 0.05, "k": 0.5, "N": 1e4}, (0.0, 6.28)),
    (_twist, {"T": 300.0, "L1": 0.5, "L2": 0.8, "G": 8e10, "d1": 0.04, "d2": 0.03}, (0.0, 2.0)),
    (_coil_spring, {"d": 0.004, "D": 0.03, "G": 8e10, "n": 9.0, "F": 20.0}, (0.0, 4.0)),
    (_low_pass, {"R": 1e3, "C": 1e-6, "Rl": 1e4, "V": 5.0}, (10.0, 5e3)),
    (_resonant_circuit, {"R": 20.0, "L": 0.01, "C": 1e-6, "V": 10.0}, (5e3, 1.5e4)),
    (_second_order_filter, {"R1": 1e3, "R2": 2e3, "C1": 1e-6, "C2": 3e-7, "V": 1.0}, (10.0, 3e3)),
    (_bridge, {"V": 10.0, "R1": 100.0, "R2": 100.0, "R3": 110.0, "R4": 105.0, "alpha": 0.004}, (-20.0, 100.0)),
    (_counterflow, {"U": 500.0, "A": 4.0, "mh": 1.0, "ch": 4.2e3, "mc": 0.8, "cc": 4.2e3, "Th": 90.0, "Tc": 20.0},
     (0.3, 2.5)),
    (_orifice, {"c": 0.61, "d": 0.05, "D": 0.1, "p": 5e4, "rho": 1e3}, (0.1, 2.0)),
    (_cooling, {"Ta": 20.0, "T0": 90.0, "h": 15.0, "A": 0.05, "m": 0.3, "c": 900.0}, (0.0, 1200.0)),
    (_free_oscillation, {"x0": 0.1, "m": 2.0, "k": 80.0, "c": 1.5}, (0.0, 4.0)),
    (_step_response, {"m": 2.0, "k": 80.0, "c": 6.0, "F": 10.0}, (0.0, 4.0)),
    (_throw, {"v": 20.0, "angle": 0.8, "g": 9.81, "h": 1.5}, (0.0, 3.0)),
    (_thick_cylinder, {"pi": 3e7, "po": 5e6, "ri": 0.04, "ro": 0.07}, (0.0, 1.0)),
    (_fin, {"h": 30.0, "k": 200.0, "s": 0.002, "L": 0.04, "w": 0.1, "T": 50.0}, (0.5, 5.0)),
    (_pump_head, {"L": 80.0, "D": 0.1, "f": 0.02, "K": 6.0, "z": 12.0, "rho": 1e3, "Q": 0.015}, (0.2, 2.0)),
    (_contact_pressure, {"F": 2e3, "b": 0.02, "r1": 0.03, "r2": 0.05, "E1": 2.1e11, "E2": 1.1e11, "nu1": 0.3,
                         "nu2": 0.28}, (0.1, 3.0)),
    (_bolt_torque, {"F": 2e4, "p": 0.00175, "mu_t": 0.12, "r_t": 0.0054, "mu_n": 0.14, "r_n": 0.0083}, (0.1, 1.5)),
    (_wall_temperature, {"h1": 8.0, "h2": 20.0, "k1": 0.8, "k2": 0.04, "k3": 1.2, "s1": 0.02, "s2": 0.12, "s3": 0.2,
                         "Ti": 21.0, "To": 10.0}, (-2.0, 3.0)),
    (_motor_speed, {"V": 24.0, "ke": 0.05, "R": 1.2, "J": 2e-4, "T": 0.1}, (0.0, 0.5)),
    (_rocket, {"ve": 2500.0, "m0": 1e3, "flow": 8.0, "g": 9.81}, (0.0, 60.0)),
    (_slider_crank, {"r": 0.1, "L": 0.35, "e": 0.02, "w": 3.0}, (0.0, 4.0)),
    (_transmission, {"m": 50.0, "k": 2e5, "c": 400.0, "a": 1e-3}, (10.0, 150.0)),
    (_tank, {"A": 2.0, "a": 0.003, "c": 0.62, "h0": 2.5, "q": 1e-6}, (0.0, 400.0)),
    (_stack, {"a": 30.0, "b": 12.0, "c": 8.0, "d": 15.0, "e": 20.0, "f": 10.0, "g": 9.0, "h": 6.0, "i": 7.0, "j": 4.0,
              "k": 3.0, "m": 2.0}, (0.0, 6.0)),
    (_belt, {"T": 800.0, "mu": 0.35, "wrap": 2.8, "v": 12.0, "rho": 0.6}, (0.1, 2.5)),
    (_disc_stress, {"rho": 7850.0, "w": 600.0, "ri": 0.04, "ro": 0.2, "nu": 0.3}, (0.0, 1.0)),
    (_capacitor, {"V": 12.0, "R1": 1e3, "R2": 2e3, "C": 1e-5, "leak": 1e-3}, (0.0, 0.05)),
)  # fmt: skip
"""Formula, usual values of its parameters, and the range of its times or load cases."""
