"""Random scenes with joints that open and close, against equations of motion by hand that SciPy integrates to events.

    python tests/benchmarks/releases.py [scenes of each kind] [seed]

It prints the largest error of the outputs and of the times of events over the size of each output, and how far the work
of impulses is from the change of kinetic energy, and ends with status 1 above 1e-7. Two bodies in the air that a joint
lets go and catches again balance impulses, momentum and energy: to 1e-12 over the catch, to 1e-8 over the run.
"""

import sys
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

G = 9.81
TIMES = np.linspace(0.0, 1.0, 21)
Reference = tuple[np.ndarray, list[float], list[float]]
"""Outputs (n_t, n_y), times of events, and works of impulses."""


def integrated(
    phases: Sequence[tuple[Callable, Callable | None, Callable | None]],
    y0: np.ndarray,
    outputs: Sequence[Callable],
    times: np.ndarray = TIMES,
) -> Reference:
    """Phases of (rates, event, jump of state with its work), one after the other; outputs of each phase."""
    t, y, values, whens, works = 0.0, np.asarray(y0, float), np.empty((len(times), 0)), [], []
    for (rates, event, jump), out in zip(phases, outputs, strict=True):
        if event is not None:
            event.terminal, event.direction = True, -1
        solution = solve_ivp(
            rates, (t, times[-1]), y, "DOP853", dense_output=True, events=event, rtol=1e-12, atol=1e-13
        )
        own = times >= t
        found = np.array([out(solution.sol(time)) for time in times[own]])
        values = values if values.size else np.zeros((len(times), found.shape[1]))
        values[own] = found
        if event is None or not solution.t_events[0].size:
            break
        t, y = float(solution.t_events[0][0]), solution.y_events[0][0]
        y, work = jump(y)
        whens.append(t)
        works.append(work)
    return values, whens, works


def pendulum(random: np.random.Generator, space: bool) -> tuple[mb.Scene, Reference]:
    """A rod whose pin opens at an angle or at a speed, and that then flies; in space about a skew horizontal axis."""
    m, J, c = random.uniform(0.5, 2, 3)
    angle, omega = random.uniform(-0.5, 0.5), random.uniform(2, 4)
    limit, gravity = angle + random.uniform(0.3, 0.8), mb.Gravity(0, -G)
    if space:
        rod = mb.Body("rod", m, (J, 2 * J, J), mb.Spatial())  # theta turns it about z
        pin = mb.Revolute("pin", mb.Ground().point(0, 0, 0), rod.point(-c, 0, 0))
        start = {"pin.angle": angle, "pin.angle_rate": omega}
        passed = ca.dot(rod.frame.R[:, 0], ca.vertcat(-np.sin(limit), np.cos(limit), 0)) > 0
        outputs = {"x": rod.x, "y": rod.y, "vx": rod.vx, "omega": rod.frame.omega[2]}
    else:
        rod = mb.Body("rod", m, J)
        pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(-c, 0))
        start = {"rod.theta": angle, "rod.omega": omega}
        passed, outputs = rod.theta > limit, {"x": rod.x, "y": rod.y, "vx": rod.vx, "omega": rod.omega}
    scene = mb.Scene(mb.System(rod, pin, gravity, mb.Release(pin, passed)), start, TIMES, outputs)

    def flight(y):
        th, w = y
        return (np.array([c * np.cos(th), c * np.sin(th), th, -c * w * np.sin(th), c * w * np.cos(th), w]), 0.0)

    phases = [
        (lambda t, y: [y[1], -m * G * c * np.cos(y[0]) / (J + m * c**2)], lambda t, y: limit - y[0], flight),
        (lambda t, y: [y[3], y[4], y[5], 0, -G, 0], None, None),
    ]
    out = [
        lambda y: [c * np.cos(y[0]), c * np.sin(y[0]), -c * y[1] * np.sin(y[0]), y[1]],
        lambda y: [y[0], y[1], y[3], y[5]],
    ]
    return scene, integrated(phases, np.array([angle, omega]), out)


