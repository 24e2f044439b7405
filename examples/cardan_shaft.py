"""Two Cardan joints with equal angles transmit a constant speed. How much does the speed vary if the angles differ?

The driving shaft turns at constant speed. The middle shaft has one angle to the driving shaft, and a second angle to
the driven shaft. All three shafts lie in a plane. The angles are equal only if the shafts are mounted exactly.
`python examples/cardan_shaft.py FOLDER` draws the shafts into FOLDER.

Source: textbook drive, e.g. Seherr-Thoss, Schmelz, Aucktor, Universal Joints and Driveshafts; own values.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import symmb as mb

SPEED = 20.0  # [rad/s]
ANGLE = np.radians(25)

p = mb.Parameters(first=ANGLE, second=ANGLE)
ground = mb.Ground()
drive, middle, driven = (
    mb.Body(name, 1.0, (1e-3, 1e-3, 1e-3), pose=mb.Spatial()) for name in ("drive", "middle", "driven")
)
# The middle shaft is turned from x about z by the first angle. The driven shaft is turned back by the second angle.
along = ca.vertcat(ca.cos(p.first), ca.sin(p.first), 0)
bend = p.first - p.second
out = ca.vertcat(ca.cos(bend), ca.sin(bend), 0)
end = ca.vertsplit(0.6 * along + 0.2 * out)
bearing = mb.Revolute("bearing", ground.point(-0.2, 0, 0), drive.point(-0.2, 0, 0), axis=(1, 0, 0))
system = mb.System(
    drive,
    middle,
    driven,
    bearing,
    mb.Universal("first_joint", drive.point(0, 0, 0), middle.point(-0.3, 0, 0), axis=(0, 0, 1), axis_b=(0, 1, 0)),
    mb.Universal("second_joint", middle.point(0.3, 0, 0), driven.point(0, 0, 0), axis=(0, 1, 0), axis_b=(0, 0, 1)),
    mb.Cylindrical(
        "seat", ground.point(*end), driven.point(0.2, 0, 0), axis=tuple(ca.vertsplit(out)), axis_b=(1, 0, 0)
    ),
    mb.Motion("motor", bearing.angle, SPEED * mb.t),
    parameters=p,
)
scene = mb.Scene(
    system,
    guess={"middle.x": 0.27, "middle.y": 0.13, "driven.x": 0.54, "driven.y": 0.25},
    times=np.linspace(0.0, 2 * np.pi / SPEED, 201),
    outputs={"middle": middle.omega[0], "driven": driven.omega[0]},
    box=mb.Box(second=(ANGLE - 0.02, ANGLE + 0.02)),
    name="Cardan shaft",
)
run = mb.simulate(scene)
bounds = mb.propagate(scene, mb.PolynomialChaos())

# A joint with the angle b turns w into w cos b / (1 - sin(b)^2 sin(a)^2). Here a is the angle of the driving yoke.
a = SPEED * scene.times
assert np.abs(run["middle"] / SPEED - np.cos(ANGLE) / (1 - (np.sin(ANGLE) * np.sin(a)) ** 2)).max() < 1e-6
assert np.abs(run["driven"] / SPEED - 1).max() < 1e-6
# At the start the ratio of speeds is cos(first) in the first joint, and 1 / cos(second) in the second joint.
low, high = (values / SPEED for values in bounds["driven"])
assert np.allclose([low[0], high[0]], np.cos(ANGLE) / np.cos([ANGLE - 0.02, ANGLE + 0.02]), atol=1e-5)
assert not bounds.warnings

if __name__ == "__main__":
    slowest, fastest = run["middle"].min(), run["middle"].max()
    print(f"The middle shaft turns at {slowest:.1f} to {fastest:.1f} rad/s, the driving shaft at 20 rad/s.")
    print(f"With an error of 0.02 rad, the driven shaft turns at {20 * low.min():.2f} to {20 * high.max():.2f} rad/s.")
    if len(sys.argv) > 1:
        mb.view(run, Path(sys.argv[1]) / "cardan_shaft.html")
        mb.view(run, Path(sys.argv[1]) / "cardan_shaft.png", time=0.03)
