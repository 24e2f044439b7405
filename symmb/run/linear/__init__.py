"""Linear equations of motion at a state, their eigenvalues and modes, and effects of parameters on eigenvalues.

`linearize` returns one linearisation. `ModalSimulator` computes frequencies for samples of the parameters.
"""

from symmb._doors import open_door

open_door(__name__)
