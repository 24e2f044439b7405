"""Simulators as black boxes: parameters in, trajectories out.

The modules define the interface of simulators, the executors and the store of runs. Simulators are made from functions,
programs and FMUs.
"""

from symmb._doors import open_door

open_door(__name__)
