"""Several processes fill one store, from which a comparison takes all its runs."""

import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest

import symmb as mb

EXAMPLES = Path(__file__).parents[2] / "examples"


def count(store):
    with sqlite3.connect(store) as connection:
        return connection.execute("SELECT count(*) FROM runs").fetchone()[0]


def test_methods_as_jobs_fill_the_store_of_a_comparison(tmp_path, monkeypatch):
    submitit, _ = pytest.importorskip("submitit"), pytest.importorskip("distributed")
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.setenv("PYTHONPATH", ":".join([str(EXAMPLES), *filter(None, sys.path)]))
    import cluster

    methods = cluster.METHODS[:1]  # two jobs write at once; examples/cluster.py has four
    jobs = submitit.AutoExecutor(tmp_path / "logs", cluster="local")
    numbers = [0, len(cluster.METHODS)]
    results = [job.result() for job in jobs.map_array(cluster.bounds_by, numbers, [tmp_path] * 2)]
    made = count(tmp_path / "runs.db")
    found = mb.compare(cluster.stored(tmp_path), methods, cluster.BOX, results[-1])
    assert count(tmp_path / "runs.db") == made > 289
    own = mb.FunctionSimulator(cluster.swing, {"mass": 1.0, "stiffness": 10.0}, cluster.TIMES, ["x"])
    plain = mb.compare(own, methods, cluster.BOX, cluster.REFERENCE)
    for row, other in zip(found.rows, plain.rows, strict=True):
        np.testing.assert_array_equal(row.score.error, other.score.error)
