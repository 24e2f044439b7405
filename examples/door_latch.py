"""A car door closes into its latch. Which speed does it need, and how large is the impact force at higher speeds?

The seal is a spring over the last 3.5 degrees, and takes most of the energy. The latch then closes about the striker.
This is a plastic impact: door and striker move on together, against the elastic body of the car. As a check, SciPy
integrates an equation for the door's angle before and after the impact. The impact follows from the momentum.
`python examples/door_latch.py FOLDER` draws the door from above into FOLDER.

Source: textbook impact; own values.
"""

import re
import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

import symmb as mb

WIDTH, MASS, INERTIA, BEGIN = 1.1, 25.0, 3.0, 0.5  # WIDTH: from hinge to latch [m]; INERTIA: about the middle
AT_HINGE = INERTIA + MASS * (WIDTH / 2) ** 2
STRIKER, BODY, LOSS = 3.0, 1.5e6, 400.0  # mass [kg] of the striker, stiffness [N/m] and damping [N s/m] of the car
DAMPING, END = 40.0, 0.6  # damping of the seal [N m s/rad], and last time of the run [s]

p = mb.Parameters(speed=1.5, seal=2000.0, thickness=0.06, friction=3.0)
ground = mb.Ground()
door = mb.Body("door", MASS, INERTIA, com=(WIDTH / 2, 0))
striker = mb.Body("striker", STRIKER, 1e-3)
hinge = mb.Revolute("hinge", ground.point(0, 0), door.point(0, 0))
lock = door.point(WIDTH, 0)
bolt = mb.PointOnLine("bolt", striker.point(0, 0), lock, axis=(1, 0, 0))
caught = lock.y < striker.y
system = mb.System(
    door,
    striker,
    hinge,
    mb.Prismatic("pillar", ground.point(WIDTH, 0), striker.point(0, 0), axis=(0, 1, 0)),
    mb.Bushing("car", ground.point(WIDTH, 0), striker.point(0, 0), (0, BODY, 0), (0, LOSS, 0)),
    mb.Stop("seal", hinge, p.thickness, None, mb.KelvinVoigt(p.seal, DAMPING)),
    mb.Actuator("friction", hinge, -p.friction * ca.tanh(hinge.angle_rate / 0.01)),
    bolt,
    mb.Latch(bolt, caught),
    parameters=p,
)
pull = system.lam("bolt")[0]
scene = mb.Scene(
    system,
    start={"hinge.angle": BEGIN, "hinge.angle_rate": -p.speed / WIDTH},
    times=np.linspace(0.0, END, 601),
    outputs={"speed": mb.value_at(-lock.vy, caught), "blow": mb.maximum(pull)},
    box=mb.Box(speed=(1.4, 1.6), seal=(1850.0, 2150.0), thickness=(0.058, 0.062), friction=(2.5, 3.5)),
    name="door latch",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())
with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # a remark says that slow doors do not reach the latch
    slow = mb.propagate(scene, mb.MonteCarlo(100), mb.Box(speed=(1.0, 1.6)))


def torque(angle: float, rate: float, seal: float, thickness: float, friction: float) -> float:
    """Torque of the seal and of the friction [N m]."""
    depth = thickness - angle
    pushed = max(seal * depth - DAMPING * rate, 0.0) if depth > 0 else 0.0
    return pushed - friction * np.tanh(rate / 0.01)


def arrival(speed: float, *door: float) -> float:
    """Speed at the latch [m/s]. `door` are seal, thickness and friction."""

    def swings(t: float, z: np.ndarray) -> list[float]:
        return [z[1], torque(*z, *door) / AT_HINGE]

    def arrived(t: float, z: np.ndarray) -> float:
        return z[0]

    arrived.terminal = True
    swing = solve_ivp(swings, (0, END), [BEGIN, -speed / WIDTH], events=arrived, rtol=1e-9, atol=1e-11, max_step=0.01)
    return -WIDTH * swing.y[1, -1]


def closed(speed: float, *door: float) -> tuple[float, float, float]:
    """Speed at the latch [m/s], work of the impact [J], and the largest force on the striker after the impact [N]."""

    def force(angle: float, rate: float) -> tuple[float, float]:
        """Angular acceleration of the door that moves with the striker, and the force on the striker."""
        arm, held = WIDTH * np.cos(angle), BODY * WIDTH * np.sin(angle) + LOSS * WIDTH * np.cos(angle) * rate
        turning = STRIKER * WIDTH * np.sin(angle) * rate**2
        gain = (torque(angle, rate, *door) + arm * (turning - held)) / (AT_HINGE + STRIKER * arm**2)
        return gain, STRIKER * arm * gain - turning + held

    left = arrival(speed, *door)
    reduced = 1 / (WIDTH**2 / AT_HINGE + 1 / STRIKER)  # reduced mass of the impact
    rate = -left / WIDTH * AT_HINGE / (AT_HINGE + STRIKER * WIDTH**2)
    after = solve_ivp(
        lambda t, z: [z[1], force(*z)[0]], (0, 0.1), [0.0, rate], rtol=1e-9, atol=1e-11, dense_output=True
    )
    return left, -reduced * left**2 / 2, max(force(*after.sol(t))[1] for t in np.linspace(0, 0.1, 2001))


left, work, blow = closed(1.5, 2000.0, 0.06, 3.0)
assert abs(run["speed"] / left - 1) < 1e-6 and abs(run.events[0].work / work - 1) < 1e-5
assert abs(run["blow"] / blow - 1) < 1e-4
worst = closed(1.4, 2150.0, 0.062, 3.5), closed(1.6, 1850.0, 0.058, 2.5)
assert np.allclose(bounds["speed"], [row[0] for row in worst], rtol=2e-3)
assert np.allclose(bounds["blow"], [row[2] for row in worst], rtol=2e-3)
assert not bounds.warnings
# Slower doors swing back before they reach the latch.
needed = root_scalar(lambda speed: arrival(speed, 2000.0, 0.06, 3.0), bracket=(1.15, 1.5)).root
(stated,) = re.findall(r"speed < ([\d.]+)", slow.remarks[0])
assert abs(float(stated) - needed) < 0.02

if __name__ == "__main__":
    print(f"The door needs {needed:.2f} m/s. For 100 doors at 1 to 1.6 m/s:", slow.remarks[0], sep="\n", end="\n\n")
    print(bounds.check({"speed": (0.1, None), "blow": (None, 2000.0)}), "\n")
    print(bounds.contributions())
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        fall = mb.simulate(scene.with_outputs({"angle": hinge.angle, "force on the striker": pull}))
        mb.view(fall, folder / "door_latch.html")
        mb.view(fall, folder / "door_latch.png", time=0.25)
        fall.plot(folder / "door_latch_blow.png")
