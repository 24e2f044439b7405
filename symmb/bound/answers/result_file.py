"""Contents of files of bounds: entries of a record, columns of a table, and labelled arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Literal, cast

import numpy as np

from symmb._doubt import Doubt, concerned
from symmb._errors import DeclarationError
from symmb._labelled import (
    BOUND,
    Labelled,
    Named,
    each_parameter,
    known,
    over_outputs,
    over_parameters,
    texts,
    unit_text,
)
from symmb._names import ByName
from symmb._types import Array
from symmb._units import TIME_HEADINGS, read_headings, units_of_parameters
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import Piecewise
from symmb.bound.responses import Failure, Trace, WorstCase
from symmb.equations.model import Box, Choice
from symmb.results.files import Record, entry

Kind = Literal["enclosure", "estimate", "sampled"]
MEANING = {
    "enclosure": "proved: no response lies outside",
    "estimate": "from a surrogate: may be too wide or too narrow",
    "sampled": "attained by runs: the true bounds may be wider",
}


INNER = entry(Record.pair, "t", "names", name="inner_lower")
"""Metadata of bounds that runs attain. Files have an entry for each side: `inner_entries`."""


def inner_entries(inner: tuple[Array, Array] | None) -> dict[str, Array | None]:
    return dict(zip(("inner_lower", "inner_upper"), inner or (None, None), strict=True))


def parts_of(record: Record) -> dict[str, Any]:
    """The attributes of Bounds that are not single entries of an archive or a JSON file."""
    shape, names = (record.length("t"), record.length("names")), record.names("names")
    expansion = _expansion(record, *shape) if "alpha" in record else None
    return {
        "failed": tuple(
            Failure(run.numbers("parameters"), run.number("time"), run.text("message"))
            for run in record.records("failed", "parameters", "time", "message")
        ),
        "expansion": expansion,
        "surrogate": _surrogate(record, expansion, *shape) if "surrogate_error" in record else None,
        "run_doubts": _run_doubts(record, names),
        "trace": Trace.of_record(record.record("trace"), *shape) if "trace" in record else None,
        "worst_cases": tuple(map(WorstCase.of_record, record.records("worst"))) if "worst" in record else (),
    }


def doubts_entries(doubts: Sequence[str], names: Sequence[str]) -> dict[str, Any]:
    """Entries of warnings about runs, and of the outputs that each warning concerns."""
    return {"run_doubts": doubts, "doubted": [{"outputs": concerned(doubt, names)} for doubt in doubts]}


def _run_doubts(record: Record, names: Sequence[str]) -> tuple[str, ...]:
    """Warnings about runs. In files of earlier versions they concern all outputs."""
    doubts, doubted = record.texts("run_doubts", default=()), record.records("doubted", "outputs")
    outputs = [each.texts("outputs") for each in doubted] or [tuple(names)] * len(doubts)
    return tuple(Doubt(*each) for each in zip(doubts, outputs, strict=True))


def box_of(record: Record, name: str) -> Box:
    """The box of a file that contains its intervals by name."""
    given: dict[str, Any] = {own: tuple(ends.tolist()) for own, ends in record.arrays(name, 2).items()}
    for own in record.records(f"{name}_choices"):
        parameters, labels = own.names("parameters"), own.names("labels")
        values = [*map(tuple, own.array("values", None, len(parameters)).tolist())]
        given = {n: ends for n, ends in given.items() if n not in parameters}
        choice = Choice(own.text("name"), labels, parameters, tuple(values), ("",) * len(parameters))
        given[choice.name] = choice
    return Box(**given).with_units(record.units(name))


def box_entries(box: Box | None) -> dict[str, Any]:
    """Entries of a box, of its units if the box has units, and of its choices. Constraints are not stored."""
    units = {"box_units": dict(zip(box.names, box.units, strict=True))} if box and box.units else {}
    choices = {"box_choices": [asdict(choice) for choice in box.choices]} if box and box.choices else {}
    return {"box": box and dict(box), **units, **choices}


def record_of_table(table: Record) -> Record:
    """The record of a .csv table. A table has no inner bounds, failed runs, seconds and expansion."""
    headings, columns = table.texts("headings"), table.record("columns")
    own = headings[1:-3]
    parts = ("lower", "upper", "estimate")[: 3 if own and own[-1].endswith(" estimate") else 2]
    heads = [heading.removesuffix(" lower") for heading in own[:: len(parts)]]
    expected = (*(f"{head} {part}" for head in heads for part in parts), "kind", "method", "evaluations")
    if not own or headings[1:] != expected or headings[0] not in TIME_HEADINGS:
        raise DeclarationError("its headings must be t, x lower, x upper, ..., kind, method, evaluations.")
    names, units = read_headings(headings[0], heads)
    *numbers, kind, method, _ = (columns.plain[str(k)] for k in range(len(headings)))
    evaluations = columns.array(str(len(headings) - 1), None)
    values = np.array(numbers[1:]).reshape(len(names), len(parts), -1)
    entries = {part: values[:, k].T for k, part in enumerate(parts)}
    same = {"kind": kind[0], "method": method[0], "evaluations": int(evaluations[0]), "seconds": None}
    return Record({"t": numbers[0], "names": names, "units": units, **entries, **same})


def kind_of(record: Record, name: str) -> Kind:
    """The kind of the bounds in a file: "enclosure", "estimate" or "sampled"."""
    return cast(Kind, record.text(name, *MEANING))


def nominal_of(record: Record, name: str, *shape: int | None) -> Array:
    """The nominal outputs (n_t, n_y) of a file. JSON has no infinite numbers, such as the time of an absent event.

    Only the upper bounds of such outputs are infinite.
    """
    values, (lower, upper) = record.with_nan(name, *shape), record.pair("lower", *shape)
    return np.where(np.isnan(values) & np.isinf(upper) & np.isfinite(lower), np.inf, values)


def _expansion(record: Record, n_t: int, n_y: int, names: tuple[str, ...] | None = None) -> Expansion:
    parameters = record.names("parameters") if names is None else names
    alpha = record.size("alpha", None, len(parameters))
    return Expansion(alpha.astype(np.intp), record.array("coefficients", len(alpha), n_t, n_y), parameters)


def surrogate_entries(surrogate: Piecewise | None) -> dict[str, Any]:
    """Entries of polynomials: their error, and several pieces. A single piece is the entry of the expansion."""
    if surrogate is None:
        return {"surrogate_error": None}
    entries: dict[str, Any] = {"surrogate_error": surrogate.error}
    if len(surrogate.expansions) > 1:
        parts = zip(surrogate.centres, surrogate.halves, surrogate.expansions, strict=True)
        entries["piece_parameters"] = surrogate.expansions[0].parameters
        entries["pieces"] = [
            {"centre": centre, "half": half, "alpha": own.alpha, "coefficients": own.coefficients}
            for centre, half, own in parts
        ]
    return entries


def _surrogate(record: Record, expansion: Expansion | None, n_t: int, n_y: int) -> Piecewise | None:
    error = record.size("surrogate_error", n_t, n_y)
    if "pieces" not in record:
        return None if expansion is None else Piecewise.whole(expansion, error)
    pieces, names = record.records("pieces"), record.names("piece_parameters")
    centres, halves = (np.stack([p.array(name, len(names)) for p in pieces]) for name in ("centre", "half"))
    return Piecewise(centres, halves, tuple(_expansion(p, n_t, n_y, names) for p in pieces), error)


def box_coordinates(box: Box | None) -> dict[str, Named]:
    """Names of the uncertain parameters, and the ends of their intervals."""
    if box is None:
        return {}
    ends = np.stack([box.lower, box.upper], axis=1)
    own = over_parameters(box.names, dict(zip(box.names, box.units, strict=False)))
    return {**own, "box": (("parameter", "bound"), ends)}


def labelled(
    record: Mapping[str, Any], outer: tuple[Array, Array], failed: tuple[Failure, ...], box: Box | None
) -> Labelled:
    """Bounds as labelled arrays, from all entries of a file."""
    names, units = record["names"], record["units"]
    alike = "value", "outer", "estimate", "inner", "nominal", "noise"
    coordinates, unit_of = over_outputs(record["t"], names, units, *alike)
    coordinates |= {"bound": (("bound",), texts(BOUND)), **box_coordinates(box)}
    series, pair = ("time", "output"), ("bound", "time", "output")
    inner = None if record["inner_lower"] is None else np.stack([record["inner_lower"], record["inner_upper"]])
    variables = known(
        {
            "value": (pair, np.stack([record["lower"], record["upper"]])),
            "outer": (pair, None if record["estimate"] is None else np.stack(outer)),
            "estimate": (series, record["estimate"]),
            "inner": (pair, inner),
            "nominal": (series, record["nominal"]),
            "noise": (("output",), record["noise"]),
        }
    )
    if record["alpha"] is not None:
        own = "parameter" if box is not None and tuple(record["parameters"]) == box.names else "expansion_parameter"
        coordinates[own] = ((own,), texts(record["parameters"]))
        variables["alpha"] = (("term", own), record["alpha"])
        variables["coefficients"] = (("term", "time", "output"), record["coefficients"])
    if failed:
        values = {name: np.array([run.parameters[name] for run in failed]) for name in failed[0].parameters}
        variables["failed_at"] = (("sample",), np.array([run.time for run in failed]))
        variables["failure"] = (("sample",), texts([run.message for run in failed]))
        values, taken = ByName(values, units_of_parameters(record["nominal_parameters"])), [*coordinates, *variables]
        own, units_of_own = each_parameter(values, ("sample",), [*taken, "term", "sample"])
        coordinates, unit_of = coordinates | own, unit_of | units_of_own
    attributes = {name: record[name] for name in ("method", "kind", "range_of", "evaluations", "seconds", "caution")}
    sentences = {name: "\n".join(record[name]) or None for name in ("doubts", "remarks")}
    attributes |= {"units": unit_text(names, units), **sentences}
    return Labelled(coordinates, variables, {k: None if v == "" else v for k, v in attributes.items()}, unit_of)
