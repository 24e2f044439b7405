"""Bounds by one surrogate beside those by four engines, on another benchmark's cases.

    PYTHONPATH=. python tests/benchmarks/one_surrogate.py known_ranges.py 41
    PYTHONPATH=. python tests/benchmarks/one_surrogate.py engineering_formulas.py 9200-9201 series

The benchmark runs twice, with its own arguments: as it is, and with `symmb.bounds.refinement` in the place of
`symmb.bounds.adaptive`.
"""

import runpy
import sys
from pathlib import Path

from symmb.bounds import polynomial_chaos
from symmb.bounds.adaptive import adaptive_bounds
from symmb.bounds.refinement import refined_bounds

if __name__ == "__main__":
    script, *sys.argv[1:] = sys.argv[1:]
    for name, engine in (("four engines", adaptive_bounds), ("one surrogate", refined_bounds)):
        print(f"--- {name}", flush=True)
        polynomial_chaos.adaptive_bounds = engine
        runpy.run_path(str(Path(__file__).parent / script), run_name="__main__")
