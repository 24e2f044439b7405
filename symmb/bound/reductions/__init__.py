"""Features of a box that are taken out before a study, and put back into its bounds.

In:   a method, a simulator and a box, perhaps with choices or constraints.
Out:  Bounds over this box. `bounded` decides: it applies the reductions of `chain.REDUCTIONS`, and then the method.
      If a scalar output has no value in some runs, `absences` makes a second study. If an element may act where no run
      is, `unseen` searches for it, and studies this part of the box.
"""

from symmb._doors import open_door

open_door(__name__)
