"""Small open scenes that can be enclosed, by name."""

import casadi as ca
import numpy as np

import models.double_pendulum
import symmb as mb


def pendulum(spread=0.02, end=1.0):
    """A rod released from the horizontal."""
    p = mb.Parameters(l=1.0)
    rod = mb.Body("rod", mass=p.l, inertia=p.l**3 / 12, pose=mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(-p.l / 2, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81))
    outputs = {"x": rod.x, "theta": rod.theta, "omega": rod.omega, "pull": system.reaction("hinge").fy}
    return _scene("pendulum", system, {"rod.theta": 0.0}, outputs, end, spread)


def van_der_pol(spread=0.05, end=4.0):
    """x'' = mu (1 - x^2) x' - x as a mass on a line."""
    p = mb.Parameters(mu=1.0)
    law = lambda mass: p.mu * (1 - mass.x**2) * mass.vx - mass.x  # noqa: E731
    return _on_a_line("van der Pol", p, law, 1.5, end, spread)


def duffing(spread=0.05, end=4.0):
    """A driven oscillator with a cubic spring."""
    p = mb.Parameters(a=1.0, d=0.1)
    law = lambda mass: -mass.x - p.a * mass.x**3 - p.d * mass.vx + 0.3 * ca.cos(1.2 * mb.t)  # noqa: E731
    return _on_a_line("Duffing", p, law, 1.0 + 0.1 * p.a, end, spread)


def spherical_pendulum(spread=0.02, end=0.5):
    """A heavy ball on an arm that turns about z, and about its own y."""
    p = mb.Parameters(length=1.0, turn=2.0)
    arm = mb.Body("arm", mass=0.1, inertia=(1e-2, 1e-2, 1e-2), pose=mb.Spatial())
    ball = mb.Body("ball", mass=1.0, inertia=(1e-3, 1e-3, 1e-3), pose=mb.Spatial())
    post = mb.Revolute("post", mb.Ground().point(0, 0, 0), arm.point(0, 0, 0), axis=(0, 0, 1))
    hinge = mb.Revolute("hinge", arm.point(0, 0, 0), ball.point(0, 0, p.length), axis=(0, 1, 0))
    system = mb.System(arm, ball, post, hinge, mb.Gravity(0, 0, -9.81))
    start = {"hinge.angle": 1.0, "post.angle": 0.0, "post.angle_rate": p.turn, "hinge.angle_rate": 0.0}
    outputs = {"x": ball.x, "y": ball.y, "z": ball.z}
    return _scene("spherical pendulum", system, start, outputs, end, spread)


def chain_of_four(spread=0.05, end=1.0):
    """Four masses in a row on four uncertain springs."""
    p = mb.Parameters(k1=10.0, k2=10.0, k3=10.0, k4=10.0)
    masses = [mb.Body(f"m{i}", mass=1.0, pose=mb.Particle()) for i in range(1, 5)]
    stretches = [b.x - a for a, b in zip([0.0, *(m.x for m in masses)], masses, strict=False)]
    pulls = [k * s for k, s in zip((p.k1, p.k2, p.k3, p.k4), stretches, strict=True)]
    loads = enumerate(zip(masses, pulls, [*pulls[1:], 0.0], strict=True))
    forces = [mb.Force(f"force{i}", mass.point(0, 0), (after - before, 0)) for i, (mass, before, after) in loads]
    outputs = {m.name: m.x for m in masses}
    return _scene("chain of four", mb.System(*masses, *forces), {"m4.x": 1.0}, outputs, end, spread)


def lagging_motor(spread=0.05, end=1.0):
    """A wheel whose motor follows with a lag: a first-order state."""
    p = mb.Parameters(lag=0.2, drag=0.5)
    wheel = mb.Body("wheel", mass=1.0, inertia=0.5, pose=mb.Planar())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), wheel.point(0, 0))
    torque = mb.State("torque", rate=lambda z: (ca.sin(3 * mb.t) - z) / p.lag)
    motor = mb.Actuator("motor", hinge, torque.value - p.drag * ca.tanh(hinge.angle_rate))
    outputs = {"angle": hinge.angle, "torque": torque.value}
    return _scene("lagging motor", mb.System(wheel, hinge, torque, motor), {"torque": 0.1}, outputs, end, spread)


