"""The estimated error of a range, with the rule that decides it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array, Indices, Mask
from symmb.bound.responses import RULES

_NUMBERS = {name: k for k, name in enumerate(RULES)}


@dataclass(frozen=True, eq=False)
class Evidence:
    """Estimated errors, and the number of the rule that decides each of them.

    Attributes
    ----------
    error : (n_t, n_y)      at least 0
    rule : (n_t, n_y)       positions in RULES of `bounds.trace`
    """

    error: Array
    rule: Indices

    @classmethod
    def of(cls, rule: str, error: Array) -> "Evidence":
        """Errors that one rule decides."""
        return cls(error, np.full(error.shape, _NUMBERS[rule], dtype=np.intp))

    @classmethod
    def joined(cls, parts: Sequence["Evidence"], n_t: int) -> "Evidence":
        """The evidence of outputs side by side. Scalar outputs have one time."""
        shape = n_t, 1
        errors, rules = zip(
            *((np.broadcast_to(e.error, shape), np.broadcast_to(e.rule, shape)) for e in parts), strict=True
        )
        return cls(np.concatenate(errors, axis=1), np.concatenate(rules, axis=1))

    def at_least(self, rule: str, error: Array | float) -> "Evidence":
        """Errors that are at least those of another rule."""
        return self._where(self.error < error, rule, error)

    def at_most(self, rule: str, error: Array | float) -> "Evidence":
        """Errors that are at most those of another rule."""
        return self._where(self.error > error, rule, error)

    def _where(self, is_other: Mask, rule: str, error: Array | float) -> "Evidence":
        rules = self.rule.copy()
        rules[is_other] = _NUMBERS[rule]
        return Evidence(np.where(is_other, error, self.error), rules)

    def plus(self, rule: str, error: Array) -> "Evidence":
        """Errors that are larger by those of another rule, which decides if its errors are the larger part."""
        return Evidence(self.error + error, self._where(self.error < error, rule, error).rule)

    def attributed(self, which: Mask, rule: str) -> "Evidence":
        """The same errors, which another rule decides where a mask (n_t, n_y) is True."""
        return self._where(which, rule, self.error)

    def replaced(self, which: Mask, other: "Evidence") -> "Evidence":
        """The other evidence where a mask (n_t, n_y) or (n_y,) is True."""
        return Evidence(np.where(which, other.error, self.error), np.where(which, other.rule, self.rule))

    def column(self, k: int) -> "Evidence":
        """The evidence (n_t, 1) of one output."""
        return Evidence(self.error[:, k : k + 1], self.rule[:, k : k + 1])

    def with_column(self, k: int, other: "Evidence") -> "Evidence":
        """The evidence, with that of one output replaced by another (n_t, 1)."""
        return self.replaced(np.arange(self.error.shape[1]) == k, other)

    def decisive(self, output: int = 0) -> str:
        """The name of the rule that decides the largest error of an output."""
        return (*RULES,)[self.rule[self.error[:, output].argmax(), output]]
