"""A Geneva drive turns a table by a quarter of a turn and locks it. How hard does its pin hit the slot?

Without play and elasticity, a formula gives the motion of the wheel. The peak of its acceleration is 5.41 times the
square of the crank's speed. A real pin has play in its slot. When the wheel slows down, the pin moves from one flank to
the other and rebounds. While the pin is outside of the slot, the disc of the crank locks the wheel at its arcs. As a
check, SciPy integrates one equation of motion for the angle of the wheel, with the same contact laws.
`python examples/geneva_drive.py FOLDER` draws the drive into FOLDER.

Source: textbook mechanism, e.g. Norton, Design of Machinery; own values.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import symmb as mb

CRANK, PIN, DISC, QUARTER = 0.05, 0.006, 0.03, np.pi / 4
APART = CRANK / np.sin(QUARTER)  # so that the pin enters the slot along it
ARC, BEGIN = APART * np.sqrt(0.5), np.radians(-60.0)
INNER, REACH = APART - CRANK - 0.003, 0.04  # distance of the slot from the wheel's axis, and its length [m]
END, STIFFNESS, DAMPING, FRICTION = 1 / 6, 5e7, 1e4, 2.0  # [s], contacts [N/m, N s/m], bearing [N m]

p = mb.Parameters(rpm=120.0, inertia=0.05, play=5e-5)
speed = 2 * np.pi / 60 * p.rpm
angle = BEGIN + speed * mb.t
before, drives, behind = (
    mb.KelvinVoigt(STIFFNESS * share, DAMPING * share)
    for share in (angle < -QUARTER, ca.fabs(angle) < QUARTER, angle > QUARTER)
)
ground = mb.Ground()
crank = mb.Body("crank", 1.0, 1e-3)
wheel = mb.Body("wheel", 5.0, p.inertia)
shaft = mb.Revolute("shaft", ground.point(0, 0), crank.point(0, 0))
table = mb.Revolute("table", ground.point(APART, 0), wheel.point(0, 0))
system = mb.System(
    crank,
    wheel,
    shaft,
    table,
    mb.Motion("motor", shaft.angle, angle),
    mb.SlotContact(
        "slot", wheel.point(-INNER, 0), crank.point(CRANK, 0), (-1, 0), REACH, PIN + p.play / 2, PIN, drives
    ),
    mb.CircleContact("lock", wheel.point(-ARC, ARC), crank.point(0, 0), DISC + p.play, DISC, before, inside=True),
    mb.CircleContact(
        "lock_behind", wheel.point(-ARC, -ARC), crank.point(0, 0), DISC + p.play, DISC, behind, inside=True
    ),
    mb.Actuator("friction", table, -FRICTION * ca.tanh(table.angle_rate / 0.01)),
    parameters=p,
)
force, wheel_rate = system.force("slot"), system.ddt(wheel.omega)
scene = mb.Scene(
    system,
    start={"table.angle": QUARTER, "table.angle_rate": 0.0},
    times=np.linspace(0, END, 501),
    outputs={"force": mb.maximum(force), "speeds up": mb.maximum(-wheel_rate), "slows down": mb.maximum(wheel_rate)},
    box=mb.Box(rpm=(118.0, 122.0), inertia=(0.045, 0.055), play=(2e-5, 8e-5)),
    name="Geneva drive",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def largest_force(rpm: float, inertia: float, play: float) -> float:
    """Largest force of the pin [N], by an equation for the wheel's angle. Complex numbers: positions in wheel axes."""
    omega = 2 * np.pi / 60 * rpm

    def law(depth: float, rate: float) -> float:
        return max(STIFFNESS * depth + DAMPING * rate, 0.0) if depth > 0 else 0.0

    def contact(t: float, wheel: float, rate: float) -> tuple[float, float]:
        """Force and moment about the wheel's axis."""
        alpha, turned = BEGIN + omega * t, np.exp(-1j * wheel)
        if abs(alpha) < QUARTER:
            pin = CRANK * np.exp(1j * alpha)
            place, velocity = (pin - APART) * turned, 1j * omega * pin * turned
            velocity -= 1j * rate * place
            side = np.sign(place.imag)
            force = law(abs(place.imag) - play / 2, side * velocity.imag)
            return force, place.real * side * force
        place = -APART * turned
        offset = place - ARC * (-1 - 1j * np.sign(alpha))
        out = offset / abs(offset)
        force = law(abs(offset) - play, (-1j * rate * place * out.conjugate()).real)
        return 0.0, (place.conjugate() * out).imag * force

    def rates(t: float, z: np.ndarray) -> list[float]:
        return [z[1], (contact(t, *z)[1] - FRICTION * np.tanh(z[1] / 0.01)) / inertia]

    found = solve_ivp(rates, (0, END), [QUARTER, 0], "LSODA", rtol=1e-8, atol=1e-10, max_step=5e-4, dense_output=True)
    return max(contact(t, *found.sol(t))[0] for t in np.linspace(0, END, 3000))


ratio = APART / CRANK
half = (1 + ratio**2) / (4 * ratio)
alpha = np.arccos(np.sqrt(half**2 + 2) - half)  # where the acceleration without play is largest
peak = ratio * (ratio**2 - 1) * np.sin(alpha) / (1 + ratio**2 - 2 * ratio * np.cos(alpha)) ** 2
assert abs(peak - 5.41) < 0.005
assert abs(run["speeds up"] / (peak * (4 * np.pi) ** 2) - 1) < 0.01
assert abs(run["force"] / largest_force(120.0, 0.05, 5e-5) - 1) < 1e-4
assert np.allclose(bounds["force"], [largest_force(118.0, 0.045, 2e-5), largest_force(122.0, 0.055, 8e-5)], rtol=2e-3)
assert not bounds.warnings

if __name__ == "__main__":
    print(f"The wheel speeds up at {run['speeds up']:.0f} rad/s^2, and slows down at {run['slows down']:.0f} rad/s^2.")
    print("The largest force of the pin is {:.0f} to {:.0f} N.\n".format(*bounds["force"]))
    print(bounds.contributions())
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        turn = mb.simulate(scene.with_outputs({"wheel": wheel.theta, "acceleration": wheel_rate, "force": force}))
        mb.view(turn, folder / "geneva_drive.html")
        mb.view(turn, folder / "geneva_drive.png", time=0.06)
        turn.plot(folder / "geneva_drive_force.png")
