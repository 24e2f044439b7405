"""Malformed calls of the API and of the command line are told in sentences: a tenth of the benchmark's."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
import malformed


@pytest.mark.parametrize("seed", range(3))
def test_malformed_calls_are_told_in_sentences(seed):
    assert malformed.study(50, 100 + seed) == []


def test_a_fault_would_be_found(monkeypatch):
    def fails(value):
        raise ValueError(value)

    monkeypatch.setattr(malformed, "CALLS", [(fails, (1,), {})])
    assert len(malformed.study(3)) == 2
