"""The border between CasADi SX and SymPy: in, out, LaTeX.

Only the files named here know SymPy, and they load it when one of their functions is called, so that
`import symmb` stays light.
"""

from ._latex import latex as latex
from ._sympy_in import from_sympy as from_sympy
from ._sympy_in import is_sympy as is_sympy
from ._sympy_out import to_sympy as to_sympy
