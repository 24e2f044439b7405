"""Baselines of the literature on the double pendulum's twelve states: what they cost and how far off they are.

Error, over and under are means over the states of what `symmb.study` measures, in % of the width, against the stored
bounds of 801 x 801 runs; those have five digits, so errors below 0.001 % are none. Run by hand.
"""

# ruff: noqa: E402, I001  (pinned before NumPy starts its threads)
import json
from pathlib import Path

from _timing import pin

pin()
import numpy as np
from models.double_pendulum import scene

import symmb as mb
from symmb.study.metrics import Yardstick

DATA = json.loads((Path(__file__).parents[1] / "data" / "double_pendulum_bounds.json").read_text())
METHODS = (
    *(mb.Taylor(order, parts) for order in (1, 2) for parts in (1, 2, 4)),
    mb.Vertex(),
    mb.Scanning(21),
    *(mb.Optimization(budget) for budget in (100, 300, 1000)),
)

simulator = mb.DAESimulator(scene().with_times(DATA["times"]), mb.DormandPrince(rtol=1e-9))
print(f"{'':5s}{'':36s}{'evaluations':>12s}{'error':>10s}{'over':>10s}{'under':>10s}{'seconds':>10s}")
for spread in (0.05, 0.2):
    true = DATA["cases"][f"{100 * spread:.0f}%"]["true"]
    yardstick = Yardstick(np.array(true["lower"]).T, np.array(true["upper"]).T, np.zeros(12))
    box = mb.Box.around(simulator.parameters, spread)
    for method in METHODS:
        method.bounds(simulator, box)
        bounds = method.bounds(simulator, box)
        score = yardstick.score(bounds.lower, bounds.upper)
        shares = [f"{100 * share.mean():10.3f}" for share in (score.error, score.over, score.under)]
        print(f"{spread:<5.0%}{method!r:36}{bounds.evaluations:12d}{''.join(shares)}{bounds.seconds:10.3f}", flush=True)
