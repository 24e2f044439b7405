"""Random machines in MJCF, and accelerations of MuJoCo and of symmb in the same state."""

import warnings
from dataclasses import dataclass, field

import numpy as np
from black_boxes import quietly

import symmb as mb

FLAGS = '<flag contact="disable" limit="disable" frictionloss="disable"/>'
"""MuJoCo without what symmb leaves out."""
SHAPES = ("box", "sphere", "capsule", "cylinder", "ellipsoid")


def numbers(values):
    return " ".join(f"{float(value)!r}" for value in np.atleast_1d(values))


@dataclass
class Drawing:
    """A file in the making: one random tree, with loops on request."""

    rng: np.random.Generator
    most: int = 7
    degrees: bool = True
    bodies: list = field(default_factory=list)
    joints: dict = field(default_factory=dict)
    children: dict = field(default_factory=dict)

    def vector(self, size=0.4):
        return numbers(self.rng.uniform(-size, size, 3))

    def angle(self):
        value = self.rng.uniform(-1, 1)
        return repr(float(np.degrees(value) if self.degrees else value))

    def turn(self):
        kinds = (
            lambda: "",
            lambda: f' quat="{numbers(self.rng.normal(size=4))}"',
            lambda: f' axisangle="{self.vector(1)} {self.angle()}"',
            lambda: f' euler="{" ".join(self.angle() for _ in range(3))}"',
        )
        return kinds[self.rng.integers(4)]()

    def inertia(self):
        if self.rng.random() < 0.4:
            a, b = self.rng.uniform(0.01, 0.1, 2)
            c = self.rng.uniform(abs(a - b) + 1e-3, a + b)
            mass, moments = self.rng.uniform(0.5, 3), numbers([a, b, c])
            return f'<inertial pos="{self.vector(0.2)}" mass="{mass!r}" diaginertia="{moments}"{self.turn()}/>'
        text = ""
        for _ in range(self.rng.integers(1, 3)):
            size = numbers(self.rng.uniform(0.05, 0.2, 3))
            shape = SHAPES[self.rng.integers(len(SHAPES))]
            text += f'<geom type="{shape}" size="{size}" pos="{self.vector(0.2)}"{self.turn()}/>'
        return text

    def joint(self, kind):
        name, rng = f"j{len(self.joints)}", self.rng
        self.joints[name] = kind
        text = f'<joint name="{name}" type="{kind}" pos="{self.vector(0.2)}"'
        if kind == "ball":
            return text + f' damping="{rng.uniform(0, 0.3)!r}"/>'
        text += f' axis="{self.vector(1)}"'
        if rng.random() < 0.5:
            text += f' damping="{rng.uniform(0, 1)!r}" stiffness="{rng.uniform(0, 20)!r}" springref="{self.angle()}"'
        if rng.random() < 0.3:
            text += f' armature="{rng.uniform(0.01, 0.2)!r}"'
        if rng.random() < 0.3:
            text += f' ref="{self.angle()}"'
        return text + "/>"

    def body(self, depth):
        """A body with its joints, and its children inside."""
        name, rng = f"b{len(self.bodies)}", self.rng
        self.bodies.append(name)
        compensated = f' gravcomp="{rng.uniform(0, 1)!r}"' if rng.random() < 0.2 else ""
        text = f'<body name="{name}" pos="{self.vector()}"{self.turn()}{compensated}>'
        draw = rng.random()
        if depth == 0 and draw < 0.2:
            self.joints[f"j{len(self.joints)}"] = "free"
            text += f'<freejoint name="j{len(self.joints) - 1}"/>'
        elif draw < 0.55:
            text += self.joint("hinge")
        elif draw < 0.7:
            text += self.joint("slide")
        elif draw < 0.8:
            text += self.joint("ball")
        elif draw < 0.92 or depth == 0:
            text += (self.joint("slide") if rng.random() < 0.5 else "") + self.joint("hinge") + self.joint("hinge")
        text += self.inertia() + f'<site name="s{name}" pos="{self.vector(0.2)}"{self.turn()}/>'
        while len(self.bodies) < self.most and rng.random() < (0.9 if depth < 3 else 0.3):
            text += self.body(depth + 1)
        return text + "</body>"

    def moving(self):
        return [name for name, kind in self.joints.items() if kind in ("hinge", "slide")]

    def forces(self):
        """Actuators and tendons."""
        rng, moving = self.rng, self.moving()
        if not moving:
            return ""
        one = lambda: moving[rng.integers(len(moving))]  # noqa: E731
        gear = f'gear="{rng.uniform(-2, 2)!r}"'
        laws = (
            f'<motor name="m0" joint="{one()}" {gear}/>',
            f'<position name="m1" joint="{one()}" kp="{rng.uniform(1, 9)!r}" kv="{rng.uniform(0, 1)!r}"/>',
            f'<velocity name="m2" joint="{one()}" kv="{rng.uniform(0, 2)!r}" {gear}/>',
            f'<general name="m3" jointinparent="{one()}" gaintype="affine" gainprm="1 0.3 -0.2" biastype="affine" '
            f'biasprm="0.4 -0.5 -0.1" {gear}/>',
            f'<general name="m4" joint="{one()}" dyntype="filter" dynprm="0.3" gainprm="2"/>',
            '<motor name="m5" tendon="t0" gear="1.5"/>',
            '<position name="m6" tendon="t1" kp="3"/>',
        )
        sites = rng.permutation(len(self.bodies))[:3]
        way = "".join(f'<site site="sb{k}"/>' for k in sites)
        coefficients = "".join(f'<joint joint="{name}" coef="{rng.uniform(-2, 2)!r}"/>' for name in moving[:3])
        tendons = (
            f'<spatial name="t0" stiffness="{rng.uniform(0, 9)!r}" damping="{rng.uniform(0, 1)!r}" '
            f'springlength="{rng.uniform(0, 1)!r}">{way}</spatial>'
            f'<fixed name="t1" stiffness="{rng.uniform(0, 9)!r}" damping="{rng.uniform(0, 1)!r}">{coefficients}</fixed>'
        )
        if len(sites) < 2:
            laws, tendons = laws[:5], ""
        return f"<tendon>{tendons}</tendon><actuator>{''.join(laws)}</actuator>"

    def file(self, loops=False):
        """The whole file."""
        self.degrees = bool(self.rng.random() < 0.5)
        compiler = f'<compiler angle="{"degree" if self.degrees else "radian"}"/>'
        trees = self.body(0)
        while len(self.bodies) < 3 or (loops and len(self.joints) < self.most - 1):
            trees += self.body(0)
        text = f'<mujoco>{compiler}<option gravity="{self.vector(10)}" jacobian="dense">{FLAGS}</option>'
        text += f"<worldbody>{trees}</worldbody>{self.forces()}"
        return text + (self.equalities() if loops else "") + "</mujoco>"

    def equalities(self):
        """One loop that is closed by a joint, and one joint that another one leads."""
        rng, moving = self.rng, self.moving()
        first, second = (f"b{k}" for k in rng.permutation(len(self.bodies))[:2])
        ends = f'name="e0" body1="{first}" body2="{second}"'
        text = f'<connect {ends} anchor="{self.vector(0.2)}"/>' if rng.random() < 0.7 else f"<weld {ends}/>"
        if len(moving) > 3 and rng.random() < 0.6:
            text += f'<joint name="e1" joint1="{moving[0]}" joint2="{moving[1]}" polycoef="0 0.6 0.2 0 0"/>'
        return f"<equality>{text}</equality>"


