"""Results as JSON: arrays become nested lists, and numbers are finite or None."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def to_jsonable(value: Any) -> Any:
    """Nested mappings, sequences, arrays and numbers in the types of JSON.

    Examples
    --------
    >>> to_jsonable({"lower": np.array([[0.5, -np.inf]]), "failed": np.int64(2)})
    {'lower': [[0.5, None]], 'failed': 2}
    """
    if isinstance(value, Mapping):
        return {str(key): to_jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_jsonable(np.asarray(value).tolist())
    if isinstance(value, list | tuple):
        return [to_jsonable(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
