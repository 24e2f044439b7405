"""The C source of single runs of a scene, without symmb and CasADi. c/scene.h lists the functions of this source."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symmb._types import Array
from symmb.run.codegen.c_source import C_FOLDER, c_source
from symmb.run.codegen.engine import Lanes, StepTolerances
from symmb.run.codegen.failures import REASONS
from symmb.run.codegen.model_source import source_of
from symmb.run.schemes import MOST_STEPS


@dataclass(frozen=True, eq=False)
class SceneSource:
    """The data of a scene for a C program.

    Attributes
    ----------
    lanes : Lanes              equations and method. They contain the start, so that runs need no Python
    n_x : int                  number of states of the scene, which are the first states of the lanes
    nominal : (n_p,) array     nominal parameters, followed by inputs
    n_inputs : int             number of inputs
    names : tuple of str       names of parameters, inputs and outputs
    times : (n_t,) array       times of the scene [s]
    has_rates : bool           whether other programs may integrate the states
    stops : (k,) array         times at which steps end [s]
    token : str                a text that identifies this scene
    """

    lanes: Lanes
    n_x: int
    nominal: Array
    n_inputs: int
    names: tuple[str, ...]
    times: Array
    has_rates: bool
    stops: Array
    token: str

    @property
    def n_switches(self) -> int:
        """Number of switches of the state."""
        return len(self.lanes.ends.hysteresis)


def scene_source(scene: SceneSource) -> dict[str, str]:
    """Name -> text of the files scene.h and scene.c."""
    lanes = scene.lanes
    sizes = {
        "N_P": len(scene.nominal),
        "N_INPUTS": scene.n_inputs,
        "N_X": scene.n_x,
        "N_Y": lanes.f.numel_out("outputs"),
        "N_SWITCHES": scene.n_switches,
        "HAS_RATES": int(scene.has_rates),
        "N_T": len(scene.times),
        "TOKEN": quoted(scene.token),
    }
    header = (C_FOLDER / "scene.h").read_text(encoding="utf-8")
    for name, value in sizes.items():
        header = re.sub(rf"^(#define SCENE_{name}) \S+", lambda line, v=value: f"{line[1]} {v}", header, flags=re.M)
    control = (
        lanes.control if isinstance(lanes.control, StepTolerances) else StepTolerances(0.0, 0.0, lanes.control.longest)
    )
    numbers = {
        "RTOL": control.rtol,
        "ATOL_GROWTH": control.growth,
        "ATOL_AHEAD": control.ahead,
        "ATOL_LEAST": control.least,
        "LONGEST": control.longest,
        "NEWTON_CHANGE": lanes.scheme.newton if lanes.scheme else 0.0,
        "STEPS_AT_MOST": MOST_STEPS,
        "N_STOPS": len(scene.stops),
        "N_TIMES": lanes.f.numel_out("time_switches") // 2 if "time_switches" in lanes.f.name_out() else 0,
    }
    knots, n_knots = np.concatenate([np.empty(0), *lanes.knots]), [len(places) for places in lanes.knots]
    n_knots = [0] * (int(numbers["N_TIMES"]) - len(n_knots)) + n_knots
    numbers["STOPS_AT_MOST"] = len(scene.stops) + len(knots) + n_knots.count(0)
    atol = control.absolute(lanes.n_x)
    # A program does not know the names of contacts.
    reasons = (reason.replace("Impact {}", "an impact").replace("of {}", "of the scene") for reason in REASONS)
    faults = ["the start could not be computed", *(reason.replace(" {}", "") for reason in reasons)]
    source = [
        source_of(lanes.f, lanes.scheme, lanes.ends.hysteresis, lanes.contacts, "run", lanes.power).text,
        '#include "scene.h"',
        *(f"#define {name} {value!r}" for name, value in numbers.items()),
        f"PRIVATE const double absolute[] = {_list(atol)}, stops[] = {_list(scene.stops)}, knots[] = {_list(knots)};",
        f"PRIVATE const int n_knots[] = {{{', '.join(map(str, n_knots or [0]))}}};",
        f"PRIVATE const char *const faults[] = {_list(faults)};",
        f"const double scene_times[] = {_list(scene.times)}, scene_nominal[] = {_list([*scene.nominal, 0.0])};",
        f"const char *const scene_names[] = {_list([*scene.names, ''])};",
        c_source("one_run"),
    ]
    return {"scene.h": header, "scene.c": "\n".join(source) + "\n"}


def _list(values: Sequence[float] | Sequence[str] | Array) -> str:
    """Numbers or texts as an initialiser in C. An empty list becomes a single 0, because C has no empty arrays."""
    texts = [quoted(value) if isinstance(value, str) else repr(float(value)) for value in values]
    return f"{{{', '.join(texts or ['0.0'])}}}"


def quoted(text: str) -> str:
    """A text as a C string."""
    # Octal escapes end after three digits. Hexadecimal escapes could continue into the text. ?? begins a trigraph.
    plain = {*range(32, 127)} - {*b'"\\?'}
    return '"' + "".join(chr(byte) if byte in plain else f"\\{byte:03o}" for byte in text.encode()) + '"'
