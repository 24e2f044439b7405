"""A crane raises its slender boom and stops. How far does its load swing, and how much does the boom bend?

The boom is a flexible tube. A drive turns the boom at its foot. The load hangs on a rope of uncertain length. At the
start, the deflection of the boom under the load and its weight is that of a cantilever.
`python examples/crane.py FOLDER` draws the crane and the runs that attain the bounds into FOLDER.

Source: textbook beam, e.g. Gere and Goodno, Mechanics of Materials, appendix H; own values.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import symmb as mb

LENGTH, AREA, MOMENT, G = 10.0, 6e-3, 3e-5, 9.81
STEEL = mb.Material(E=210e9, density=7850.0, nu=0.3)
BEGIN, TURN, TIME = np.radians(30.0), np.radians(20.0), 4.0

tube = mb.Section(area=AREA, Iy=MOMENT, Iz=MOMENT, J=2 * MOMENT)
mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (LENGTH, 0, 0)], tube, STEEL, elements=10))
modes = mesh.modes(interfaces=[10], count=4, clamped=0, planar=True, damping=0.01)

p = mb.Parameters(rope=6.0, load=500.0)
ground = mb.Ground()
boom = mb.FlexibleBody("boom", modes, mb.Planar())
load = mb.Body("load", p.load, pose=mb.Particle())
foot, tip = boom.point(0, 0), boom.point(LENGTH, 0)
share = ca.fmin(mb.t / TIME, 1)
scene = mb.Scene(
    mb.System(
        boom,
        load,
        mb.Revolute("foot", ground.point(0, 0), foot),
        mb.Motion("luffing", boom.theta, BEGIN + TURN * share**3 * (10 - 15 * share + 6 * share**2)),
        mb.Distance("rope", tip, load.point(0, 0), p.rope),
        mb.Gravity(0, -G),
        parameters=p,
    ),
    guess={"load.x": LENGTH * np.cos(BEGIN), "load.y": LENGTH * np.sin(BEGIN) - 6.0},
    times=np.linspace(0.0, 12.0, 241),
    outputs={"swing": load.x - tip.x, "bend": -(tip.y - LENGTH * ca.sin(boom.theta)) * 1e3},
    box=mb.Box(rope=(5.0, 7.0), load=(450.0, 550.0)),
    equilibrium=True,
    name="crane",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())


def bend(load: float) -> float:
    """Downward deflection [mm] of the tip at rest, under the load and the weight of the boom."""
    across = G * np.cos(BEGIN)
    deflection = load * across * LENGTH**3 / 3 + STEEL.density * AREA * across * LENGTH**4 / 8
    return 1e3 * deflection / (STEEL.E * MOMENT) * np.cos(BEGIN)


assert abs(run["bend"][0] / bend(500.0) - 1) < 1e-3
low, high = bounds["bend"]
assert np.allclose([low[0], high[0]], [bend(450.0), bend(550.0)], rtol=1e-3)
assert not bounds.warnings

if __name__ == "__main__":
    after = scene.times > TIME
    low, high = bounds["swing"]
    print(f"After the drive has stopped, the load swings by up to {max(-low[after].min(), high[after].max()):.2f} m.")
    print(f"The boom bends by {bounds['bend'][0].min():.0f} to {bounds['bend'][1].max():.0f} mm.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "crane.html")
        mb.view(bounds, Path(sys.argv[1]) / "crane.png", output="swing", time=5.0)
        bounds.plot(Path(sys.argv[1]) / "crane_bounds.png")
