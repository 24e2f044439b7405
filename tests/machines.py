"""Small machines that many tests share. All numbers are parameters, so tests with other numbers share one model.

    machine = pendulum(lambda m: mb.Torque("drive", m.rod, 2.0), length=0.5)
    run = mb.simulate(machine.scene("theta omega", start={"rod.theta": 0.1}))

Further elements are functions of the machine, or elements. `g=None` leaves out gravity.
"""

from types import SimpleNamespace

import numpy as np

import symmb as mb

GROUND = mb.Ground()
ORIGIN = GROUND.point(0, 0)
INTERVAL = (0.0, 1.0)
PLANAR = mb.Planar()
LINKS = ("crank", "coupler", "rocker")


class Machine(SimpleNamespace):
    """The parameters `p`, the first body `body`, its point `at` and other elements by their names, and the `system`."""

    def scene(self, outputs=None, times=INTERVAL, start=None, **options):
        """A scene. Outputs may be names of coordinates of the body, such as "x vx", or a function of the machine."""
        if isinstance(outputs, str):
            outputs = {name: getattr(self.body, name) for name in outputs.split()}
        outputs = outputs(self) if callable(outputs) else outputs
        return mb.Scene(self.system, start or {}, np.asarray(times), outputs, **options)

    def run(self, *args, solver=None, **options):
        """The run of a scene that is declared by the other arguments."""
        return mb.simulate(self.scene(*args, **options), solver)

    def around(self, percent, *args, **options):
        """A scene whose parameters are all uncertain."""
        return self.scene(*args, box=mb.Box.around(self.p, percent), **options)


def run_of(*elements, start=None, times=(0.0,), outputs=None, parameters=None, solver=None, **options):
    """The run of a scene of these elements."""
    scene = mb.Scene(mb.System(*elements, parameters=parameters), start or {}, times, outputs, **options)
    return mb.simulate(scene, solver)


def _machine(p, body, more, *elements, g=None, **named):
    """A machine of one body, of which gravity along -y is a part if its number is given."""
    machine = Machine(p=p, body=body, **{body.name: body}, **{e.name: e for e in elements}, **named)
    further = []
    for each in more:  # functions may name elements of those before them
        made = each(machine) if callable(each) else each
        made = made if isinstance(made, tuple) else (made,)
        vars(machine).update({e.name: e for e in made if not hasattr(machine, getattr(e, "name", "p"))})
        further += made
    pull = () if g is None else (mb.Gravity(0, -p.g),)
    machine.system = mb.System(body, *elements, *further, *pull, parameters=p)
    return machine


def _given(**numbers):
    """Parameters of the numbers that are given."""
    return mb.Parameters(**{name: value for name, value in numbers.items() if value is not None})


def ball(*more, mass=1.0, g=9.81, **numbers):
    """A particle `ball` that falls along y."""
    p = _given(mass=mass, g=g, **numbers)
    body = mb.Body("ball", p.mass, pose=mb.Particle())
    return _machine(p, body, more, g=g, at=body.point(0, 0))


def bouncing_ball(*more, restitution=0.5, **numbers):
    """A ball above a floor at y = 0 with an impact `floor`."""
    floor = lambda m: mb.Impact("floor", m.ball.y, restitution=m.p.restitution)  # noqa: E731
    return ball(floor, *more, restitution=restitution, **numbers)


def spring_mass(*more, stiffness=4.0, damping=0.0, mass=1.0, **numbers):
    """A particle `ball` on a linear force -k x - c v along x."""
    law = lambda m: mb.Force("spring", m.at, (-m.p.stiffness * m.ball.x - m.p.damping * m.ball.vx, 0))  # noqa: E731
    return ball(law, *more, mass=mass, g=None, stiffness=stiffness, damping=damping, **numbers)


def pendulum(*more, length=1.0, mass=1.0, inertia=0.1, g=9.81, pose=PLANAR, axis=(0, 0, 1), **numbers):
    """A body `rod` on a revolute joint `hinge` at the origin. At an angle of 0 its centre is at (length, 0)."""
    p = _given(length=length, mass=mass, inertia=inertia, g=g, **numbers)
    body = mb.Body("rod", p.mass, (p.inertia,) * 3 if isinstance(pose, mb.Spatial) else p.inertia, pose)
    hinge = mb.Revolute("hinge", ORIGIN, body.point(-p.length, 0), axis=axis)
    return _machine(p, body, more, hinge, g=g, at=body.point(0, 0))