def shear_pin(random: np.random.Generator) -> tuple[mb.Scene, Reference]:
    """A rod that falls from the horizontal, and whose pin breaks at a force."""
    m, J, c, share = random.uniform([0.5, 0.2, 0.5, 0.4], [2, 1, 1.5, 0.9])
    about = J + m * c**2
    most = m * G * (1 + 2 * m * c**2 / about)  # as it hangs
    rod, limit = mb.Body("rod", m, J), share * most
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(-c, 0))
    breaks = mb.Release(pin, lambda pull: pull.fx**2 + pull.fy**2 > limit**2)
    outputs = {"x": rod.x, "y": rod.y, "vx": rod.vx, "omega": rod.omega}
    scene = mb.Scene(mb.System(rod, pin, mb.Gravity(0, -G), breaks), {"rod.theta": 0.0}, 2 * TIMES, outputs)

    def swing(t, y):
        return [y[1], -m * G * c * np.cos(y[0]) / about]

    def reserve(t, y):
        e, n = np.array([np.cos(y[0]), np.sin(y[0])]), np.array([-np.sin(y[0]), np.cos(y[0])])
        force = m * (c * swing(t, y)[1] * n - c * y[1] ** 2 * e + np.array([0, G]))
        return limit**2 - force @ force

    def flight(y):
        th, w = y
        return np.array([c * np.cos(th), c * np.sin(th), th, -c * w * np.sin(th), c * w * np.cos(th), w]), 0.0

    phases = [(swing, reserve, flight), (lambda t, y: [y[3], y[4], y[5], 0, -G, 0], None, None)]
    out = [
        lambda y: [c * np.cos(y[0]), c * np.sin(y[0]), -c * y[1] * np.sin(y[0]), y[1]],
        lambda y: [y[0], y[1], y[3], y[5]],
    ]
    return scene, integrated(phases, np.zeros(2), out, 2 * TIMES)


def sling(random: np.random.Generator) -> tuple[mb.Scene, Reference]:
    """A trebuchet: an arm under a torque, a stone in a sling that opens when the stone rises steeply enough."""
    M, J, c, L, length, m, torque = random.uniform([1, 1, 0.2, 1, 0.5, 0.05, 40], [3, 2, 0.4, 2, 1, 0.2, 80])
    th, ph = random.uniform(2.8, 3.4), random.uniform(2.0, 2.6)
    arm, stone = mb.Body("arm", M, J), mb.Body("stone", m, pose=mb.Particle())
    ground = mb.Ground()
    hinge = mb.Revolute("hinge", ground.point(0, 0), arm.point(-c, 0))
    tip = arm.point(L - c, 0)
    rope = mb.Distance("sling", tip, stone.point(0, 0), length)
    limit = random.uniform(0.4, 0.8)
    system = mb.System(
        arm,
        stone,
        hinge,
        rope,
        mb.Torque("motor", arm, -torque),
        mb.Gravity(0, -G),
        mb.Release(rope, arm.theta < th - limit),
    )
    x, y = L * np.cos(th) + length * np.cos(ph), L * np.sin(th) + length * np.sin(ph)
    start = {"arm.theta": th, "arm.omega": 0.0, "stone.x": x, "stone.y": y, "stone.z": 0.0}
    start |= {"stone.vx": 0.0, "stone.vy": 0.0}
    scene = mb.Scene(system, start, TIMES, {"x": stone.x, "y": stone.y, "vy": stone.vy, "theta": arm.theta})
    about = J + M * c**2

    def swing(t, s):
        a, b, da, db = s
        k, off = m * L * length, a - b
        A = np.array([[about + m * L**2, k * np.cos(off)], [k * np.cos(off), m * length**2]])
        r = [
            -torque - (M * c + m * L) * G * np.cos(a) - k * np.sin(off) * db**2,
            -m * G * length * np.cos(b) + k * np.sin(off) * da**2,
        ]
        return [da, db, *np.linalg.solve(A, r)]

    def stone_at(s):
        a, b, da, db = s
        e, f = np.array([np.cos(a), np.sin(a)]), np.array([np.cos(b), np.sin(b)])
        n, o = np.array([-e[1], e[0]]), np.array([-f[1], f[0]])
        return np.concatenate([L * e + length * f, L * da * n + length * db * o])

    def opens(s):
        return np.concatenate([stone_at(s), [s[0], s[2]]]), 0.0

    def fly(t, s):
        return [s[2], s[3], 0, -G, s[5], (-torque - M * c * G * np.cos(s[4])) / about]

    out = [lambda s: [*stone_at(s)[[0, 1, 3]], s[0]], lambda s: [s[0], s[1], s[3], s[4]]]
    event = lambda t, s: s[0] - (th - limit)  # noqa: E731
    return scene, integrated([(swing, event, opens), (fly, None, None)], np.array([th, ph, 0.0, 0.0]), out)