class Twin:
    """A file in MuJoCo and in symmb."""

    def __init__(self, mujoco, path, seed=0, controls=None):
        self.mujoco, self.rng = mujoco, np.random.default_rng(seed)
        self.model = mujoco.MjSpec.from_file(str(path)).compile()
        self.data = mujoco.MjData(self.model)
        names = [self.model.actuator(k).name for k in range(self.model.nu)]
        self.controls = dict(zip(names, self.rng.uniform(-1, 1, len(names)), strict=True))
        controls = {f"{name}.ctrl": value for name, value in self.controls.items()}
        self.robot = quietly(mb.load_mjcf, path, replace=controls)
        self.system = mb.System(*self.robot.elements)
        self.names = [self.model.joint(k).name for k in range(self.model.njnt)]

    def pose(self, spread=1.0):
        """A random state of MuJoCo's, on the manifold of its equality constraints."""
        m, d, rng = self.model, self.data, self.rng
        self.mujoco.mj_resetData(m, d)
        d.ctrl[:], d.act[:] = [*self.controls.values()], rng.uniform(-1, 1, m.na)
        self.mujoco.mj_integratePos(m, d.qpos, rng.uniform(-spread, spread, m.nv), 1.0)
        d.qvel[:] = rng.uniform(-1, 1, m.nv)
        for _ in range(50 if m.neq else 0):
            self.mujoco.mj_forward(m, d)
            self.mujoco.mj_integratePos(m, d.qpos, -np.linalg.pinv(self.J) @ d.efc_pos, 1.0)
        self.mujoco.mj_forward(m, d)
        if m.neq:
            d.qvel[:] -= np.linalg.pinv(self.J) @ (self.J @ d.qvel)
            self.mujoco.mj_forward(m, d)

    @property
    def J(self):
        """MuJoCo's rows (n, n_v) of the equality constraints."""
        return self.data.efc_J.reshape(-1, self.model.nv)

    def start(self):
        """The state of MuJoCo's as a start of symmb's."""
        m, d, robot, start = self.model, self.data, self.robot, {}
        for k, name in enumerate(self.names):
            q, v = m.jnt_qposadr[k], m.jnt_dofadr[k]
            joint = robot.joints.get(name)
            if joint is not None and joint.coordinate:
                start[f"{name}.{joint.coordinate}"] = d.qpos[q]
                start[f"{name}.{joint.coordinate}_rate"] = d.qvel[v]
                continue
            body = m.jnt_bodyid[k]
            link = robot.bodies[m.body(body).name]
            for what, values in self.motion(body, link).items():
                if joint is None or what == "rotation" or what.startswith("omega"):
                    start[f"{link.name}.{what}"] = values
        for k in range(m.nu):
            if m.actuator_actadr[k] >= 0:
                start[f"{m.actuator(k).name}:act"] = d.act[m.actuator_actadr[k]]
        return start

    def motion(self, body, link):
        """Coordinates and velocities of a body by name; its centre is that of all parts that are fixed to it."""
        m, d, twist = self.model, self.data, np.zeros(6)
        R, com = d.xmat[body].reshape(3, 3), np.array([float(x) for x in link.com])
        self.mujoco.mj_objectVelocity(m, d, self.mujoco.mjtObj.mjOBJ_XBODY, body, twist, 1)
        omega, velocity = twist[:3], R @ (twist[3:] + np.cross(twist[:3], com))
        w, *axis = d.xquat[body]
        turn = mb.rotation(axis if any(axis) else (0, 0, 1), 2 * np.arctan2(np.linalg.norm(axis), w))
        place = dict(zip("xyz", d.xpos[body] + R @ com, strict=True))
        rates = dict(zip(("vx", "vy", "vz", "omega_x", "omega_y", "omega_z"), [*velocity, *omega], strict=True))
        return {"rotation": turn, **place, **rates}

    def rates(self):
        """Velocities of symmb's in the order of MuJoCo's."""
        m, found = self.model, []
        for k, name in enumerate(self.names):
            joint = self.robot.joints.get(name)
            link = self.robot.bodies[m.body(m.jnt_bodyid[k]).name]
            if joint is None:
                found += [getattr(link.point(0, 0, 0), x) for x in ("vx", "vy", "vz")]
                found += [link.omega[i] for i in range(3)]
            elif joint.coordinate:
                found.append(getattr(joint, f"{joint.coordinate}_rate"))
            else:
                a, b = joint.bodies()
                relative = b.omega - b.rotation.T @ a.rotation @ a.frame.omega
                found += [relative[i] for i in range(3)]
        return found

    def own_accelerations(self):
        """Accelerations of symmb in the state of MuJoCo, in its order."""
        outputs = {f"a{k}": self.system.ddt(rate) for k, rate in enumerate(self.rates())}
        scene = mb.Scene(self.system, self.start(), outputs=outputs)
        run = quietly(mb.simulate, scene)
        return np.array([run[name][0] for name in outputs])

    def accelerations(self):
        """Accelerations of MuJoCo, where its equality constraints hold exactly: M a + J' l = Q, J a = -J' v."""
        m, d = self.model, self.data
        if not m.neq:
            return d.qacc.copy()
        J, bias = self.rows()
        M = np.zeros((m.nv, m.nv))
        self.mujoco.mj_fullM(m, d, M)
        free, n = d.qfrc_passive + d.qfrc_actuator - d.qfrc_bias, len(bias)
        K = np.block([[M, J.T], [J, np.zeros((n, n))]])
        return np.linalg.solve(K, np.concatenate([free, -bias]))[: m.nv]

    def rows(self):
        """Rows J (n, n_v) of the equality constraints in an assembled state, and J' v (n,)."""
        m, d, mujoco, J, bias = self.model, self.data, self.mujoco, [], []
        for k in range(m.neq):
            if m.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT:
                first, second = m.eq_obj1id[k], m.eq_obj2id[k]
                a, b = m.jnt_dofadr[first], m.jnt_dofadr[second]
                x = d.qpos[m.jnt_qposadr[second]] - m.qpos0[m.jnt_qposadr[second]]
                law = np.polynomial.Polynomial(m.eq_data[k, :5])
                row = np.zeros(m.nv)
                row[a], row[b] = 1.0, -law.deriv()(x)
                J.append(row[None])
                bias.append([-law.deriv(2)(x) * d.qvel[b] ** 2])
                continue
            parts = []
            weld = m.eq_type[k] == mujoco.mjtEq.mjEQ_WELD
            places = m.eq_data[k, 3:6], m.eq_data[k, :3]
            ends = zip((m.eq_obj1id[k], m.eq_obj2id[k]), places if weld else places[::-1], strict=True)
            for body, own in ends:
                point = d.xpos[body] + d.xmat[body].reshape(3, 3) @ own
                own_J, own_D = np.zeros((2, 6, m.nv))
                mujoco.mj_jac(m, d, own_J[:3], own_J[3:], point, body)
                mujoco.mj_jacDot(m, d, own_D[:3], own_D[3:], point, body)
                count = 6 if weld else 3
                parts.append((own_J[:count], own_D[:count] @ d.qvel))
            J.append(parts[0][0] - parts[1][0])
            bias.append(parts[0][1] - parts[1][1])
        J, bias = np.vstack(J), np.concatenate(bias)
        assert np.abs(d.efc_pos).max() < 1e-12, "the state is not assembled"
        size = np.linalg.matrix_rank(J, 1e-9)
        assert np.linalg.matrix_rank(np.vstack([J, self.J]), 1e-9) == size, "the rows are not MuJoCo's"
        return J, bias

    @property
    def is_regular(self):
        """Whether the rows are independent, well enough that digits are not lost."""
        if not self.model.neq:
            return True
        sizes = np.linalg.svd(self.J, compute_uv=False)
        return bool(np.abs(self.data.efc_pos).max() < 1e-12 and sizes[-1] > 1e-2 * sizes[0])


