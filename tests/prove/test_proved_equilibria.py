"""Proofs of motions that start in static equilibrium, against closed forms and roots of them."""

from types import SimpleNamespace

import _loops
import casadi as ca
import numpy as np
from enclosure_samples import require_sharp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import symmb as mb

GROUND = mb.Ground()
SHARP = {"error": 1e-11, "excess": 1e-6, "size": 1.0}
"""Of bounds, in units of outputs."""


def test_a_mass_on_a_spring_under_a_force_that_grows():
    p = mb.Parameters(m=1.0, k=50.0)
    mass = mb.Body("mass", p.m, pose=mb.Particle())
    pull = mb.Force("pull", mass.point(0, 0), (-p.k * mass.x, -p.k * mass.y + mb.t))
    times, box = np.linspace(0, 1, 9), {"m": (0.9, 1.1), "k": (48.0, 52.0)}
    system = mb.System(mass, pull, mb.Gravity(0, -9.81), parameters=p)
    scene = mb.Scene(system, times=times, outputs={"y": mass.y}, box=mb.Box(**box), equilibrium=True)
    runs = []
    for m in np.linspace(*box["m"], 41):
        for k in np.linspace(*box["k"], 41):
            rate = np.sqrt(k / m)
            runs.append((-9.81 * m + times - np.sin(rate * times) / rate) / k)
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=8)), np.array(runs)[:, :, None], **SHARP)


def test_a_pendulum_with_a_torsion_spring_under_a_torque_that_grows():
    p = mb.Parameters(k=3.0)
    arm = mb.Body("arm", 1.0, 0.1)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), arm.point(-0.5, 0), axis=(0, 0, 1))
    system = mb.System(arm, hinge, mb.Torque("spring", arm, mb.t - p.k * arm.theta), mb.Gravity(0, -9.81), parameters=p)
    times, found = np.linspace(0, 1, 5), []
    for k in np.linspace(2.9, 3.1, 41):

        def torque(angle, k=k):
            return -k * angle - 9.81 * 0.5 * np.cos(angle)

        begin = [brentq(torque, -1.5, 0, xtol=1e-15), 0.0]
        run = solve_ivp(lambda t, z, f=torque: [z[1], (f(z[0]) + t) / 0.35], (0, 1), begin, method="DOP853", rtol=1e-13,
                        atol=1e-14, t_eval=times)  # fmt: skip
        found.append(run.y[0])
    scene = mb.Scene(system, times=times, outputs={"angle": arm.theta}, box=mb.Box(k=(2.9, 3.1)), equilibrium=True)
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=5)), np.array(found)[:, :, None], **SHARP)


def test_a_four_bar_stays_where_its_potential_energy_is_least():
    values = {"a": 0.3, "b": 1.1, "c": 0.8, "d": 1.0, "rho": 1.0, "k": 20.0}
    phi, k = ca.SX.sym("phi"), ca.SX.sym("k")
    plan = _loops._four_bar(SimpleNamespace(**values), phi)
    poses = ca.vertcat(*(ca.vertcat(*bar.pose) for bar in plan.bars.values()))
    energy = sum(9.81 * bar.mass * bar.pose[1] for bar in plan.bars.values()) + 0.5 * k * (phi - 1) ** 2
    f = ca.Function("f", [phi, k], [ca.gradient(energy, phi), poses])

    def at(k):
        return f(brentq(lambda phi: float(f(phi, k)[0]), 0.3, 1.5, xtol=1e-15), k)[1].full().ravel()

    p = mb.Parameters(**values)
    lengths = (("crank", p.a), ("coupler", p.b), ("rocker", p.c))
    crank, coupler, rocker = (mb.Body(name, p.rho * L, p.rho * L**3 / 12) for name, L in lengths)
    bars = ((crank, p.a), (coupler, p.b), (rocker, p.c))
    tips = {body: (body.point(-L / 2, 0), body.point(L / 2, 0)) for body, L in bars}
    pins = ((GROUND.point(0, 0), tips[crank][0]), (tips[crank][1], tips[coupler][0]),
            (tips[coupler][1], tips[rocker][1]), (GROUND.point(p.d, 0.1), tips[rocker][0]))  # fmt: skip
    joints = [mb.Revolute(name, *ends, axis=(0, 0, 1)) for name, ends in zip("OACD", pins, strict=True)]
    spring = mb.Torque("spring", crank, -p.k * (crank.theta - 1.0))
    system = mb.System(crank, coupler, rocker, *joints, spring, mb.Gravity(0, -9.81), parameters=p)
    names = [f"{body}.{part}" for body in ("crank", "coupler", "rocker") for part in ("x", "y", "theta")]
    scene = mb.Scene(
        system, times=np.linspace(0, 0.2, 3), outputs={"angle": crank.theta, "y": coupler.y},
        guess=dict(zip(names, at(20.0).tolist(), strict=True)), box=mb.Box(k=(19.0, 21.0)), equilibrium=True,
    )  # fmt: skip
    held = np.array([at(k)[[2, 4]] for k in np.linspace(19.0, 21.0, 21)])
    require_sharp(mb.propagate(scene, mb.TaylorModel(order=5)), np.repeat(held[:, None], 3, axis=1), **SHARP)