def blocks(random: np.random.Generator) -> tuple[mb.Scene, Reference]:
    """A block on a spring that catches another one: an inelastic impact."""
    m, M, k, gap = random.uniform([0.5, 0.5, 20, 0.2], [2, 2, 60, 0.4])
    v = random.uniform(2, 4)
    a, b = (mb.Body(name, mass, 1.0) for name, mass in (("a", m), ("b", M)))
    ground = mb.Ground()
    rails = [mb.Prismatic(f"rail_{e.name}", ground.point(0, 0), e.point(0, 0), axis=(1, 0, 0)) for e in (a, b)]
    spring = mb.Spring("spring", ground.point(0, 0), a.point(0, 0), k)
    hook = mb.Weld("hook", a.point(0, 0), b.point(0, 0))
    system = mb.System(a, b, *rails, spring, hook, mb.Latch(hook, b.x - a.x < gap / 2))
    scene = mb.Scene(system, {"a.x": 0.0, "a.vx": v, "b.x": gap}, TIMES, {"a": a.x, "b": b.x, "va": a.vx})

    def catch(y):
        u = (m * y[2] + M * y[3]) / (m + M)
        return np.array([y[0], y[1], u, u]), -0.5 * m * M / (m + M) * (y[2] - y[3]) ** 2

    phases = [
        (lambda t, y: [y[2], y[3], -k * y[0] / m, 0.0], lambda t, y: y[1] - y[0] - gap / 2, catch),
        (lambda t, y: [y[2], y[3], *[-k * y[0] / (m + M)] * 2], None, None),
    ]
    return scene, integrated(phases, np.array([0.0, gap, v, 0.0]), [lambda y: [y[0], y[1], y[2]]] * 2)


def wheels(random: np.random.Generator, space: bool) -> tuple[mb.Scene, Reference]:
    """A wheel under a torque that a pin latches to another one on the same shaft, at an angle between them."""
    A, B, torque, angle, u, w = random.uniform([0.5, 0.5, 1, 0.5, 1, 0], [2, 2, 5, 1.5, 3, 0.5])
    ground = mb.Ground()
    axis = random.normal(size=3) if space else np.array([0.0, 0.0, 1.0])
    axis = axis / np.linalg.norm(axis)
    if space:
        a, b = (mb.Body(name, 1.0, (J, J, J), mb.Spatial()) for name, J in (("a", A), ("b", B)))
        load = mb.Torque("motor", a, tuple(torque * axis))
        c, z = (0, 0, 0), tuple(axis)
    else:
        a, b = (mb.Body(name, 1.0, J) for name, J in (("a", A), ("b", B)))
        load, c, z = mb.Torque("motor", a, torque), (0, 0), (0, 0, 1)
    hinges = [mb.Revolute(f"hinge_{e.name}", ground.point(*c), e.point(*c), axis=z) for e in (a, b)]
    at = (0.3, 0.2, 0.1)[: len(c)]
    pin = (mb.Weld if space else mb.Revolute)("pin", a.point(*at), b.point(*at))
    ahead = hinges[0].angle - hinges[1].angle
    system = mb.System(a, b, *hinges, load, pin, mb.Latch(pin, ahead > angle))
    rates = [hinge.angle_rate for hinge in hinges]
    scene = mb.Scene(
        system,
        {"hinge_a.angle": 0.0, "hinge_b.angle": 0.0, "hinge_a.angle_rate": u, "hinge_b.angle_rate": w},
        TIMES,
        {"a": hinges[0].angle, "b": hinges[1].angle, "rate": rates[0], "other": rates[1]},
    )

    def together(y):
        v = (A * y[2] + B * y[3]) / (A + B)
        return np.array([y[0], y[1], v, v]), -0.5 * A * B / (A + B) * (y[2] - y[3]) ** 2

    phases = [
        (lambda t, y: [y[2], y[3], torque / A, 0.0], lambda t, y: angle - y[0] + y[1], together),
        (lambda t, y: [y[2], y[3], *[torque / (A + B)] * 2], None, None),
    ]
    return scene, integrated(phases, np.array([0.0, 0.0, u, w]), [lambda y: [*y]] * 2)


