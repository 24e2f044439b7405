"""Solvers of the index-reduced DAE and the drivers of their steps.

Each solver is a frozen object with options. `registry` lists all solvers. Compiled solvers take their steps in the C
code of `codegen`.
"""

from symmb._doors import open_door

open_door(__name__)
