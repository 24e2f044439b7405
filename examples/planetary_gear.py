"""A motor starts a hoist through a planetary gear. How long does the start take if the torque is uncertain?

The motor turns the sun. Three planets roll between the sun and a fixed ring. The carrier turns the drum. Kloss' formula
gives the torque of the induction motor. The torque is low at standstill, highest shortly below the synchronous speed,
and zero at this speed.
`python examples/planetary_gear.py FOLDER` draws the gear into FOLDER.

Source: textbook machine; Kloss (1901) for the motor; own values.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

SUN, PLANET = 0.02, 0.04  # radii of the pitch circles [m]; the ring's radius is SUN + 2 PLANET
ARM, RATIO = SUN + PLANET, 2 * (SUN + PLANET) / SUN  # RATIO: speed of the sun, divided by the speed of the carrier
SYNCHRONOUS, SLIP = 157.0, 0.2  # speed [rad/s], slip of the largest torque
INERTIA = {"sun": 2e-4, "planet": 8e-4, "carrier": 0.02}
MASS = {"sun": 1.0, "planet": 1.0, "carrier": 2.0}


def motor(speed, pull_out):
    """Torque [N m] at a speed of the sun [rad/s]."""
    slip = 1 - speed / SYNCHRONOUS
    return 2 * pull_out * slip * SLIP / (slip**2 + SLIP**2)


p = mb.Parameters(pull_out=6.0, load=8.0, drum=0.3)  # [N m], [N m], [kg m^2]
ground = mb.Ground()
sun = mb.Body("sun", MASS["sun"], INERTIA["sun"])
carrier = mb.Body("carrier", MASS["carrier"], INERTIA["carrier"] + p.drum)
elements = [sun, carrier, mb.Revolute("input", ground.point(0, 0), sun.point(0, 0))]
elements.append(mb.Revolute("output", ground.point(0, 0), carrier.point(0, 0)))
for i, angle in enumerate(2 * np.pi * np.arange(3) / 3):
    planet = mb.Body(f"planet{i}", MASS["planet"], INERTIA["planet"])
    pin = carrier.point(ARM * np.cos(angle), ARM * np.sin(angle))
    elements += [planet, mb.Revolute(f"pin{i}", pin, planet.point(0, 0))]
    # In axes of the carrier, the teeth of both wheels have the same speed. The ring does not move.
    turn = (SUN + 2 * PLANET) / PLANET
    elements.append(mb.Motion(f"ring_mesh{i}", planet.theta - carrier.theta + turn * carrier.theta, 0))
elements.append(mb.Motion("sun_mesh", sun.theta - RATIO * carrier.theta, 0))
elements.append(mb.Torque("motor", sun, motor(sun.omega, p.pull_out)))
elements.append(mb.Torque("load", carrier, -p.load))
scene = mb.Scene(
    mb.System(*elements, parameters=p),
    start={"sun.theta": 0.0},
    guess={
        f"planet{i}.{axis}": ARM * f(2 * np.pi * i / 3)
        for i in range(3)
        for axis, f in zip("xy", (np.cos, np.sin), strict=True)
    },
    times=np.linspace(0.0, 2.0, 201),
    outputs={"motor_speed": sun.omega, "drum_speed": carrier.omega},
    box=mb.Box(pull_out=(5.4, 6.6), drum=(0.27, 0.33)),
    name="planetary gear",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def speed(pull_out: float, drum: float) -> np.ndarray:
    """The sun's speed over time. The kinetic energy gives the equivalent inertia of the machine at the sun."""
    spin = (1 - (SUN + 2 * PLANET) / PLANET) / RATIO  # speed of a planet, divided by the sun's speed
    inertia = INERTIA["sun"] + (INERTIA["carrier"] + drum + 3 * MASS["planet"] * ARM**2) / RATIO**2
    inertia += 3 * INERTIA["planet"] * spin**2
    wheel = solve_ivp(
        lambda t, w: (motor(w, pull_out) - 8.0 / RATIO) / inertia,
        (0, 2),
        [0.0],
        t_eval=scene.times,
        rtol=1e-10,
        atol=1e-10,
    )
    return wheel.y[0]


assert np.abs(run["motor_speed"] - speed(6.0, 0.3)).max() < 1e-5
low, high = bounds["motor_speed"]
slowest, fastest = speed(5.4, 0.33), speed(6.6, 0.27)
assert np.abs(low - slowest).max() < 0.5 and np.abs(high - fastest).max() < 0.5
assert not bounds.warnings

if __name__ == "__main__":
    early, late = (scene.times[np.argmax(s > 0.9 * SYNCHRONOUS)] for s in (high, low))
    print(f"The motor reaches nine tenths of its synchronous speed after {early:.2f} to {late:.2f} s.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "planetary_gear.html")
        mb.view(run, Path(sys.argv[1]) / "planetary_gear.png", time=0.05)
        bounds.plot(Path(sys.argv[1]) / "planetary_gear_bounds.png")