def four_bar(random: np.random.Generator) -> tuple[mb.Scene, Reference]:
    """A four-bar whose coupler pin opens, and a hook that catches the coupler in the air."""
    lengths = random.uniform([0.4, 1.4, 1.2], [0.6, 1.8, 1.5])
    masses, base, angle, omega = random.uniform(0.5, 2, 3), random.uniform(1.6, 2.0), 0.3, random.uniform(4, 6)
    inertias = masses * lengths**2 / 12
    reach = np.array([base - lengths[0] * np.cos(angle), -lengths[0] * np.sin(angle)])
    d = np.linalg.norm(reach)
    inner = np.arccos((d**2 + lengths[1] ** 2 - lengths[2] ** 2) / (2 * d * lengths[1]))
    b = np.arctan2(reach[1], reach[0]) + inner
    top = lengths[0] * np.array([np.cos(angle), np.sin(angle)]) + lengths[1] * np.array([np.cos(b), np.sin(b)])
    a3 = np.arctan2(top[1], top[0] - base)
    angles = np.array([angle, b, a3])
    bodies = [mb.Body(n, m, J) for n, m, J in zip(("crank", "coupler", "rocker"), masses, inertias, strict=True)]
    ground = mb.Ground()
    ends = [(e.point(-length / 2, 0), e.point(length / 2, 0)) for e, length in zip(bodies, lengths, strict=True)]
    joints = [
        mb.Revolute("A", ground.point(0, 0), ends[0][0]),
        mb.Revolute("B", ends[0][1], ends[1][0]),
        mb.Revolute("C", ends[1][1], ends[2][1]),
        mb.Revolute("D", ground.point(base, 0), ends[2][0]),
    ]
    opening, catching = random.uniform(0.2, 0.4), random.uniform(0.4, 0.5)
    hook = mb.Revolute("hook", ground.point(0.5, 0.5), bodies[1].point(lengths[1] / 4, 0))
    events = mb.Release(joints[2], bodies[0].theta > angle + opening), mb.Latch(hook, mb.t > catching)
    system = mb.System(*bodies, *joints, hook, *events, mb.Gravity(0, -G))
    start = {"crank.theta": angle, "crank.omega": omega}
    guess = {"coupler.theta": b, "rocker.theta": a3}
    outputs = {"x": bodies[1].x, "theta": bodies[1].theta, "crank": bodies[0].omega, "rocker": bodies[2].theta}
    scene = mb.Scene(system, start, TIMES, outputs, guess=guess)

    def arms(q):
        return [0.5 * length * np.array([np.cos(a), np.sin(a)]) for length, a in zip(lengths, q[2::3], strict=True)]

    def rows(q, v, phase):
        """Jacobian and -(d/dt J) v of pins as differences of points: (body, share of its half length, sign)."""
        pins = [[(0, -1, 1)], [(0, 1, -1), (1, -1, 1)], [(2, -1, 1)]]
        pins += [[(1, 1, -1), (2, 1, 1)]] if phase == 0 else []
        pins += [[(1, 0.5, 1)]] if phase == 2 else []
        J, g, e = np.zeros((2 * len(pins), 9)), np.zeros(2 * len(pins)), arms(q)
        for i, pin in enumerate(pins):
            for body, share, sign in pin:
                at, own = share * e[body], slice(3 * body, 3 * body + 2)
                J[2 * i : 2 * i + 2, own] += sign * np.eye(2)
                J[2 * i : 2 * i + 2, 3 * body + 2] += sign * np.array([-at[1], at[0]])
                g[2 * i : 2 * i + 2] += sign * at * v[3 * body + 2] ** 2
        return J, g

    M = np.diag(np.column_stack([masses, masses, inertias]).ravel())

    def rates(phase):
        def of(t, y):
            q, v = y[:9], y[9:]
            J, g = rows(q, v, phase)
            n = len(g)
            Q = np.zeros(9)
            Q[1::3] = -masses * G
            a = np.linalg.solve(np.block([[M, J.T], [J, np.zeros((n, n))]]), np.concatenate([Q, g]))[:9]
            return np.concatenate([v, a])

        return of

    def catch(y):
        J, _ = rows(y[:9], y[9:10].repeat(9), 2)
        v = y[9:]
        new = v - np.linalg.solve(M, J.T @ np.linalg.solve(J @ np.linalg.solve(M, J.T), J @ v))
        return np.concatenate([y[:9], new]), 0.5 * (new @ M @ new - v @ M @ v)

    q = np.zeros(9)
    q[2::3] = angles
    e = arms(q)
    for k, r in enumerate((e[0], 2 * e[0] + e[1], np.array([base, 0]) + e[2])):
        q[3 * k : 3 * k + 2] = r
    J, _ = rows(q, np.zeros(9), 0)
    turn = np.zeros(9)
    turn[2] = 1.0
    v = np.linalg.solve(np.vstack([J, turn]), np.append(np.zeros(8), omega))
    phases = [
        (rates(0), lambda t, y: angle + opening - y[2], lambda y: (y, 0.0)),
        (rates(1), lambda t, y: catching - t, catch),
        (rates(2), None, None),
    ]
    return scene, integrated(phases, np.concatenate([q, v]), [lambda y: [y[3], y[5], y[11], y[8]]] * 3)


