"""Motions and equations in closed form, by SymPy and by SciPy, and shipped scenes against them."""

import casadi as ca
import numpy as np
import pytest
import sympy as sp
import sympy.physics.mechanics as me
from joints import bundle, numbers
from machines import GROUND, ORIGIN, free_body, pendulum, run_of
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk
from small_scenes import particle

import symmb as mb
from models import cubic, double_pendulum, half_car, heavy_top, rolling_disc, spherical_pendulum
from symmb import IntervalArithmetic, PolynomialChaos, propagate

DOUBLE_PENDULUM = double_pendulum.scene().system
L1, L2 = sp.symbols("l1 l2")
NAMES = [f"rod{i}.{c}" for i in (1, 2) for c in ("x", "y", "theta")]
RATES = [f"rod{i}.{c}" for i in (1, 2) for c in ("vx", "vy", "omega")]
X1, Y1, T1, X2, Y2, T2 = PAPER_Q = sp.symbols("x1 y1 t1 x2 y2 t2")
PAPER_V = sp.symbols("vx1 vy1 w1 vx2 vy2 w2")
TURNED = sp.diag(1, 1, -1, 1, 1, -1)  # the paper's angles count the other way
# Its second joint is written from the origin.
ROWS = sp.Matrix([[1, 0, 0, 0], [0, 1, 0, 0], [1, 0, 1, 0], [0, 1, 0, 1]])
PAPER_PHI = sp.Matrix([
    X1 - L1 / 2 * sp.sin(T1),
    Y1 - L1 / 2 * sp.cos(T1),
    X2 - L1 * sp.sin(T1) - L2 / 2 * sp.sin(T2),
    Y2 - L1 * sp.cos(T1) - L2 / 2 * sp.cos(T2),
])  # fmt: skip
PAPER_PHI_Q = PAPER_PHI.jacobian(PAPER_Q)


def test_the_double_pendulum_has_the_paper_s_equations():
    """Eqs. (37) and (38) of Wang & Yang (2021), with y downwards, m = l and I = l^3/12."""
    ours = DOUBLE_PENDULUM.to_sympy()
    symbols = {s.name: s for matrix in ours.values() for s in matrix.free_symbols}
    mine = {symbols[n]: s for n, s in [("l1", L1), ("l2", L2)]}
    signs = [TURNED[i, i] for i in range(6)]
    for names, paper in ((NAMES, PAPER_Q), (RATES, PAPER_V)):
        mine |= {symbols[n]: sign * s for n, sign, s in zip(names, signs, paper, strict=True) if n in symbols}
    M, Q, Phi, Phi_q, gamma = (sp.nsimplify(ours[k].subs(mine), rational=True) for k in "M Q Phi Phi_q gamma".split())
    assert ROWS.det() == 1
    g = sp.Rational(981, 100)
    paper_M = sp.diag(L1, L1, L1**3 / 12, L2, L2, L2**3 / 12)
    paper_rate = PAPER_PHI_Q * sp.Matrix(PAPER_V)
    differences = {
        "M": TURNED * M * TURNED - paper_M,
        "Q": TURNED * Q - sp.Matrix([0, L1 * g, 0, 0, L2 * g, 0]),
        "Phi": ROWS * Phi - PAPER_PHI,
        "Phi_q": ROWS * Phi_q * TURNED - PAPER_PHI_Q,
        "gamma": ROWS * gamma + paper_rate.jacobian(PAPER_Q) * sp.Matrix(PAPER_V),
    }
    for name, difference in differences.items():
        assert sp.simplify(difference) == sp.zeros(*difference.shape), name