def double_pendulum(spread=0.02, end=0.6):
    """The double pendulum of the shipped models."""
    scene = models.double_pendulum.scene()
    outputs = {name: scene.outputs[name] for name in ("x1", "theta2", "y2_dot", "theta1_dot")}
    return _scene("double pendulum", scene.system, scene.start, outputs, end, spread)


def sprung_ball(spread=0.05, end=0.6):
    """A ball that hangs on a spring and a damper and swings, so that both act along a line that turns."""
    p = mb.Parameters(stiffness=60.0, damping=0.8, mass=1.0)
    ball = mb.Body("ball", mass=p.mass, pose=mb.Particle())
    link = mb.SpringDamper("link", mb.Ground().point(0, 0), ball.point(0, 0), p.stiffness, p.damping, length=1.0)
    system = mb.System(ball, link, mb.Gravity(0, -9.81))
    outputs = {"x": ball.x, "y": ball.y, "speed": ball.vx**2 + ball.vy**2}
    return _scene("sprung ball", system, {"ball.x": 0.8, "ball.y": -0.9}, outputs, end, spread)


def driven_cart(spread=0.03, end=0.8):
    """A cart that is pushed to and fro, with a pendulum on a torsion spring."""
    p = mb.Parameters(push=6.0, beat=5.0, mass=0.4)
    cart = mb.Body("cart", mass=1.0, inertia=0.1, pose=mb.Planar())
    rod = mb.Body("rod", mass=p.mass, inertia=0.02, pose=mb.Planar())
    rail = mb.Prismatic("rail", mb.Ground().point(0, 0), cart.point(0, 0), axis=(1, 0, 0))
    hinge = mb.Revolute("hinge", cart.point(0, 0), rod.point(0, 0.5))
    coil = mb.TorsionSpring("coil", cart, rod, stiffness=2.0, damping=0.1)
    push = mb.Force("push", cart.point(0, 0), (p.push * ca.sin(p.beat * mb.t), 0))
    system = mb.System(cart, rod, rail, hinge, coil, push, mb.Gravity(0, -9.81))
    outputs = {"place": cart.x, "angle": rod.theta, "rate": rod.omega, "tip": rod.point(0, -0.5).x}
    return _scene("driven cart", system, {"rod.theta": 0.4}, outputs, end, spread)


def two_tanks(spread=0.05, end=2.0):
    """A tank runs out into another one (Torricelli): two first-order states and no bodies."""
    p = mb.Parameters(inflow=0.8, upper=1.0, lower=0.7)
    first = mb.State("first", rate=lambda z: p.inflow * (1 + 0.3 * ca.sin(2 * mb.t)) - p.upper * ca.sqrt(z))
    second = mb.State("second", rate=lambda z: p.upper * ca.sqrt(first.value) - p.lower * ca.sqrt(z))
    outputs = {"first": first.value, "second": second.value}
    return _scene("two tanks", mb.System(first, second), {"first": 1.5, "second": p.lower}, outputs, end, spread)


def _scene(name, system, start, outputs, end, spread):
    box = mb.Box.around(system.parameters, spread)
    return mb.Scene(system, start=start, times=np.linspace(0.0, end, 21), outputs=outputs, box=box, name=name)


def _on_a_line(name, p, law, start, end, spread):
    """A mass of 1 kg that starts at a place."""
    mass = mb.Body("mass", mass=1.0, pose=mb.Particle())
    system = mb.System(mass, mb.Force("force", mass.point(0, 0), (law(mass), 0)), parameters=p)
    return _scene(name, system, {"mass.x": start}, {"x": mass.x, "v": mass.vx}, end, spread)


SCENES = (pendulum, van_der_pol, duffing, spherical_pendulum, chain_of_four, lagging_motor)
TEN = (*SCENES, double_pendulum, sprung_ball, driven_cart, two_tanks)
