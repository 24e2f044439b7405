"""Methods that bound responses over a box. Each method has a file.

In:   a simulator and a box without choices.
Out:  Bounds. `bounds_of` in `one_box` decides: it calls a method, checks what it returns, and limits bounds to values
      that an output can have. `registry` lists the methods.
"""

from symmb._doors import open_door

open_door(__name__)