def kane_double_pendulum():
    """Accelerations (theta1, theta2)'' of two homogeneous rods by Kane's method, as a numeric function."""
    q1, q2 = me.dynamicsymbols("q1 q2")
    u1, u2 = me.dynamicsymbols("u1 u2")
    world, origin = me.ReferenceFrame("W"), me.Point("O")
    origin.set_vel(world, 0)
    bodies, loads, hinge = [], [], origin
    for i, (q, u, length) in enumerate(((q1, u1, L1), (q2, u2, L2))):
        frame = world.orientnew(f"F{i}", "Axis", (q, world.z))
        frame.set_ang_vel(world, u * world.z)
        center = hinge.locatenew(f"C{i}", length / 2 * frame.y)
        center.v2pt_theory(hinge, world, frame)
        bodies.append(me.RigidBody(f"B{i}", center, frame, length, (me.inertia(frame, 0, 0, length**3 / 12), center)))
        loads.append((center, sp.Float("9.81") * length * world.y))
        tip = hinge.locatenew(f"P{i}", length * frame.y)
        tip.v2pt_theory(hinge, world, frame)
        hinge = tip
    kane = me.KanesMethod(world, [q1, q2], [u1, u2], kd_eqs=[q1.diff() - u1, q2.diff() - u2])
    kane.kanes_equations(bodies, loads)
    arguments = (q1, q2, u1, u2, L1, L2)
    mass, forcing = sp.lambdify(arguments, kane.mass_matrix), sp.lambdify(arguments, kane.forcing)
    return lambda *values: np.linalg.solve(mass(*values), forcing(*values)).ravel()


def test_the_double_pendulum_accelerates_as_kane_s_method_says():
    dae = mb.compile_dae(DOUBLE_PENDULUM)
    kane = kane_double_pendulum()
    rng = np.random.default_rng(3)
    for _ in range(5):
        (a, b), (wa, wb), (l1, l2) = rng.uniform(-3, 3, 2), rng.uniform(-4, 4, 2), rng.uniform(0.7, 1.3, 2)
        aa, ab = kane(a, b, wa, wb, l1, l2)
        (r1, v1, a1), (r2, v2, a2) = turning(l1, a, wa, aa), turning(l2, b, wb, ab)  # of the tips about the hinges
        expected = [*(a1 / 2), aa, *(a1 + a2 / 2), ab]
        _, vdot = dae.rhs([*(r1 / 2), a, *(r1 + r2 / 2), b], [*(v1 / 2), wa, *(v1 + v2 / 2), wb], [l1, l2], 0.0)
        assert_allclose(vdot.full().ravel(), expected, rtol=1e-12, atol=1e-12)


def turning(length, angle, rate, acceleration):
    """Place, velocity and acceleration (2,) of the end of a rod, whose angle is measured from the y axis."""
    along, across = np.array([-np.sin(angle), np.cos(angle)]), np.array([-np.cos(angle), -np.sin(angle)])
    return length * along, length * rate * across, length * (acceleration * across - rate**2 * along)


R, L, M1, M2, M3, J1, J2, K = 0.3, 0.9, 1.1, 1.7, 2.3, 0.02, 0.15, 40.0


def slider_crank():
    """Crank and rod with masses in their middle, slider on the x axis, a spring on the slider, y upwards."""
    crank, rod, slider = mb.Body("crank", M1, J1), mb.Body("rod", M2, J2), mb.Body("slider", M3, 1.0)
    main = mb.Revolute("main", ORIGIN, crank.point(-R / 2, 0))
    pin = mb.Revolute("pin", crank.point(R / 2, 0), rod.point(-L / 2, 0))
    wrist = mb.Revolute("wrist", rod.point(L / 2, 0), slider.point(0, 0))
    guide = mb.Prismatic("guide", ORIGIN, slider.point(0, 0), axis=(1, 0, 0))
    spring = mb.Spring("spring", ORIGIN, slider.point(0, 0), K, 0.4)
    return bundle(crank, rod, slider, main, pin, wrist, guide, mb.Gravity(0, -9.81), spring)


def lagrange_slider_crank():
    """Accelerations (crank, rod, slider)'' by Lagrange's method with the loop as constraints, as a numeric function."""
    a, b, x = q = me.dynamicsymbols("a b x")
    time = me.dynamicsymbols._t
    crank, rod = sp.Matrix([sp.cos(a), sp.sin(a)]), sp.Matrix([sp.cos(b), sp.sin(b)])
    centers = ((M1, R / 2 * crank), (M2, R * crank + L / 2 * rod), (M3, sp.Matrix([x, 0])))
    kinetic = sum(m * r.diff(time).dot(r.diff(time)) / 2 for m, r in centers)
    kinetic += (J1 * a.diff(time) ** 2 + J2 * b.diff(time) ** 2) / 2
    potential = sum(m * sp.Float("9.81") * r[1] for m, r in centers) + K * (x - sp.Float("0.4")) ** 2 / 2
    loop = list(R * crank + L * rod - sp.Matrix([x, 0]))
    method = me.LagrangesMethod(kinetic - potential, q, hol_coneqs=loop)
    method.form_lagranges_equations()
    rates = [s.diff(time) for s in q]
    mass, forcing = (sp.lambdify((q, rates), m) for m in (method.mass_matrix_full, method.forcing_full))
    return lambda q, rates: np.linalg.solve(mass(q, rates), forcing(q, rates)).ravel()[3:6]


