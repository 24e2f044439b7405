"""A clutch starts a press from its flywheel, and a brake stops it. How far does the flywheel slow down, and why?

A plate clutch couples the flywheel to the crank. The clutch slips until both have the same speed, and then sticks. The
ram forms a part near its lowest point. Then the clutch opens, and the brake stops the crank near the top. The friction
of the clutch, its air pressure, and the force of the part are known to some percent.
`python examples/press_clutch.py FOLDER` draws the press, its speeds, and the contributions of tolerances into FOLDER.

Source: textbook machine, e.g. Budynas and Nisbett, Shigley's Mechanical Engineering Design, chapter 16; own values.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import symmb as mb

RADIUS, ROD, DRAW, G = 0.06, 0.35, 0.015, 9.81  # crank, rod, height of the part [m]
WHEEL, CRANK, SPEED = 30.0, 0.8, 2 * np.pi * 4.0  # moments of inertia [kg m^2], speed [rad/s]
AREA, MEAN_RADIUS, FACES = 0.02, 0.16, 4  # plates of the clutch [m^2], [m]
START, FILL, RELEASE = 0.05, 0.02, np.radians(330.0)  # clutch closes at START, fills in FILL [s], opens at RELEASE

p = mb.Parameters(friction=0.30, pressure=5.5e5, part=60e3)  # -, Pa, N
ground = mb.Ground()
wheel, crank = mb.Body("flywheel", 600.0, WHEEL), mb.Body("crank", 40.0, CRANK)
rod, ram = mb.Body("rod", 30.0, 30.0 * ROD**2 / 12), mb.Body("ram", 150.0, 1.0)
shaft = mb.Revolute("shaft", ground.point(0, 0), crank.point(0, 0))  # its angle is 0 at the top
is_on = ca.logic_and(mb.t > START, shaft.angle < RELEASE)
torque = p.friction * p.pressure * AREA * MEAN_RADIUS * FACES * ca.fmin((mb.t - START) / FILL, 1)
clutch = mb.Clutch("clutch", wheel, crank, ca.if_else(is_on, torque, 0), static_ratio=1.1)
brake = mb.Clutch("brake", ground, crank, ca.if_else(is_on, 0, 800.0))
way = ca.fmax(DRAW - RADIUS - ROD - ram.y, 0)  # depth of the ram in the part
system = mb.System(
    wheel,
    crank,
    rod,
    ram,
    mb.Revolute("bearing", ground.point(0, 0), wheel.point(0, 0)),
    shaft,
    mb.Revolute("crank_pin", crank.point(0, RADIUS), rod.point(0, ROD / 2)),
    mb.Revolute("wrist_pin", rod.point(0, -ROD / 2), ram.point(0, 0)),
    mb.Prismatic("guide", ground.point(0, 0), ram.point(0, 0), axis=(0, 1, 0)),
    clutch,
    brake,
    mb.Force("forming", ram.point(0, 0), (0, ca.if_else(ram.vy < 0, p.part * ca.tanh(way / 1e-3), 0))),
    mb.Gravity(0, -G),
    parameters=p,
)
scene = mb.Scene(
    system,
    start={"shaft.angle": 0.0, "flywheel.omega": SPEED},
    guess={"rod.y": RADIUS - ROD / 2, "ram.y": RADIUS - ROD},
    times=np.linspace(0.0, 0.4, 81),
    outputs={
        "flywheel": wheel.omega,
        "lock": mb.first_time(clutch.closed > 0.5),
        "slowest": mb.minimum(wheel.omega),
        "stop": mb.final(360 - 180 / np.pi * shaft.angle),
    },
    box=mb.Box(friction=(0.27, 0.33), pressure=(5.2e5, 5.8e5), part=(54e3, 66e3)),
    name="press",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())
shares = bounds.contributions()

# While the clutch slips, its torque rises with time and accelerates the crank. The ram hardly moves.
slope = 0.3 * 5.5e5 * AREA * MEAN_RADIUS * FACES / FILL
slipping = np.sqrt(2 * SPEED / slope / (1 / WHEEL + 1 / CRANK))
assert abs((run["lock"] - START) / slipping - 1) < 0.05
begins, locks, opens, stops = run.events
assert [(event.name, event.what) for event in (begins, locks)] == [("brake", "opens"), ("clutch", "closes")]
assert [(event.name, event.what) for event in (opens, stops)] == [("clutch", "opens"), ("brake", "closes")]
low, high = bounds["slowest"]
k = shares.names.index("slowest")
assert low < run["slowest"] < high
assert shares.parameters[int(shares.alone[0, k].argmax())] == "part"

if __name__ == "__main__":
    early, late = (1e3 * (time - START) for time in bounds["lock"])
    print(f"The clutch begins to stick {early:.1f} to {late:.1f} ms after it begins to slip.")
    print(f"The flywheel slows down by {100 * (1 - high / SPEED):.1f} to {100 * (1 - low / SPEED):.1f} %.")
    print(f"The crank stops {bounds['stop'][0]:.0f} to {bounds['stop'][1]:.0f} degrees before the top.")
    print(shares)
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        mb.view(run, folder / "press_clutch.html")
        mb.view(run, folder / "press_clutch.png", time=0.18)
        bounds.plot(folder / "press_clutch_bounds.png", outputs="flywheel")
        shares.plot(folder / "press_clutch_shares.png", outputs="flywheel")
