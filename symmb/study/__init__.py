"""Studies of a scene. Each study answers one question.

compare       which method bounds best: error against run time, compared with a reference
stability     which solver runs best: error against run time, also under stress
tolerances    how large tolerances may be; `tolerance_search` finds the factors, `bounds.limits` decides each limit
design        which nominal values have the best bounds, with limits and costs; `design_search` finds them
calibration   which parameters fit measured outputs; `residuals` has the least squares
consistent    which parameters keep all outputs within an error of the data
root_locus    how eigenvalues depend on a parameter
"""

from symmb._doors import open_door

open_door(__name__)
