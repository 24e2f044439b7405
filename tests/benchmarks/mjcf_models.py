"""Machines in MJCF: accelerations and motions of symmb against those of MuJoCo.

    PYTHONPATH=.:tests python tests/benchmarks/mjcf_models.py                30 random trees and 10 machines with loops
    PYTHONPATH=.:tests python tests/benchmarks/mjcf_models.py FILE.xml ...   one second of these files

Random machines must agree to 1e-9 of their largest acceleration, at a random state each. Loops are closed exactly in
both: M, forces and rows are those of MuJoCo, whose own accelerations are those of soft constraints. Files must agree to
1e-6 of the size of the motion after a second, at rest in the pose that they draw, with controls of a tenth of their
ranges. MuJoCo runs without what symmb leaves out.
"""

import sys
import tempfile
import time
from pathlib import Path

import mujoco
from mjcf_machines import Twin, difference, draw, largest_deviation

TREES, LOOPS = 30, 10


def main() -> None:
    for path in sys.argv[1:]:
        begin = time.perf_counter()
        found = largest_deviation(mujoco, path)
        print(f"{Path(path).name:40} {found:.1e}  {time.perf_counter() - begin:.1f} s", flush=True)
    if len(sys.argv) > 1:
        return
    with tempfile.TemporaryDirectory() as folder:
        for kind, count in (("trees", TREES), ("loops", LOOPS)):
            found = []
            for seed in range(count):
                twin: Twin = draw(mujoco, seed, Path(folder), kind == "loops")
                found.append(difference(twin))
                print(f"{kind} {seed:3}  n_v = {twin.model.nv:2}  {found[-1]:.1e}", flush=True)
            print(f"{kind}: largest difference {max(found):.1e} of the largest acceleration", flush=True)


if __name__ == "__main__":
    main()