def test_the_slider_crank_accelerates_as_lagrange_s_method_says():
    _, dae = slider_crank()
    lagrange = lagrange_slider_crank()
    rng = np.random.default_rng(4)
    for _ in range(5):
        a, wa = rng.uniform(-3, 3), rng.uniform(-5, 5)
        b = -np.arcsin(R * np.sin(a) / L)
        wb = -R * np.cos(a) * wa / (L * np.cos(b))
        x, vx = R * np.cos(a) + L * np.cos(b), -R * np.sin(a) * wa - L * np.sin(b) * wb
        aa, ab, ax = lagrange([a, b, x], [wa, wb, vx])
        (r1, v1, a1), (r2, v2, a2) = turning(R, a - np.pi / 2, wa, aa), turning(L, b - np.pi / 2, wb, ab)
        q, v = [*(r1 / 2), a, *(r1 + r2 / 2), b, x, 0, 0], [*(v1 / 2), wa, *(v1 + v2 / 2), wb, vx, 0, 0]
        expected = [*(a1 / 2), aa, *(a1 + a2 / 2), ab, ax, 0, 0]
        assert_allclose(numbers(dae.Phi, q, v, [], 0.0), 0, atol=1e-15)
        _, vdot = dae.rhs(q, v, [], 0.0)
        assert_allclose(vdot.full().ravel(), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


TIMES = np.linspace(0.0, 3.0, 61)
TIGHT = mb.CVODES(rtol=1e-12, atol=1e-12)
PROJECTED = mb.CVODES(rtol=1e-12, atol=1e-12, stabilization=mb.Projection())


def meets(run, tolerance, **known):
    for name, values in known.items():
        assert_allclose(run[name], np.broadcast_to(values, run.t.shape), rtol=0, atol=tolerance)


def test_a_pendulum_swings_by_the_elliptic_sine():
    """sin(theta / 2) = k sn(K - w t) for a release at rest from 2.5 rad."""
    swing = pendulum(length=0.5, mass=2.0, inertia=0.3)  # whose angle is 0 in the horizontal
    run = swing.run("theta", TIMES, {"rod.theta": 2.5 - np.pi / 2}, solver=TIGHT)
    w, k = np.sqrt(2.0 * 9.81 * 0.5 / (0.3 + 2.0 * 0.25)), np.sin(1.25)
    sn, *_ = ellipj(ellipk(k**2) - w * TIMES, k**2)
    assert_allclose(run["theta"], 2 * np.arcsin(k * sn) - np.pi / 2, atol=1e-8)


def test_a_torque_free_symmetric_body_precesses():
    """In body axes the spin's cross part turns at (A - C) / A w_z; in the world the momentum stands still."""
    A, C, wz, w0 = 0.4, 0.7, 5.0, 1.2
    machine, rate = free_body(inertia=(A, A, C)), (A - C) / A * wz
    body, run = machine.top, machine.run(times=TIMES, start={"top.omega": (w0, 0, wz)}, solver=TIGHT)
    meets(run, 1e-9, **{"top.omega_x": w0 * np.cos(rate * TIMES), "top.omega_y": -w0 * np.sin(rate * TIMES)})
    momentum = run(body.rotation @ (ca.DM([A, A, C]) * body.omega))
    assert_allclose(momentum, np.broadcast_to([A * w0, 0, C * wz], momentum.shape), atol=1e-8)
    assert_allclose(np.linalg.norm(run.q[:, 3:], axis=1), 1, atol=1e-9)


def test_a_hoop_rolls_down_a_slope():
    """Rolling without slip on a slope of 0.4 rad: a = g sin(0.4) / (1 + J / m r^2), and the friction that it takes."""
    m, r, J, slope = 1.5, 0.2, 0.04, 0.4
    hoop = mb.Body("hoop", m, J, mb.Planar())
    gravity = mb.Gravity(9.81 * np.sin(slope), -9.81 * np.cos(slope))
    floor = mb.Motion("floor", hoop.y, r)
    roll = mb.VelocityConstraint("roll", (hoop.vx + r * hoop.omega,))
    run = run_of(hoop, gravity, floor, roll, times=TIMES, solver=TIGHT)
    a = 9.81 * np.sin(slope) / (1 + J / (m * r**2))
    assert_allclose(run["hoop.x"], a * TIMES**2 / 2, rtol=1e-9, atol=1e-9)
    assert_allclose(run["hoop.theta"], -run["hoop.x"] / r, rtol=1e-9, atol=1e-9)
    meets(run, 1e-9, **{"roll.lam[0]": J * a / r**2, "floor.lam[0]": -m * 9.81 * np.cos(slope)})
    assert run.energy_drift < 1e-9


def test_a_skate_runs_in_a_circle():
    """Blade under the centre of mass: spin and speed stay, the track is a circle of radius v / w."""
    skate = mb.Body("skate", 1.0, 0.1, mb.Planar())
    blade = mb.VelocityConstraint("blade", (-ca.sin(skate.theta) * skate.vx + ca.cos(skate.theta) * skate.vy,))
    run = run_of(skate, blade, start={"skate.vx": 2.0, "skate.omega": 4.0}, times=TIMES, solver=TIGHT)
    meets(run, 1e-9, **{"skate.x": 0.5 * np.sin(4 * TIMES), "skate.y": 0.5 * (1 - np.cos(4 * TIMES))})
    assert_allclose(run["skate.vy"][0], 0, atol=1e-15)


def test_a_planet_runs_on_kepler_s_ellipse():
    """Force mu / r^2 as a law of the coordinates; eccentricity 0.4, semi-axis 1, from the near end."""
    mu, e = 1.7, 0.4
    law = lambda p, mass: tuple(-mu * x / (mass.x**2 + mass.y**2) ** 1.5 for x in (mass.x, mass.y))  # noqa: E731
    start = {"mass.x": 1 - e, "mass.vy": np.sqrt(mu * (1 + e) / (1 - e))}
    run = mb.simulate(particle(law, TIMES, start, "xy"), TIGHT)
    n = np.sqrt(mu)
    anomaly = np.array([brentq(lambda E, t=t: E - e * np.sin(E) - n * t, -1, 10, xtol=1e-14) for t in TIMES])
    meets(run, 1e-9, x=np.cos(anomaly) - e, y=np.sqrt(1 - e**2) * np.sin(anomaly))


def test_a_bead_runs_out_on_a_turning_wire():
    """A wire that turns at w in the plane: r = r0 cosh(w t), and the force across it is 2 m w r'."""
    w, r0, m = 1.3, 0.2, 0.6
    wire = mb.Body("wire", 1.0, 1.0, mb.Planar())
    bead = mb.Body("bead", m, 0.0, mb.Particle())
    hinge, turn = mb.Revolute("hinge", ORIGIN, wire.point(0, 0)), mb.Motion("turn", wire.theta, w * mb.t)
    thread = mb.PointOnLine("thread", wire.point(0, 0), bead.point(0, 0), axis=(1, 0, 0))
    start = {"bead.x": r0, "bead.vx": 0.0}
    run = run_of(wire, bead, hinge, turn, thread, start=start, times=TIMES, solver=PROJECTED)
    assert_allclose(np.hypot(run["bead.x"], run["bead.y"]), r0 * np.cosh(w * TIMES), atol=1e-8)
    force, _ = run.reaction("thread")
    across = np.stack([-np.sin(w * TIMES), np.cos(w * TIMES)], axis=1)
    assert_allclose((force[:, :2] * across).sum(axis=1), 2 * m * w**2 * r0 * np.sinh(w * TIMES), atol=1e-6)
    assert run.energy_drift < 1e-8


def test_a_hooke_joint_does_not_turn_evenly():
    """Shafts at an angle beta, the first driven evenly: tan(out) = tan(in) / cos(beta)."""
    beta = 0.6
    first, second = (mb.Body(name, 1.0, (0.1, 0.1, 0.1), mb.Spatial()) for name in ("first", "second"))
    tilted = (np.cos(beta), np.sin(beta), 0)
    hinge_in = mb.Revolute("in", GROUND.point(-1, 0), first.point(-1, 0), axis=(1, 0, 0))
    bearing = mb.PointOnLine("out", ORIGIN, second.point(0.5, 0), axis=tilted)
    cross = mb.Universal("cross", first.point(0, 0), second.point(0, 0), axis=(0, 1, 0), axis_b=(0, 0, 1))
    drive = mb.Motion("drive", hinge_in.angle, 3.0 * mb.t)
    z = second.rotation[:, 2]
    out = ca.atan2(z[0] * np.sin(beta) - z[1] * np.cos(beta), z[2])
    guess = {"second.rotation": mb.rotation((0, 0, 1), beta)}
    more = {"start": {"first.x": 0.0}, "times": TIMES, "outputs": {"out": out}, "guess": guess, "solver": PROJECTED}
    run = run_of(first, second, hinge_in, bearing, cross, drive, **more)
    # The cross arm on the first shaft lies in the plane of the shafts at the start: the output runs ahead first.
    expected = np.unwrap(np.arctan2(np.sin(3 * TIMES) / np.cos(beta), np.cos(3 * TIMES)))
    assert_allclose(np.unwrap(run["out"]), expected, atol=1e-8)
    assert abs(expected[-1]) > 2 * np.pi


def test_a_damped_oscillator_driven_at_its_base():
    """m x'' = -k (x - u) - c (x' - u'), u = a sin(w t): the base is a massless body on a drive."""
    m, k, c, a, w = 2.0, 50.0, 1.5, 0.1, 4.0
    base, mass = mb.Body("base", 0.0, pose=mb.Particle()), mb.Body("mass", m, pose=mb.Particle())
    pull = mb.Force("pull", mass.point(0, 0), (-k * (mass.x - base.x) - c * (mass.vx - base.vx), 0))
    run = run_of(base, mass, mb.Motion("drive", base.x, a * ca.sin(w * mb.t)), pull, times=TIMES, solver=TIGHT)
    steady = a * (k + 1j * w * c) / (k - m * w**2 + 1j * w * c)
    # x = Im(steady e^{iwt}) + decaying part that makes x(0) = x'(0) = 0
    d, f = c / (2 * m), np.sqrt(k / m - (c / (2 * m)) ** 2)
    x0, v0 = -steady.imag, -(1j * w * steady).imag
    decay = np.exp(-d * TIMES) * (x0 * np.cos(f * TIMES) + (v0 + d * x0) / f * np.sin(f * TIMES))
    assert_allclose(run["mass.x"], (steady * np.exp(1j * w * TIMES)).imag + decay, atol=1e-9)


G = 9.81


def test_cubic_has_its_range():
    exact = propagate(cubic.scene(), PolynomialChaos(order=3))
    assert exact.lower == pytest.approx(0.0, abs=1e-6)
    assert exact.upper == pytest.approx(4 / 27, abs=1e-6)
    natural = propagate(cubic.scene(), IntervalArithmetic())
    assert (natural.lower.item(), natural.upper.item()) == pytest.approx((-2.0, 2.0))


@pytest.mark.parametrize("solver", [None, mb.StateSpace()])
def test_spherical_pendulum_follows_its_angles(solver):
    theta, phi_dot = 1.2, 1.5
    momentum = phi_dot * np.sin(theta) ** 2
    times = np.linspace(0.0, 5.0, 51)

    def rates(_, y):
        return [y[1], momentum**2 * np.cos(y[0]) / np.sin(y[0]) ** 3 - G * np.sin(y[0]), momentum / np.sin(y[0]) ** 2]

    y = solve_ivp(rates, (0, 5), [theta, 0.0, 0.0], t_eval=times, rtol=1e-12, atol=1e-12).y
    run = mb.simulate(spherical_pendulum.scene(theta=theta, phi_dot=phi_dot), solver, times=times)
    meets(run, 1e-6, x=np.sin(y[0]) * np.cos(y[2]), y=np.sin(y[0]) * np.sin(y[2]), theta=y[0])
    speed2 = y[1] ** 2 + (momentum / np.sin(y[0])) ** 2
    meets(run, 1e-5, pull=speed2 + G * np.cos(y[0]))


@pytest.mark.parametrize("branch", [0, 1])
def test_heavy_top_precesses_steadily(branch):
    A, C, omega3, theta = 0.5, 0.1, 100.0, 0.6
    phi_dot = np.roots([A * np.cos(theta), -C * omega3, G * 0.5])[branch]  # fast or slow
    times = np.linspace(0.0, 1.0, 21)
    run = mb.simulate(heavy_top.scene(theta=theta, phi_dot=phi_dot, omega3=omega3), times=times)
    meets(run, 1e-6, theta=theta, omega3=omega3)
    meets(run, 1e-5, e3_x=np.sin(theta) * np.sin(phi_dot * times))


def test_disc_rolls_on_a_circle():
    alpha, precession, radius = 1.2, 2.0, 0.5
    spin = rolling_disc.steady_spin(alpha, precession)
    times = np.linspace(0.0, 5.0, 51)
    run = mb.simulate(rolling_disc.scene(alpha=alpha, precession=precession), times=times)
    # The centre goes along x at first and turns with the precession: a circle through the origin about (0, offset).
    offset = -radius * spin / precession
    turned = precession * times
    meets(run, 1e-5, x=offset * np.sin(turned), y=offset * (1 - np.cos(turned)), load=G)
    meets(run, 1e-6, alpha=alpha, spin=spin)


def test_disc_wobbles_as_its_rates_of_angular_momentum_say():
    """Rates about the centre in the frame (u, h, n) of the disc: u up the disc's plane, h level, n the axis."""
    alpha, precession, spin, R = 1.1, 1.0, -4.0, 0.5
    A, C = R**2 / 4, R**2 / 2  # for 1 kg
    times = np.linspace(0.0, 5.0, 51)

    def rates(_, y):
        tilt, u, h, n = y
        turn = u / np.tan(tilt)  # of the frame about n
        return [
            -h,
            h * (A * turn - C * n) / A,
            ((C + R**2) * u * n + G * R * np.cos(tilt) - A * turn * u) / (A + R**2),
            -(R**2) * u * h / (C + R**2),
        ]

    start = [alpha, precession * np.sin(alpha), 0.0, spin]
    y = solve_ivp(rates, (0, 5), start, t_eval=times, rtol=1e-12, atol=1e-12).y
    run = mb.simulate(rolling_disc.scene(alpha=alpha, precession=precession, spin=spin), times=times)
    assert np.ptp(y[0]) > 0.1
    meets(run, 1e-6, alpha=y[0], spin=y[3])


def test_half_car_over_a_bump():
    """Equations written by hand in the state (x, y, theta, front x and y, rear x and y), integrated by SciPy."""
    run = mb.simulate(half_car.scene(), mb.DormandPrince(rtol=1e-9))
    mass, inertia, axle, g, tyre, radius = 690.0, 1200.0, 40.0, 9.81, 190e3, half_car.RADIUS
    bump = PchipInterpolator(0.6 * np.linspace(0, 1, 9), 0.08 * np.sin(np.pi * np.linspace(0, 1, 9)) ** 2)
    K, C = np.diag([300e3, 22e3]), np.diag([3e3, 1.6e3])

    def rates(t, state):
        q, v = state[:7], state[7:]
        c, s = np.cos(q[2]), np.sin(q[2])
        R, turned = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
        a = np.array([0, -g, 0, 0, -g, 0, -g])
        for k, (along, behind) in enumerate(((1.3, 0.0), (-1.3, half_car.WHEELBASE))):
            wheel, speed = q[3 + 2 * k : 5 + 2 * k], v[3 + 2 * k : 5 + 2 * k]
            arm = wheel - q[:2]
            d = R.T @ arm - [along, -0.3]
            d_dot = R.T @ (speed - v[:2]) + turned.T @ arm * v[2]
            force = -R @ (K @ d + C @ d_dot)  # on the wheel
            at = 10.0 * t - behind
            inside = 0 < at < 0.6
            depth = radius - wheel[1] + (float(bump(at)) if inside else 0.0)
            rate = -speed[1] + (10.0 * float(bump(at, 1)) if inside else 0.0)
            road = max(0.0, tyre * depth + 100.0 * rate) if depth > 0 else 0.0
            a[3 + 2 * k : 5 + 2 * k] += (force + [0, road]) / axle
            a[:2] -= force / mass
            a[2] -= (arm[0] * force[1] - arm[1] * force[0]) / inertia
        return np.hstack([v, a])

    start = np.hstack([run.q[0][[0, 1, 2, 3, 4, 6, 7]], np.zeros(7)])
    known = solve_ivp(rates, (0, 1.5), start, "DOP853", run.t, rtol=1e-9, atol=1e-10, max_step=2e-3).y
    meets(run, 1e-6, bounce=known[1] - known[1, 0], pitch=known[2], **{"front.y": known[4]})
    assert (run["front_lift"].max() > 0.05) and (run["rear_lift"].max() > 0.05)
