"""Units of outputs: worked out where they follow, blank elsewhere."""

import casadi as ca
import pytest

import symmb as mb
from symmb.equations.model import units_of

P = mb.Parameters(x=2.0, k=3.0)
GROUND = mb.Ground()
ROD = mb.Body("rod", mass=2.0, inertia=0.1, pose=mb.Planar())
BALL = mb.Body("ball", mass=1.0, pose=mb.Particle())
TOP = mb.Body("top", mass=1.0, inertia=(0.1, 0.1, 0.2), pose=mb.Spatial())
HINGE = mb.Revolute("hinge", GROUND.point(0, 0), ROD.point(-0.3, 0))
BAR = mb.Distance("bar", GROUND.point(1, 0), BALL.point(0, 0), 0.7)
SPIN = mb.Motion("spin", ROD.theta, 0.2 * mb.t)
PIN = mb.Revolute("pin", GROUND.point(0, 0, 0), TOP.point(0, 0, -0.1), axis=(0, 0, 1))
SYSTEM = mb.System(ROD, BALL, TOP, HINGE, BAR, SPIN, PIN, parameters=P)
LAM = SYSTEM.lam

REACTION = SYSTEM.reaction("hinge").fx
UNITS = {
    "rad": (ROD.theta, ROD.theta - P.k, ca.atan2(BALL.y, BALL.x), HINGE.angle, PIN.angle),
    "rad/s": (-ROD.omega,),
    "rad/s^2": (SYSTEM.ddt(ROD.omega),),
    "m": (ROD.point(0.3, 0).x, ca.sqrt(BALL.x**2 + BALL.y**2), ca.fmax(BALL.x, 0.1), ca.if_else(BALL.x > 0, BALL.x, 0)),
    "m^3": (BALL.x * BALL.y * BALL.z,),
    "m/s": (ROD.point(0.3, 0).vy, ROD.omega * BALL.x),
    "m/s^2": (BALL.vx / mb.t,),
    "m^2/s^2": (BALL.vx**2,),
    "N": (LAM("hinge")[0], REACTION),
    "N m": (LAM("spin")[0],),
    "W": (LAM("spin")[0] * ROD.omega,),
    "s": (mb.t,),
}
KNOWN = [(expression, unit) for unit, expressions in UNITS.items() for expression in expressions]
UNKNOWN = [1000 * BALL.x, 2 * BALL.x, BALL.x / BALL.y, BALL.x > 0, BALL.x + BALL.vx, BALL.x**3.7, 0.5 * BALL.vx**2]
UNKNOWN += [P.x, P.k * BALL.x, 1 / mb.t * P.k, ca.SX(3.0), ca.sin(ROD.theta), ROD.theta * 180 / ca.pi]
UNKNOWN += [REACTION * ca.cos(ROD.theta), ROD.omega * ca.cos(ROD.theta)]


@pytest.mark.parametrize("expression, unit", [*KNOWN, *((e, "") for e in UNKNOWN)], ids=lambda value: str(value)[:30])
def test_units_that_follow_and_blank_where_nothing_is_known(expression, unit):
    assert units_of(SYSTEM, ca.SX(expression)) == (unit,)


def test_all_outputs_of_a_scene_together():
    outputs = {str(i): expression for i, (expression, _) in enumerate(KNOWN)}
    scene = mb.Scene(SYSTEM, outputs=outputs, start={"ball.x": 0.3, "ball.y": 0.0, "ball.z": 0.1})
    assert units_of(scene.system, scene.y) == tuple(unit for _, unit in KNOWN)
