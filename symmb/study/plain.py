"""Results as JSON text: arrays become nested lists, and numbers are finite or null."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def to_json(value: Any) -> str:
    """JSON text of nested mappings, sequences, arrays and numbers.

    Examples
    --------
    >>> to_json({"lower": np.array([[0.5, -np.inf]]), "failed": np.int64(2)})
    '{"lower": [[0.5, null]], "failed": 2}'
    """
    return json.dumps(_plain(value), allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            return np.where(np.isfinite(array), array, None).tolist()
        return array.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