def draw(mujoco, seed, folder, loops=False, most=7):
    """The first random machine of a seed, of about so many bodies, that MuJoCo can assemble."""
    rng = np.random.default_rng([seed, loops])
    while True:
        path = folder / f"machine_{seed}_{loops}.xml"
        path.write_text(Drawing(rng, most).file(loops))
        twin = Twin(mujoco, path, seed)
        twin.pose(0.3 if loops else 1.0)
        if twin.is_regular:
            return twin


def difference(twin):
    """Largest difference of accelerations over the largest acceleration."""
    expected = twin.accelerations()
    return float(np.abs(twin.own_accelerations() - expected).max() / np.abs(expected).max())


PLACE = 0.1, 0.2, 0.3
"""A point of every body [m] that no usual axis meets."""


def places(d):
    """World positions (n, 3) of this point of all bodies in MuJoCo."""
    return d.xpos + d.xmat.reshape(-1, 3, 3) @ PLACE


def largest_deviation(mujoco, path, seconds=1.0, step=2e-4):
    """Largest deviation of a point of each body [m] after a second from rest, over the largest way of one.

    MuJoCo takes steps of Runge and Kutta, without what symmb leaves out. Bodies that an equality constraint connects do
    not count, as it is soft in MuJoCo.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.density = spec.option.viscosity = 0.0
    off = mujoco.mjtDisableBit
    for flag in (off.mjDSBL_CONTACT, off.mjDSBL_LIMIT, off.mjDSBL_FRICTIONLOSS, off.mjDSBL_CLAMPCTRL):
        spec.option.disableflags |= int(flag)
    spec.option.integrator, spec.option.timestep = mujoco.mjtIntegrator.mjINT_RK4, step
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_FREE):
            joint.armature = 0.0
    m = spec.compile()
    d = mujoco.MjData(m)
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        numbers = mb.load_mjcf(path).numbers
        controls = {name: 0.1 for name in numbers if name.endswith(".ctrl")}
        still = {name: 0.0 for name, value in numbers.items() if name.endswith(".friction") and value}
        robot = mb.load_mjcf(path, replace=controls | still)
        for k in range(m.nu):
            name = m.actuator(k).name or f"actuator{k}"
            d.ctrl[k] = 0.1 if {f"{name}.ctrl", f"{name}_actuator.ctrl"} & controls.keys() else 0.0
        soft = [k for k in range(m.neq) if m.eq_type[k] != mujoco.mjtEq.mjEQ_JOINT]
        held = {int(body) for k in soft for body in (m.eq_obj1id[k], m.eq_obj2id[k])}
        counted = [k for k in range(1, m.nbody) if k not in held]
        names = ["world" if k == 0 else m.body(k).name or f"body{k}" for k in range(m.nbody)]
        points = {k: robot.bodies[names[k].replace(" ", "_")].point(*PLACE) for k in counted}
        outputs = {f"{x}{k}": getattr(point, x) for k, point in points.items() for x in "xyz"}
        scene = mb.Scene(mb.System(*robot.elements), robot.start, [0.0, seconds], outputs)
        run = mb.simulate(scene, mb.DormandPrince(rtol=1e-10, atol=1e-10))
    mujoco.mj_forward(m, d)
    first = places(d)
    for _ in range(round(seconds / step)):
        mujoco.mj_step(m, d)
    mujoco.mj_forward(m, d)
    own = np.array([[[run[f"{x}{k}"][t] for x in "xyz"] for k in counted] for t in (0, 1)])
    theirs = np.array([first, places(d)])[:, counted]
    return float(np.abs(own - theirs).max() / np.linalg.norm(theirs[1] - theirs[0], axis=1).max())
