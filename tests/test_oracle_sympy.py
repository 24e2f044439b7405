"""The equations of motion against those of the paper and of SymPy's own mechanics."""

import numpy as np
import sympy as sp
import sympy.physics.mechanics as me
from joints import bundle, numbers
from numpy.testing import assert_allclose

import symmb as mb


def double_pendulum():
    p = mb.Parameters(l1=1.0, l2=1.0)
    rod1 = mb.Body("rod1", p.l1, p.l1**3 / 12, mb.Planar())
    rod2 = mb.Body("rod2", p.l2, p.l2**3 / 12, mb.Planar())
    return bundle(
        rod1, rod2,
        mb.Revolute("shoulder", mb.Ground().point(0, 0), rod1.point(0, -p.l1 / 2)),
        mb.Revolute("elbow", rod1.point(0, p.l1 / 2), rod2.point(0, -p.l2 / 2)),
        mb.Gravity(0, 9.81),
        parameters=p,
    )  # fmt: skip


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
PAPER_PHI_Q = sp.Matrix([
    [1, 0, -L1 / 2 * sp.cos(T1), 0, 0, 0],
    [0, 1, L1 / 2 * sp.sin(T1), 0, 0, 0],
    [0, 0, -L1 * sp.cos(T1), 1, 0, -L2 / 2 * sp.cos(T2)],
    [0, 0, L1 * sp.sin(T1), 0, 1, L2 / 2 * sp.sin(T2)],
])  # fmt: skip


def test_the_double_pendulum_has_the_paper_s_equations():
    """Eqs. (37) and (38) of Wang & Yang (2021), with y downwards, m = l and I = l^3/12."""
    system, _ = double_pendulum()
    ours = system.to_sympy()
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
    _, dae = double_pendulum()
    kane = kane_double_pendulum()
    rng = np.random.default_rng(3)
    for _ in range(5):
        (a, b), (wa, wb), (l1, l2) = rng.uniform(-3, 3, 2), rng.uniform(-4, 4, 2), rng.uniform(0.7, 1.3, 2)
        aa, ab = kane(a, b, wa, wb, l1, l2)
        along = {k: np.array([-np.sin(k), np.cos(k)]) for k in (a, b)}
        across = {k: np.array([-np.cos(k), -np.sin(k)]) for k in (a, b)}
        r1 = l1 / 2 * along[a]
        r2 = l1 * along[a] + l2 / 2 * along[b]
        v1, v2 = l1 / 2 * wa * across[a], l1 * wa * across[a] + l2 / 2 * wb * across[b]

        def turning(length, angle, rate, acceleration, along=along, across=across):
            return length * (acceleration * across[angle] - rate**2 * along[angle])

        expected = [
            *turning(l1 / 2, a, wa, aa), aa,
            *(turning(l1, a, wa, aa) + turning(l2 / 2, b, wb, ab)), ab,
        ]  # fmt: skip
        _, vdot = dae.rhs([*r1, a, *r2, b], [*v1, wa, *v2, wb], [l1, l2], 0.0)
        assert_allclose(vdot.full().ravel(), expected, rtol=1e-12, atol=1e-12)


R, L, M1, M2, M3, J1, J2, K = 0.3, 0.9, 1.1, 1.7, 2.3, 0.02, 0.15, 40.0


def slider_crank():
    """Crank and rod with masses in their middle, slider on the x axis, a spring on the slider, y upwards."""
    ground = mb.Ground()
    crank = mb.Body("crank", M1, J1, mb.Planar())
    rod = mb.Body("rod", M2, J2, mb.Planar())
    slider = mb.Body("slider", M3, 1.0, mb.Planar())
    return bundle(
        crank, rod, slider,
        mb.Revolute("main", ground.point(0, 0), crank.point(-R / 2, 0)),
        mb.Revolute("pin", crank.point(R / 2, 0), rod.point(-L / 2, 0)),
        mb.Revolute("wrist", rod.point(L / 2, 0), slider.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), slider.point(0, 0), axis=(1, 0, 0)),
        mb.Gravity(0, -9.81),
        mb.Spring("spring", ground.point(0, 0), slider.point(0, 0), K, 0.4),
    )  # fmt: skip


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
        ea, eb = (np.array([np.cos(k), np.sin(k)]) for k in (a, b))
        na, nb = (np.array([-np.sin(k), np.cos(k)]) for k in (a, b))
        q = [*(R / 2 * ea), a, *(R * ea + L / 2 * eb), b, x, 0, 0]
        v = [*(R / 2 * wa * na), wa, *(R * wa * na + L / 2 * wb * nb), wb, vx, 0, 0]
        crank, rod = R * (aa * na - wa**2 * ea), L * (ab * nb - wb**2 * eb)
        expected = [*(crank / 2), aa, *(crank + rod / 2), ab, ax, 0, 0]
        assert_allclose(numbers(dae.Phi, q, v, [], 0.0), 0, atol=1e-15)
        _, vdot = dae.rhs(q, v, [], 0.0)
        assert_allclose(vdot.full().ravel(), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