def top(random: np.random.Generator, closes: bool) -> tuple[mb.Scene, Reference]:
    """A body in space on a ball joint that opens; or one that flies, and that a hook catches at a point."""
    m, arm = random.uniform(0.5, 2), random.uniform(-0.5, 0.5, 3)
    J = random.uniform(0.5, 0.7, 3)
    body = mb.Body("body", m, tuple(J), mb.Spatial())
    joint = mb.Spherical("ball", mb.Ground().point(0, 0, 0), body.point(*arm))
    omega, when = random.uniform(-3, 3, 3), random.uniform(0.3, 0.5)
    drop = random.uniform(0.2, 0.4)
    inertia = np.diag(J)

    def R(e):
        w, x, y, z = e / np.linalg.norm(e)
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    def quaternion_rate(e, w):
        W = np.array([[0, -w[0], -w[1], -w[2]], [w[0], 0, w[2], -w[1]], [w[1], -w[2], 0, w[0]], [w[2], w[1], -w[0], 0]])
        return 0.5 * W @ e

    S = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    about = inertia - m * S @ S

    def held(t, y):  # place of the joint, quaternion, omega
        e, w = y[3:7], y[7:]
        weight = R(e).T @ np.array([0, -m * G, 0])
        return [
            0,
            0,
            0,
            *quaternion_rate(e, w),
            *np.linalg.solve(about, np.cross(-arm, weight) - np.cross(w, about @ w)),
        ]

    def free(t, y):  # r, quaternion, omega, r'
        e, w = y[3:7], y[7:10]
        return [*y[10:], *quaternion_rate(e, w), *np.linalg.solve(inertia, -np.cross(w, inertia @ w)), 0, -G, 0]

    def of_held(y):
        turn, w = R(y[3:7]), y[7:]
        return [*(y[:3] - turn @ arm), *(turn @ np.cross(w, -arm)), *w]

    def of_free(y):
        return [*y[:3], *y[10:], *y[7:10]]

    outputs = {"x": body.x, "y": body.y, "z": body.z, "vx": body.vx, "vy": body.vy, "vz": body.vz}
    outputs |= {f"w{k}": body.frame.omega[k] for k in range(3)}
    gravity = mb.Gravity(0, -G, 0)
    identity = [1.0, 0, 0, 0]
    if not closes:
        system = mb.System(body, joint, gravity, mb.Release(joint, mb.t > when))

        def opens(y):
            r = np.array(of_held(y))
            return np.concatenate([r[:3], y[3:7], y[7:], r[3:6]]), 0.0

        scene = mb.Scene(
            system, {"body.rotation": mb.rotation((0, 0, 1), 0.0), "body.omega": tuple(omega)}, TIMES, outputs
        )
        y0 = np.concatenate([np.zeros(3), identity, omega])
        phases = [(held, lambda t, y: when - t, opens), (free, None, None)]
        return scene, integrated(phases, y0, [of_held, of_free])
    system = mb.System(body, joint, gravity, mb.Latch(joint, body.point(*arm).y < arm[1] - drop))

    def grips(y):
        w, v = y[7:10], R(y[3:7]).T @ y[10:]
        # Angular momentum about the point that is held stays: all impulses pass through it.
        new = np.linalg.solve(about, inertia @ w + m * np.cross(-arm, v))
        work = 0.5 * new @ about @ new - 0.5 * w @ inertia @ w - 0.5 * m * v @ v
        return np.concatenate([y[:3] + R(y[3:7]) @ arm, y[3:7], new]), work

    start = {"body.x": 0.0, "body.y": 0.0, "body.z": 0.0, "body.rotation": mb.rotation((0, 0, 1), 0.0)}
    start |= {"body.omega": tuple(omega), "body.vx": 1.0, "body.vy": 0.0, "body.vz": 0.0}
    scene = mb.Scene(system, start, TIMES, outputs)
    y0 = np.concatenate([np.zeros(3), identity, omega, [1.0, 0, 0]])

    def falls(t, y):
        return (y[:3] + R(y[3:7]) @ arm)[1] - arm[1] + drop

    return scene, integrated([(free, falls, grips), (held, None, None)], y0, [of_free, of_held])


