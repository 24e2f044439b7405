"""symmb: symbolic multibody dynamics with interval parameters.

The public names stand in `__init__.pyi`; each room is loaded when one of its names is first used.
"""

from typing import Any

import lazy_loader

from symmb._names import did_you_mean

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # it takes as long to load as all else here

        return version("symmb")
    try:
        return _public(name)
    except AttributeError:
        if name.startswith("_"):
            raise
        raise AttributeError(f"symmb has no name {name!r}.{did_you_mean(name, __all__)}", name=name) from None
