"""The model description of an FMU of FMI 2 or 3."""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version as symmb_version

import numpy as np

from symmb._errors import DeclarationError
from symmb._units import BASES, unit_of
from symmb.show.exchange.exported import Exported

BINARY_FILES, HEADERS = ("fmi.c", "scene.c"), ("scene.h",)
"""Sources of the binary, in the folder `sources` of an FMU."""


@dataclass(frozen=True)
class _Variable:
    name: str
    causality: str
    variability: str
    initial: str = ""
    start: float | None = None
    unit: str = ""
    state: int | None = None  # number of the state, if the variable is the rate of a state


def _variables(scene: Exported) -> list[_Variable]:
    """All variables of an FMU. The number of a variable is its value reference."""
    nominal = dict(zip((*scene.parameters, *scene.inputs), scene.source.nominal.tolist(), strict=True))
    variables = [_Variable("time", "independent", "continuous", unit="s")]
    variables += [
        _Variable(name, "parameter", "tunable", "exact", nominal[name], scene.parameter_units.get(name, ""))
        for name in scene.parameters
    ]
    variables += [_Variable(name, "input", "continuous", start=nominal[name]) for name in scene.inputs]
    variables += [
        _Variable(name, "output", "continuous", "calculated", unit=unit)
        for name, unit in zip(scene.outputs, scene.units, strict=True)
    ]
    first, states = len(variables), [f"state.{name}" for name in scene.states]
    variables += [_Variable(name, "local", "continuous", "calculated") for name in states]
    if scene.source.has_rates:
        variables += [
            _Variable(f"der({name})", "local", "continuous", "calculated", state=first + k)
            for k, name in enumerate(states)
        ]
    return variables


def description(scene: Exported, version: int, identifier: str) -> bytes:
    """modelDescription.xml of FMI 2 or 3. DeclarationError is raised if two variables have the same name."""
    variables, three = _variables(scene), version == 3
    indicators = range(scene.source.n_switches if scene.source.has_rates else 0)
    if three:
        variables += [_Variable(f"switch[{k}]", "local", "continuous", "calculated") for k in indicators]
    names = Counter(variable.name for variable in variables)
    if twice := [name for name, count in names.items() if count > 1]:
        raise DeclarationError(f"{twice[0]!r} is the name of two FMU variables. Rename the parameter or the output.")
    token = {"instantiationToken" if three else "guid": scene.source.token}
    root = ET.Element(
        "fmiModelDescription",
        {"fmiVersion": f"{version}.0", "modelName": scene.name, **token}
        | {"generationTool": f"symmb {symmb_version('symmb')}", "variableNamingConvention": "flat"}
        | ({} if three else {"numberOfEventIndicators": str(len(indicators))}),
    )
    for interface in ["ModelExchange"] * scene.source.has_rates + ["CoSimulation"]:
        varies = {"canHandleVariableCommunicationStepSize": "true"} if interface == "CoSimulation" else {}
        element = ET.SubElement(root, interface, {"modelIdentifier": identifier, **varies})
        if not three:
            _add_files(ET.SubElement(element, "SourceFiles"), "File")
    _add_units(root, sorted({variable.unit for variable in variables} - {""}))
    times = scene.source.times
    experiment = {"startTime": repr(float(times[0]))}
    if len(times) > 1:
        experiment |= {"stopTime": repr(float(times[-1])), "stepSize": f"{np.diff(times).max():.12g}"}
    if scene.tolerance:
        experiment["tolerance"] = repr(scene.tolerance)
    ET.SubElement(root, "DefaultExperiment", dict(sorted(experiment.items())))
    listed = ET.SubElement(root, "ModelVariables")
    for number, variable in enumerate(variables):
        _add_variable(listed, variable, number, three)
    _add_structure(root, variables, three)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def _add_units(root: ET.Element, units: Iterable[str]) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in units:
        known = unit_of("export", unit)
        base = {name: str(power) for name, power in zip(BASES, known.powers, strict=True) if power}
        factor = {} if known.factor == 1 else {"factor": repr(known.factor)}
        ET.SubElement(ET.SubElement(definitions, "Unit", name=unit), "BaseUnit", base | factor)


def _add_variable(listed: ET.Element, variable: _Variable, number: int, three: bool) -> None:
    names = {"name": variable.name, "valueReference": str(number), "causality": variable.causality}
    names["variability"] = variable.variability
    if variable.initial:
        names["initial"] = variable.initial
    values = {} if variable.start is None else {"start": repr(variable.start)}
    if variable.unit:
        values["unit"] = variable.unit
    if variable.state is not None:
        values["derivative"] = str(variable.state if three else variable.state + 1)
    if three:
        ET.SubElement(listed, "Float64", names | values)
    else:
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", names), "Real", values)


def _add_structure(root: ET.Element, variables: list[_Variable], three: bool) -> None:
    """Add the numbers of outputs, of rates, and of variables that are calculated at the start. FMI 2 counts from 1."""
    numbers = range(len(variables))
    outputs = [k for k in numbers if variables[k].causality == "output"]
    rates = [k for k in numbers if variables[k].state is not None]
    unknown = sorted([*outputs, *rates, *(variables[k].state or 0 for k in rates)])
    indicators = [k for k in numbers if variables[k].name.startswith("switch[")]
    structure = ET.SubElement(root, "ModelStructure")
    parts = {"Output": outputs, "ContinuousStateDerivative": rates, "InitialUnknown": unknown}
    if three:
        for name, some in (parts | {"EventIndicator": indicators}).items():
            for k in some:
                ET.SubElement(structure, name, valueReference=str(k))
        return
    for name, some in zip(("Outputs", "Derivatives", "InitialUnknowns"), parts.values(), strict=True):
        group = ET.SubElement(structure, name) if some else None
        for k in some:
            ET.SubElement(group, "Unknown", index=str(k + 1))  # pyright: ignore[reportArgumentType]


def _add_files(files: ET.Element, tag: str) -> None:
    for name in BINARY_FILES:
        ET.SubElement(files, tag, name=name)


def build_description(identifier: str) -> bytes:
    """sources/buildDescription.xml of FMI 3."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    _add_files(ET.SubElement(build, "SourceFileSet", language="C11"), "SourceFile")
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)
