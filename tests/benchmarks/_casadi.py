"""The double pendulum by CasADi alone: idas on the redundant DAE, and Runge-Kutta loops in C that CasADi writes."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
from _timing import spent

from symmb.equations.model.dae import DAE
from symmb.run.integrate.initial_value_problem import build_problem

Run = Callable[[np.ndarray, np.ndarray], np.ndarray]


def idas(dae: DAE, times: np.ndarray, rtol: float) -> Run:
    """(x0 (n_x,), p (n_p,)) -> states (n_x, n_t) of one run of the index-1 DAE, multipliers as algebraic variables."""
    problem = build_problem(dae, None, algebraic=True, work=False)
    parts = {"x": problem.x, "z": problem.z, "p": problem.p, "t": problem.t, "ode": problem.ode, "alg": problem.alg}
    options = {"reltol": rtol, "abstol": rtol / 100, "max_num_steps": 100_000}
    integrator = ca.integrator("idas", "idas", parts, float(times[0]), times.tolist(), options)
    guess = ca.Function("guess", [problem.x, problem.p, problem.t], [problem.z_guess])
    return lambda x0, p: integrator(x0=x0, z0=guess(x0, p, times[0]), p=p)["xf"]


def redundant(dae: DAE) -> tuple[ca.Function, ca.Function]:
    """Rates and outputs, (x, p) -> x' and (x, p) -> y, of the index-1 DAE with its multipliers eliminated."""
    x, p = ca.SX.sym("x", dae.n_q + dae.n_v), ca.SX.sym("p", len(dae.p_names))
    rates = ca.vertcat(*dae.rhs(*dae.arguments(x, p, ca.SX(0))))
    return ca.Function("rates", [x, p], [rates], {"cse": True}), ca.Function("y", [x, p], [x])


def minimal() -> tuple[ca.Function, ca.Function]:
    """The same in the two angles from the vertical, by Lagrange's equations: (x, p) -> x' (4,), y (12,)."""
    x, length = ca.SX.sym("x", 4), ca.SX.sym("length", 2)
    theta, omega = x[:2], x[2:]
    x1, y1 = length[0] / 2 * ca.sin(theta[0]), length[0] / 2 * ca.cos(theta[0])
    x2 = 2 * x1 + length[1] / 2 * ca.sin(theta[1])
    y2 = 2 * y1 + length[1] / 2 * ca.cos(theta[1])
    places = ca.vertcat(x1, y1, theta[0], x2, y2, theta[1])
    rates = ca.jtimes(places, theta, omega)
    masses = ca.vertcat(length[0], length[0], length[0] ** 3 / 12, length[1], length[1], length[1] ** 3 / 12)
    L = ca.dot(masses, rates**2) / 2 + 9.81 * (length[0] * places[1] + length[1] * places[4])
    momenta = ca.gradient(L, omega)
    acceleration = ca.solve(ca.jacobian(momenta, omega), ca.gradient(L, theta) - ca.jtimes(momenta, theta, omega))
    y = ca.vertcat(places, rates)
    return (ca.Function("rates", [x, length], [ca.vertcat(omega, acceleration)], {"cse": True}),
            ca.Function("y", [x, length], [y], {"cse": True}))  # fmt: skip


def runge_kutta(
    rates: ca.Function, y: ca.Function, h: float, steps: int, samples: int, folder: Path
) -> tuple[Run, float]:
    """(x0 (n_x, N), p (n_p, N)) -> y (N, steps + 1, n_y) by the classical method in generated C; and seconds of gcc."""
    x, p = ca.SX.sym("x", rates.numel_in(0)), ca.SX.sym("p", rates.numel_in(1))
    k1 = rates(x, p)
    k2 = rates(x + h / 2 * k1, p)
    k3 = rates(x + h / 2 * k2, p)
    k4 = rates(x + h * k3, p)
    z = ca.vertcat(x, p)  # parameters travel with the state: mapaccum wants them for each step otherwise
    step = ca.Function("step", [z], [ca.vertcat(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), p)], {"cse": True})
    output = ca.Function("output", [z], [y(x, p)])
    z0 = ca.MX.sym("z", z.numel())
    states = ca.horzcat(z0, step.mapaccum("march", steps)(z0))
    name = f"all_{samples}_{rates.numel_in(0)}"
    whole = ca.Function("whole", [z0], [output.map(steps + 1, "serial")(states)]).map(name, "serial", samples, [], [])
    source, library = folder / f"{name}.c", folder / f"{name}.so"
    generator = ca.CodeGenerator(source.name)
    generator.add(whole)
    generator.generate(f"{folder}/")
    begin = spent()
    subprocess.run(["gcc", "-O3", "-march=native", "-shared", "-fPIC", source, "-o", library, "-lm"], check=True)
    seconds = spent() - begin
    f = ca.external(name, str(library.resolve()))
    given, made = np.zeros((samples, z.numel())), np.zeros((samples, steps + 1, y.numel_out(0)))
    buffer, trigger = f.buffer()
    buffer.set_arg(0, memoryview(given))
    buffer.set_res(0, memoryview(made))

    def run(x0: np.ndarray, p: np.ndarray) -> np.ndarray:
        given[...] = np.vstack([x0, p]).T
        trigger()
        return made

    run.kept = f, buffer  # the trigger does not hold them
    return run, seconds
