"""A wheel on a trailing arm rolls over a bump. Does it leave the road if spring and damper are uncertain?

A quarter of a car stands on an arm, which swings about a pin in front of the wheel. The tyre is a spring that cannot
pull. The force between wheel and road must stay above zero. Without this force the car can neither brake nor steer.
`python examples/suspension.py FOLDER` draws the suspension into FOLDER.

Source: textbook model, e.g. Genta and Morello, The Automotive Chassis, volume 2, chapter 26; own values.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import symmb as mb

SPEED, HEIGHT, LENGTH, RADIUS, G = 10.0, 0.03, 1.2, 0.3, 9.81
CAR, WHEEL = 350.0, 35.0

p = mb.Parameters(spring=25e3, damper=2.0e3, tyre=200e3)
ground = mb.Ground()
car = mb.Body("car", CAR, 100.0)
arm = mb.Body("arm", WHEEL, 1.5)
pin, hub = car.point(-0.5, -0.3), arm.point(0, 0)
way = SPEED * mb.t - 1.0  # position of the wheel along the road, from the foot of the bump [m]
bump = ca.if_else(ca.logic_and(way > 0, way < LENGTH), HEIGHT * ca.sin(np.pi * way / LENGTH) ** 2, 0)
road = ground.point(0, bump)
system = mb.System(
    car,
    arm,
    mb.Prismatic("guide", ground.point(0, 0), car.point(0, 0), axis=(0, 1, 0)),
    mb.Revolute("pin", pin, arm.point(-0.5, 0)),
    mb.SpringDamper("strut", car.point(0, 0.2), arm.point(0, 0), p.spring, p.damper, length=0.5 + CAR * G / 25e3),
    mb.Contact("tyre", hub, road, (0, 1), mb.KelvinVoigt(p.tyre), radius=RADIUS),
    mb.Gravity(0, -G),
    parameters=p,
)
pressure = p.tyre * ca.fmax(RADIUS + road.y - hub.y, 0)
scene = mb.Scene(
    system,
    guess={"car.y": 0.6, "arm.y": 0.28},
    times=np.linspace(0.0, 1.0, 201),
    outputs={"pressure": pressure, "car_y": car.y},
    box=mb.Box(spring=(23e3, 27e3), damper=(1.8e3, 2.2e3)),
    equilibrium=True,
    name="suspension",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())

weight = (CAR + WHEEL) * G
assert abs(run["pressure"][0] / weight - 1) < 1e-9
momentum = run(CAR * car.vy + WHEEL * arm.vy)
pushed = np.concatenate([[0.0], np.cumsum(np.diff(run.t) * (run["pressure"][1:] + run["pressure"][:-1]) / 2)])
assert np.abs(momentum - (pushed - weight * run.t)).max() < 0.01 * np.abs(momentum).max()
low, high = bounds["pressure"]
assert (low <= run["pressure"] + 1).all() and (run["pressure"] <= high + 1).all() and not bounds.warnings

if __name__ == "__main__":
    nominal, worst = run["pressure"].min() / weight, low.min() / weight
    print(f"The lowest force on the road is {nominal:.0%} of the weight, and {worst:.0%} in the worst case.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "suspension.html")
        mb.view(bounds, Path(sys.argv[1]) / "suspension.png", output="pressure", time=0.2)
        bounds.plot(Path(sys.argv[1]) / "suspension_bounds.png")
