"""symmb: symbolic multibody dynamics with interval parameters.

The public names stand in `__init__.pyi`; each room is loaded when one of its names is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
