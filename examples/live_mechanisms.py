"""Six mechanisms with sliders for all values and tolerances. Which tolerances satisfy the limits?

Each page runs the mechanism, and computes bounds and margins of limits after each change. `mb.live` writes such pages.
As a check, studies in Python decide the limits for the first values of the sliders.
`python examples/live_mechanisms.py FOLDER` writes the pages into FOLDER. This needs the package ziglang: run
`pip install 'symmb[compiler]'`.

Source: the models and examples that this script imports.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import door_latch
import geneva_drive
import suspension
import symmb.models.double_pendulum as double_pendulum
import symmb.models.four_bar as four_bar
import symmb.models.slider_crank as slider_crank

import symmb as mb

door = {"angle": door_latch.hinge.angle, "force on the striker": (door_latch.pull, "N")}
wheel = {"wheel": geneva_drive.wheel.theta, "force of the pin": geneva_drive.force}
road = {"force on the road": (suspension.pressure, "N"), "height of the car": suspension.car.y}
mechanisms = {
    "double_pendulum": (double_pendulum.scene(), {"x2": (-1.25, 1.25)}),
    "four_bar": (four_bar.scene(), {"rocker_angle": (1.45, 2.5)}),
    "slider_crank": (slider_crank.scene(), {"x_slider": (None, 3.05)}),
    "suspension": (suspension.scene.with_outputs(road), {"force on the road": (500.0, None)}),
    "door_latch": (door_latch.scene.with_outputs(door), {"force on the striker": (None, 2000.0)}),
    "geneva_drive": (geneva_drive.scene.with_outputs(wheel), {"force of the pin": (None, 5000.0)}),
}
checks = [mb.propagate(scene, mb.PolynomialChaos()).check(limits) for scene, limits in mechanisms.values()]
assert [check.kept for check in checks] == [True, True, False, True, True, True]

if __name__ == "__main__":
    for check in checks:
        for limit in check.limits:
            print(f"{limit.text}: {limit.why}")
    if not find_spec("ziglang"):
        print("The pages need the package ziglang. Run `pip install 'symmb[compiler]'`.")
    elif len(sys.argv) > 1:
        for name, (scene, limits) in mechanisms.items():
            mb.live(scene, Path(sys.argv[1]) / f"{name}.html", limits)