def wheel(*more, inertia=1.0, mass=1.0, **numbers):
    """A planar body `wheel` on a revolute joint `shaft` through its centre."""
    p = _given(inertia=inertia, mass=mass, **numbers)
    body = mb.Body("wheel", p.mass, p.inertia, mb.Planar())
    return _machine(p, body, more, mb.Revolute("shaft", ORIGIN, body.point(0, 0)), at=body.point(0, 0))


def cart(*more, mass=1.0, **numbers):
    """A planar body `cart` on a prismatic joint `rail` along x."""
    p = _given(mass=mass, **numbers)
    body = mb.Body("cart", p.mass, 1.0, mb.Planar())
    return _machine(p, body, more, mb.Prismatic("rail", ORIGIN, body.point(0, 0), axis=(1, 0, 0)), at=body.point(0, 0))


def bob(*more, length=1.0, mass=1.0, g=9.81, **numbers):
    """A particle `bob` at a constant distance from the origin, by a joint `rod`."""
    p = _given(length=length, mass=mass, g=g, **numbers)
    body = mb.Body("bob", p.mass, pose=mb.Particle())
    return _machine(p, body, more, mb.Distance("rod", ORIGIN, body.point(0, 0), p.length), g=g, at=body.point(0, 0))


def free_body(*more, mass=1.0, inertia=(0.2, 0.3, 0.4), **numbers):
    """A spatial body `top` that nothing holds."""
    p = _given(mass=mass, a=inertia[0], b=inertia[1], c=inertia[2], **numbers)
    body = mb.Body("top", p.mass, (p.a, p.b, p.c), mb.Spatial())
    return _machine(p, body, more, at=body.point(0, 0, 0))


def rods(n, *more, length=1.0, mass=1.0, g=9.81, pose=PLANAR, **numbers):
    """Uniform rods `rod0`, `rod1`, ... on revolute joints `hinge0`, ... that hang below each other at angles of 0."""
    p = _given(length=length, mass=mass, g=g, **numbers)
    inertia = p.mass * p.length**2 / 12
    inertia = (inertia,) * 3 if isinstance(pose, mb.Spatial) else inertia
    bodies = [mb.Body(f"rod{k}", p.mass, inertia, pose) for k in range(n)]
    tops = [ORIGIN, *(rod.point(0, -p.length / 2) for rod in bodies)]
    hinges = [mb.Revolute(f"hinge{k}", tops[k], rod.point(0, p.length / 2)) for k, rod in enumerate(bodies)]
    return _machine(p, bodies[0], more, *bodies[1:], *hinges, g=g, bodies=bodies, hinges=hinges)


def linkage(
    *more, lengths=(1.0, 2.0, 1.5, 2.0), mass=1.0, inertia=0.1, g=None, pose=PLANAR, closing=mb.Revolute, **numbers
):
    """A `crank`, a `coupler` and a `rocker` on revolute joints `A`, `B` and `D`; the joint `C` closes the loop.

    Lengths are those of the crank a, the coupler b, the rocker c and the ground d. Joints are at the ends of bodies.
    """
    p = _given(**dict(zip("abcd", lengths, strict=True)), mass=mass, inertia=inertia, g=g, **numbers)
    inertia = (p.inertia,) * 3 if isinstance(pose, mb.Spatial) else p.inertia
    crank, coupler, rocker = bodies = [mb.Body(name, p.mass, inertia, pose) for name in LINKS]
    joints = [
        mb.Revolute("A", ORIGIN, crank.point(-p.a / 2, 0)),
        mb.Revolute("B", crank.point(p.a / 2, 0), coupler.point(-p.b / 2, 0)),
        mb.Revolute("D", GROUND.point(p.d, 0), rocker.point(-p.c / 2, 0)),
        closing("C", coupler.point(p.b / 2, 0), rocker.point(p.c / 2, 0)),
    ]
    return _machine(p, bodies[0], more, *bodies[1:], *joints, g=g, bodies=bodies, joints=joints)


def gears(*more, ratio=-0.5, inertias=(1.0, 1.0), pose=PLANAR, axis=(0, 0, 1), **numbers):
    """Bodies `a` and `b` on revolute joints `A` and `B` through their centres, and a `gear` between them."""
    p = _given(ratio=ratio, a=inertias[0], b=inertias[1], **numbers)
    inertias = [(J,) * 3 if isinstance(pose, mb.Spatial) else J for J in (p.a, p.b)]
    a, b = bodies = [mb.Body(name, 1.0, J, pose) for name, J in zip("ab", inertias, strict=True)]
    joints = [mb.Revolute(n, GROUND.point(k, 0), bodies[k].point(0, 0), axis=axis) for k, n in enumerate("AB")]
    gear = mb.Gear("gear", a.point(0, 0), b.point(0, 0), axis=axis, ratio=p.ratio)
    return _machine(p, a, more, b, *joints, gear)
