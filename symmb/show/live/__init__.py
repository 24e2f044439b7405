"""Live pages: a reader moves parameters and tolerances, and the page computes runs and bounds.

In:   a scene with a box, or bounds with polynomials, and limits.
Out:  one HTML file with the viewer, the C code of the scene as WebAssembly or the polynomials, and the levels of nodes.

live, surrogate            the pages of scenes, and of bounds without a scene
live_page                  the parts that both have
wasm, runs.c, kernel.c, ranges.c   the module: runs with scalar outputs, and bounds from runs at nodes, with the C code
                           of studies
worker.js                  runs and bounds beside the page, level after level
live.js, panel.html, live.css   the panel of the page
"""

from symmb._doors import open_door

open_door(__name__)
