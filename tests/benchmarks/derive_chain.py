"""How long deriving, compiling and starting a chain of n rods takes; run by hand."""

import sys
import time
from pathlib import Path

import symmb as mb

sys.path.insert(0, str(Path(__file__).parents[2]))
from models.chain import scene
from symmb.start.start import prepare_start

print("    n  derive [s]  compile [s]  start [s]  instructions a link")
for n in (5, 10, 20, 50, 100, 200):
    begin = time.perf_counter()
    chain = scene(n)
    for part in ("M", "Q", "Phi", "Phi_q", "gamma", "solve"):
        getattr(chain.system, part)
    derived = time.perf_counter()
    dae = mb.compile_dae(chain.system)
    compiled = time.perf_counter()
    prepare_start(chain, dae)
    started = time.perf_counter()
    times = (derived - begin, compiled - derived, started - compiled)
    print(f"{n:5d}{times[0]:12.3f}{times[1]:13.3f}{times[2]:11.3f}{dae.rhs.n_instructions() / n:21.1f}")