KINDS: dict[str, Callable[[np.random.Generator], tuple[mb.Scene, Reference]]] = {
    "pendulum in the plane": lambda random: pendulum(random, False),
    "pendulum in space": lambda random: pendulum(random, True),
    "shear pin": shear_pin,
    "sling": sling,
    "blocks": blocks,
    "wheels in the plane": lambda random: wheels(random, False),
    "wheels in space": lambda random: wheels(random, True),
    "four-bar": four_bar,
    "top that is let go": lambda random: top(random, False),
    "top that is caught": lambda random: top(random, True),
}


CAUGHT: dict[str, tuple[type, bool, bool]] = {
    "weld in the plane": (mb.Weld, False, True),
    "weld in space": (mb.Weld, True, True),
    "hinge in the plane": (mb.Revolute, False, True),
    "hinge in space": (mb.Revolute, True, True),
    "ball joint": (mb.Spherical, True, True),
    "slide in the plane": (mb.Prismatic, False, False),
    "slide in space": (mb.Prismatic, True, False),
    "cylinder": (mb.Cylindrical, True, False),
    "table": (mb.PlanarJoint, True, False),
    "bead": (mb.PointOnLine, True, False),
}
"""Joints, whether their bodies are in space, and whether their first rows are the difference of two points."""


def imbalance(kind: str, seed: int) -> tuple[float, float]:
    """Shares that are missing in the balances of two bodies whose joint opens at 0.3 s and closes at 0.6 s.

    Their inertias are the same about all axes, so that angular velocities stay in the air. Returns the largest share
    over the catch, of impulses, momentum, angular momentum and work, and over the run, of momenta and energy.
    """
    make, space, by_points = CAUGHT[kind]
    random, n, masses, inertias = np.random.default_rng(seed), 2 + space, [], []
    bodies, start, outputs = [], {}, {}
    for name in "ab":
        m, J = random.uniform(0.5, 2, 2)
        body = mb.Body(name, m, (J, J, J) if space else J, mb.Spatial() if space else mb.Planar())
        masses, inertias, bodies = [*masses, m], [*inertias, J], [*bodies, body]
        turning = ca.vertsplit(body.frame.R @ body.frame.omega)
        for part in ([body.x, body.y, body.z], [body.vx, body.vy, body.vz], turning):
            outputs |= {f"{name}{len(outputs) + k}": e for k, e in enumerate(part)}
    turns = ("omega_x", "omega_y", "omega_z") if space else ("omega",)
    start |= {f"a.{c}": random.uniform(-1, 1) for c in ("vx", "vy", "vz")[:n]}
    start |= {f"a.{c}": random.uniform(-6, 6) for c in turns}
    axis = (
        {"axis": (*random.normal(size=n), *[0] * (3 - n))} if not by_points or (space and make is mb.Revolute) else {}
    )
    joint = make("joint", *(body.point(*random.uniform(-0.5, 0.5, n)) for body in bodies), **axis)
    system = mb.System(*bodies, joint, mb.Release(joint, mb.t > 0.3), mb.Latch(joint, mb.t > 0.6))
    run = mb.simulate(mb.Scene(system, start, [0.0, 0.45, 0.6 + 1e-15, 1.0], outputs))  # events are off by rounding
    opening, closing = run.events
    assert (opening.what, closing.what) == ("opens", "closes")
    r, v, w = run.values.reshape(4, 2, 3, 3).transpose(2, 0, 1, 3)  # times, bodies, axes
    m, J = np.array(masses)[:, None], np.array(inertias)[:, None]
    momentum, turn = (m * v).sum(axis=1), (m * np.cross(r, v) + J * w).sum(axis=1)
    energy = ((m * v * v + J * w * w) / 2).sum(axis=(1, 2))
    jump = (m * (v[2] - v[1]))[1]  # of b
    size, lost = np.abs(m * v).max(), [energy[2] - energy[1] - closing.work]
    at = [*(momentum[2] - momentum[1]) / size, *(turn[2] - turn[1]) / np.abs(turn).max(), *lost / energy[0]]
    if by_points:
        at += [*(jump[:n] + closing.impulse[:n]) / size]
    before = energy - [0, 0, closing.work, closing.work]
    over = [*np.ptp(momentum, axis=0) / size, *np.ptp(turn, axis=0) / np.abs(turn).max(), np.ptp(before) / energy[0]]
    return float(np.abs(at).max()), float(np.abs(over).max())


