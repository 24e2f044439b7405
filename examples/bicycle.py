"""A bicycle is pushed to the side. Does it return to the upright position if its speed is uncertain?

The Whipple bicycle has four bodies: rear frame with a stiff rider, front frame, two thin wheels that roll without slip.
The upright motion is stable from 4.3 to 6.0 m/s. The bicycle weaves at lower speeds, and falls slowly at higher speeds.
`python examples/bicycle.py FOLDER` writes pictures into FOLDER.

Source: Meijaard, Papadopoulos, Ruina, Schwab (2007), Linearized dynamics equations for the balance and steer of a
bicycle, Proc. R. Soc. A 463, table 1 and equation (5.3).
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.linalg import expm

import symmb as mb

G, TILT, PUSH = 9.81, np.pi / 10, 0.05  # [m/s^2], tilt of the steering axis [rad], lean rate at the start [rad/s]

p = mb.Parameters(speed=4.8)
ground = mb.Ground()
frame = mb.Body("frame", 85.0, ((9.2, 0, -2.4), (0, 11.0, 0), (-2.4, 0, 2.8)), pose=mb.Spatial())
fork = mb.Body("fork", 4.0, ((0.05892, 0, 0.00756), (0, 0.06, 0), (0.00756, 0, 0.00708)), pose=mb.Spatial())
places = {"frame": (0.3, 0, 0.9), "fork": (0.9, 0, 0.7), "rear": (0, 0, 0.3), "front": (1.02, 0, 0.35)}
axis = (-np.sin(TILT), 0, np.cos(TILT))
head = np.array([1.1, 0, 0]) + 0.9 * np.array(axis)  # the steering axis meets the ground 0.08 m before the wheel
steering = mb.Revolute("steering", frame.point(*head - places["frame"]), fork.point(*head - places["fork"]), axis=axis)
elements = [frame, fork, steering]
for name, carrier, mass, inertia, radius in (
    ("rear", frame, 2.0, (0.0603, 0.12, 0.0603), 0.3),
    ("front", fork, 3.0, (0.1405, 0.28, 0.1405), 0.35),
):
    wheel = mb.Body(name, mass, inertia, pose=mb.Spatial())
    hub = carrier.point(*np.subtract(places[name], places[carrier.name]))
    axle = wheel.rotation[:, 1]
    level = ca.sqrt(axle[0] ** 2 + axle[1] ** 2)
    down = -radius * ca.vertcat(-axle[0] * axle[2], -axle[1] * axle[2], level**2) / level  # from the hub to the road
    slip = ca.vertcat(wheel.vx, wheel.vy, wheel.vz) + ca.cross(wheel.rotation @ wheel.omega, down)
    elements += [
        wheel,
        mb.Revolute(f"{name}_hub", hub, wheel.point(0, 0, 0), axis=(0, 1, 0)),
        mb.Motion(f"{name}_contact", wheel.z + down[2], 0),
        mb.VelocityConstraint(f"{name}_rolling", (slip[0], slip[1])),
    ]
degrees = 180 / np.pi
scene = mb.Scene(
    mb.System(*elements, mb.Gravity(0, 0, -G), parameters=p),
    start={"frame.rotation": mb.rotation((1, 0, 0), 0.0), "frame.vx": p.speed, "frame.omega": (PUSH, 0, 0)},
    guess={f"{name}.{axis}": x for name, place in places.items() for axis, x in zip("xyz", place, strict=True)},
    times=np.linspace(0.0, 4.0, 201),
    outputs={"lean": ca.asin(frame.rotation[2, 1]) * degrees, "steer": steering.angle * degrees},
    box=mb.Box(speed=(4.5, 5.1)),
    name="bicycle",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())

M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
C1 = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])


def linear(speed: float) -> np.ndarray:
    """Lean and steer angles to the right [deg], (n_t, 2), by the linear equations and a matrix exponential."""
    rates = -np.linalg.solve(M, np.hstack([G * K0 + speed**2 * K2, speed * C1]))
    step = expm(np.vstack([np.eye(2, 4, 2), rates]) * scene.times[1])
    states = [np.array([0, 0, PUSH, 0])]
    while len(states) < len(scene.times):
        states.append(step @ states[-1])
    return degrees * np.array(states)[:, :2]


right = run.values * [1, -1]  # the axis of steering points upwards
assert np.abs(right - linear(4.8)).max() < 2e-3  # the difference is of third order in the angles
truth = np.array([linear(speed)[:, 0] for speed in np.linspace(4.5, 5.1, 61)])
low, high = bounds["lean"]
assert np.abs(low - truth.min(axis=0)).max() < 5e-3 and np.abs(high - truth.max(axis=0)).max() < 5e-3
assert not bounds.warnings

if __name__ == "__main__":
    print(f"It leans by up to {high.max():.2f} degrees, after 4 s by at most {max(-low[-1], high[-1]):.2f} degrees.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "bicycle.html")
        mb.view(run, Path(sys.argv[1]) / "bicycle.png", time=0.5)
        bounds.plot(Path(sys.argv[1]) / "bicycle_bounds.png")
