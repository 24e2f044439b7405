"""A comparison on a cluster, in two ways: methods as jobs of submitit, or runs as tasks of Dask.

    python examples/cluster.py FOLDER                          both ways here, on processes
    python examples/cluster.py FOLDER --slurm PARTITION        methods as jobs of SLURM
    python examples/cluster.py FOLDER --dask tcp://head:8786   runs on the workers of a cluster of Dask

Methods as jobs: each job bounds the outputs by one method, on a machine of its own, and the reference is a job as
well. All jobs write their runs into one file of the folder, which all machines see, and take those that others made
from there. The comparison at the end finds all its runs there. A job that is lost is submitted again, and goes on where
it stopped.

`pip install submitit 'symmb[dask]'` brings what this needs.
"""

import argparse
from pathlib import Path
from tempfile import mkdtemp

import distributed
import numpy as np
import submitit

import symmb as mb

TIMES = np.linspace(0.0, 2.0, 41)
BOX = mb.Box(mass=(0.9, 1.1), stiffness=(9.0, 11.0))
METHODS = (mb.PolynomialChaos(order=3), mb.Scanning(5), mb.MonteCarlo(50))
REFERENCE = mb.Scanning(17)


def swing(mass: float, stiffness: float) -> np.ndarray:
    """x(t) of a mass on a spring, in the place of a program that takes minutes."""
    return np.cos(np.sqrt(stiffness / mass) * TIMES)


def stored(folder: Path) -> mb.StoredSimulator:
    """The simulator with its store of runs."""
    simulator = mb.FunctionSimulator(swing, {"mass": 1.0, "stiffness": 10.0}, TIMES, ["x"])
    return mb.StoredSimulator(simulator, folder / "runs.db")


def bounds_by(number: int, folder: Path) -> mb.Bounds:
    """One job: a method, or the reference behind them."""
    return mb.propagate(stored(folder), [*METHODS, REFERENCE][number], BOX)


def methods_as_jobs(folder: Path, partition: str | None) -> mb.Comparison:
    """Each method on a machine of its own; without a partition, in a process here."""
    jobs = submitit.AutoExecutor(folder / "logs", cluster="slurm" if partition else "local")
    jobs.update_parameters(timeout_min=60)
    if partition:
        jobs.update_parameters(slurm_partition=partition)
    count = len(METHODS) + 1
    *_, reference = [job.result() for job in jobs.map_array(bounds_by, range(count), [folder] * count)]
    return mb.compare(stored(folder), METHODS, BOX, reference)


def runs_as_tasks(folder: Path, address: str | None) -> mb.Comparison:
    """All runs of a comparison on the workers of Dask; without an address, on two processes here."""
    with distributed.Client(address, n_workers=2) if address is None else distributed.Client(address) as client:
        return mb.compare(stored(folder), METHODS, BOX, REFERENCE, executor=client)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="that all machines see; default: a new one")
    parser.add_argument("--slurm", metavar="PARTITION")
    parser.add_argument("--dask", metavar="ADDRESS")
    options = parser.parse_args()
    place = options.folder or Path(mkdtemp())
    ways = [] if options.dask else [methods_as_jobs(place, options.slurm)]
    ways += [] if options.slurm else [runs_as_tasks(place, options.dask)]
    for comparison in ways:
        print(comparison)
        if options.folder:
            comparison.plot(place / "cluster.png")
        assert comparison.rows[0].score.error.max() < 1e-3  # polynomials with 16 runs beside 289 runs