def errors(kind: str, seed: int) -> tuple[float, float, float]:
    """Errors of outputs, of times of events, and of the work of impulses, for one random scene."""
    scene, (values, times, works) = KINDS[kind](np.random.default_rng(seed))
    run = mb.simulate(scene)
    of_values = np.abs(run.values - values).max(axis=0) / np.maximum(np.abs(values).max(axis=0), 1e-2)
    assert len(run.events) == len(times), (kind, seed, run.events, times)
    of_times = max((abs(event.time - time) for event, time in zip(run.events, times, strict=True)), default=0.0)
    of_works = max((abs(e.work - w) / max(abs(w), 1.0) for e, w in zip(run.events, works, strict=True)), default=0.0)
    return float(of_values.max()), of_times, of_works


def main() -> int:
    count, seed = (int(text) for text in (sys.argv[1:] + ["4", "0"][len(sys.argv) - 1 :])[:2])
    worst = 0.0
    for kind in KINDS:
        found = np.array([errors(kind, seed + k) for k in range(count)]).max(axis=0)
        worst = max(worst, found.max())
        print(f"{kind:24} outputs {found[0]:.1e}  times {found[1]:.1e}  work {found[2]:.1e}", flush=True)
    balanced = True
    for kind in CAUGHT:
        catch, over = np.array([imbalance(kind, seed + k) for k in range(count)]).max(axis=0)
        balanced &= bool(catch < 1e-12 and over < 1e-8)
        print(f"{kind:24} missing at the catch {catch:.1e}  over the run {over:.1e}", flush=True)
    return int(worst > 1e-7 or not balanced)


if __name__ == "__main__":
    sys.exit(main())
