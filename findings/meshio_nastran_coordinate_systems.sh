#!/usr/bin/env bash
# meshio reads nodes of Nastran files as if all were given in the basic coordinate system.
#
# Expected before the first run: meshio transforms nodes whose GRID card names another system (field CP), or refuses
# them, as pyNastran does the first.
# Seen with meshio 5.3.5: the numbers of the card are returned without a word. A node at a radius of 2 and an angle of 90
# degrees of a cylindrical system gets x = 2 and y = 90. pyNastran puts it at x = 0 and y = 2.
# The README of meshio lists Nastran among the formats, without this limit.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet meshio==5.3.5 pyNastran==1.4.1 'numpy<2'
cat >"$work/quarter.bdf" <<'CARDS'
SOL 101
CEND
BEGIN BULK
CORD2C,1,0,0.,0.,0.,0.,0.,1.
,1.,0.,0.
GRID,1,1,2.0,90.0,0.5
GRID,2,1,2.0,0.0,0.5
GRID,3,0,1.0,1.0,0.0
CTRIA3,1,1,1,2,3
PSHELL,1,1,0.01
MAT1,1,2.1e11,,0.3
ENDDATA
CARDS
cd "$work"
venv/bin/python - <<'PYTHON'
import sys
from importlib.metadata import version

import meshio
import numpy as np
from pyNastran.bdf.bdf import read_bdf

print("meshio", version("meshio"), "pyNastran", version("pyNastran"))
of_meshio = meshio.read("quarter.bdf").points[0]
of_pynastran = read_bdf("quarter.bdf", debug=False).nodes[1].get_position()
print("node 1, expected [0, 2, 0.5]")
print("meshio   ", of_meshio)
print("pyNastran", np.round(of_pynastran, 12))
as_described = np.allclose(of_meshio, [2, 90, 0.5]) and np.allclose(of_pynastran, [0, 2, 0.5], atol=1e-9)
sys.exit(not as_described)
PYTHON
