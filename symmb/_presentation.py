"""The functions of `show` that results in other folders call. Each function is loaded at its first use."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

UPWARD = {
    "live": "symmb.show.live",
    "live_surrogate": "symmb.show.live",
    "start_picture": "symmb.show.drawing",
    "write_bounds": "symmb.show.report",
    "write_comparison": "symmb.show.report",
}
"""Name of a function -> its module. tests/test_architecture.py checks that no other import leads to a higher layer."""


def presentation(name: str) -> Callable[..., Any]:
    """The function of `show` with this name."""
    return getattr(import_module(UPWARD[name]), name)
