"""A comparison on a cluster, in two ways: methods as jobs of submitit, or runs as tasks of Dask.

    python examples/cluster.py FOLDER                          both ways, in processes of this computer
    python examples/cluster.py FOLDER --slurm PARTITION        methods as jobs of SLURM
    python examples/cluster.py FOLDER --dask tcp://head:8786   runs on the workers of a cluster of Dask

Methods as jobs: each job computes bounds by one method on one machine. The reference is also a job. All machines must
have access to the folder. Each job writes its runs into one file in this folder, and reads the runs of other jobs. The
final comparison finds all its runs in the file. If a job fails, or if its time expires, the script ends with an error.
Start the script again with the same folder: the new jobs use all finished runs.

`pip install submitit 'symmb[dask]'` installs the necessary packages.
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
    """One job: the bounds by the method with this number. The last number is for the reference."""
    return mb.propagate(stored(folder), [*METHODS, REFERENCE][number], BOX)


def methods_as_jobs(folder: Path, partition: str | None) -> mb.Comparison:
    """Compare methods, each in one job of SLURM. Without a partition, jobs are processes of this computer."""
    jobs = submitit.AutoExecutor(folder / "logs", cluster="slurm" if partition else "local")
    jobs.update_parameters(timeout_min=60)
    if partition:
        jobs.update_parameters(slurm_partition=partition)
    count = len(METHODS) + 1
    *_, reference = [job.result() for job in jobs.map_array(bounds_by, range(count), [folder] * count)]
    return mb.compare(stored(folder), METHODS, BOX, reference)


def runs_as_tasks(folder: Path, address: str | None) -> mb.Comparison:
    """Compare methods with runs on the workers of Dask. Without an address, two processes of this computer are used."""
    with distributed.Client(address, n_workers=2) if address is None else distributed.Client(address) as client:
        return mb.compare(stored(folder), METHODS, BOX, REFERENCE, executor=client)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="folder that all machines can read; default: a new folder")
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
        assert comparison.rows[0].score.error.max() < 1e-3  # polynomials of 16 runs against a scan of 289 runs
