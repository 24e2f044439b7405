"""The functions of `show` that results of lower wings call. The functions are loaded at their first use."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

UPWARD = {
    "start_picture": "symmb.show.drawing",
    "write_bounds": "symmb.show.report",
    "write_comparison": "symmb.show.report",
}
"""Name of a function -> its room. No other import goes upwards: tests/test_architecture.py"""


def presentation(name: str) -> Callable[..., Any]:
    """The function of `show` with this name."""
    return getattr(import_module(UPWARD[name]), name)
