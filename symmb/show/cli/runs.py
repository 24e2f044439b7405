"""The command `symmb runs`: the contents of a file of stored runs."""

import argparse
import re
from pathlib import Path
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._labelled import Labelled, Named, parameter_names
from symmb._table import aligned
from symmb.connect import STATES, RunDatabase, open_run_database
from symmb.results.files import replacement, require_suffix

_PRUNED = {"failed": (1, 2, 3), "timed-out": (2,), "all": (0, 1, 2, 3)}
"""Word after --prune -> numbers of the states whose runs are removed."""


def add_runs(commands: "argparse._SubParsersAction[Any]") -> None:
    """Add the command `symmb runs`."""
    text = "list the studies in a file of stored runs"
    runs = commands.add_parser("runs", help=text, description=f"{text}, remove runs, or write them for xarray.")
    runs.add_argument("file", metavar="FILE", help="a file that StoredSimulator has made")
    runs.add_argument("--study", metavar="N", type=int, help="number of the study; needed by --export of several")
    runs.add_argument("--prune", choices=list(_PRUNED), help="remove runs, so that they are made again")
    runs.add_argument("--export", metavar="F.nc", help="write the runs of a study as NetCDF; needs symmb[data]")
    runs.set_defaults(run=_runs)


def _runs(options: argparse.Namespace) -> tuple[str, ...]:
    with open_run_database(Path(options.file), create=False) as database:
        numbers = [number for number, *_ in database.studies()]
        if options.study is not None and options.study not in numbers:
            raise DeclarationError(f"{options.file} has no study {options.study}, only {numbers}.")
        if options.prune:
            count = database.prune(_PRUNED[options.prune], options.study)
            print(f"{count} runs removed")
        if options.export is not None:
            if options.study is None and len(numbers) != 1:
                raise DeclarationError(f"--export needs --study N, one of {numbers}.")
            _export(database, options.study or numbers[0], Path(options.export))
        print(_table(database))
    return ()


def _table(database: RunDatabase) -> str:
    lines = [["study", "simulator", "begun", *STATES, "parameters"]]
    for number, study, begun, counts in database.studies():
        lines.append([str(number), study.simulator, begun, *map(str, counts), ", ".join(study.parameters)])
    return "\n".join(aligned(lines, left=(1, 2, 3 + len(STATES))))


def _export(database: RunDatabase, number: int, path: Path) -> None:
    require_suffix(path, ".nc")
    study = next(study for found, study, *_ in database.studies() if found == number)
    P = database.samples(number, len(study.parameters))
    runs = database.read(number, P, (len(study.times), len(study.outputs)))
    coordinates: dict[str, Named] = {"time": (("time",), study.times), "output": (("output",), np.array(study.outputs))}
    variables: dict[str, Named] = {"response": (("sample", "time", "output"), runs.Y)}
    variables["ok"] = ("sample",), runs.ok.astype(np.int8)
    # NetCDF takes letters, digits and some signs in names. SciPy writes only characters of Latin-1.
    plain = [re.sub(r"[^\w.+-]", "_", name, flags=re.ASCII) for name in study.parameters]
    names = parameter_names(
        [name if name[0].isalpha() else f"_{name}" for name in plain], [*coordinates, *variables, "sample"]
    )
    coordinates |= {name: (("sample",), P[:, i]) for i, name in enumerate(names)}
    attributes = {"simulator": study.simulator, "digest": study.digest, "parameters": "\n".join(study.parameters)}
    data = Labelled(coordinates, variables, attributes, {"time": "s"}).to_xarray()
    for name, own in zip(names, study.parameters, strict=True):
        data[name].attrs["long_name"] = own
    with replacement(path) as file:
        file.write(bytes(data.to_netcdf()))
