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


class Machine(SimpleNamespace):
    """The parameters `p`, the first body `body`, its point `at` and other elements by their names, and the `system`."""

    def scene(self, outputs=None, times=INTERVAL, start=None, **options):
        """A scene. Outputs may be names of coordinates of the first body, such as "x vx"."""
        if isinstance(outputs, str):
            outputs = {name: getattr(self.body, name) for name in outputs.split()}
        return mb.Scene(self.system, start or {}, np.asarray(times), outputs, **options)

    def run(self, *args, solver=None, **options):
        """The run of a scene that is declared by the other arguments."""
        return mb.simulate(self.scene(*args, **options), solver)

    def around(self, percent, *args, **options):
        """A scene whose parameters are all uncertain."""
        return self.scene(*args, box=mb.Box.around(self.p, percent), **options)


def _machine(p, body, more, *elements, g=None, **named):
    """A machine of one body, of which gravity along -y is a part if its number is given."""
    machine = Machine(p=p, body=body, **{body.name: body}, **{e.name: e for e in elements}, **named)
    further = [element(machine) if callable(element) else element for element in more]
    further = [e for each in further for e in (each if isinstance(each, tuple) else (each,))]
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
