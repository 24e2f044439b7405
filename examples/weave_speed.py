"""Below its weave speed a bicycle does not stay upright by itself. Which tolerance changes this speed most?

Six lengths and masses of the benchmark bicycle are known to 5 %. At the weave speed, the smallest damping passes zero.
`python examples/weave_speed.py FOLDER` draws the contributions to the variance of this speed into FOLDER.

Source: Meijaard, Papadopoulos, Ruina, Schwab (2007), Proc. R. Soc. A 463: weave speed 4.292 m/s.
"""

import sys

import matplotlib.pyplot as plt
import symmb.models.bicycle as bicycle

import symmb as mb

scene = bicycle.scene()
speeds = mb.critical(scene, "v", (3.0, 9.0))  # v1: weave ends, v2: capsize begins
bounds = mb.propagate(speeds, mb.PolynomialChaos(), box=scene.box)
low, high = (float(end[0]) for end in bounds["v1"])
moments = bounds.moments()
shares = dict(zip(moments.parameters, moments.total[:, 0, 0], strict=True))
most = max(shares, key=lambda name: shares[name])

assert low < 4.292 < high and shares[most] > 0.3
if __name__ == "__main__":
    print(f"Weave ends at {low:.2f} to {high:.2f} m/s. {most} causes {shares[most]:.0%} of the variance.")
    if len(sys.argv) > 1:
        plt.barh(list(shares), list(shares.values()))
        plt.xlabel("share of the variance of the weave speed")
        plt.tight_layout()
        plt.savefig(f"{sys.argv[1]}/weave_speed.png")
