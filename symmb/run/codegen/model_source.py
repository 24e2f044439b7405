"""The C source of an ensemble: the functions of the model, and the files for the steps."""

import functools
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import casadi as ca

from symmb.declare import symbolic
from symmb.declare.symbolic import Pieces, instructions
from symmb.run.codegen import cache
from symmb.run.codegen.c_source import c_source
from symmb.run.codegen.contacts import Contacts
from symmb.run.codegen.emit import LARGE_MODEL, Emitter
from symmb.run.codegen.failures import FailureCode
from symmb.run.codegen.graph import BOX, INPUT, Graph, graph_of
from symmb.run.codegen.tableau import PAIR_STAGES, explicit_stages, pair
from symmb.run.schemes import Tableau

Use = Literal["lanes", "run", "card"]
CACHED_STATES = 32
"""Largest number of states for which 16 slopes of 8 lanes fit into a first-level cache of 32 kB.
tests/benchmarks/ensemble.py"""


@dataclass(frozen=True)
class Scheme:
    """The data of an implicit scheme for the engine, see `scheme_function`.

    Attributes
    ----------
    n_w, n_z : int         sizes of the history and of the unknowns
    order : int            order of the scheme
    growth : float         largest ratio of a step to the previous step
    newton : float         Newton's method ends if the change of unknowns, relative to their sizes, is not larger
    """

    n_w: int
    n_z: int
    order: int
    growth: float
    newton: float


def model_function(
    x: ca.SX,
    p: ca.SX,
    t: ca.SX,
    rates: ca.SX,
    outputs: ca.SX,
    projected: ca.SX | None,
    start: tuple[ca.SX, ca.SX, ca.SX] | None = None,
    switches: ca.SX | None = None,
    contacts: Mapping[str, ca.SX] | None = None,
    ranged: ca.SX | None = None,
    times: ca.SX | None = None,
) -> ca.Function:
    """A function (x, p, t, box) -> rates, outputs, and further results if their expressions are given.

    Parameters
    ----------
    x, p, t : SX symbols                state (n_x,), parameters (n_p,), time [s]
    rates, outputs, projected : SX      x' (n_x,), outputs (n_y,), and x on the constraints or None
    start : unknowns u, the step of Newton's method for u, and x (n_x,) at the start as a function of u. If there is no
        start, the caller gives the states at the start
    switches : SX                       switches of the state, and their rates (2 m,). Their sides are the last of p
    ranged : SX                         expressions (m,). If given, their bounds replace the bounds of the switches
    times : SX                          values at time 0 and slopes of linear switches of time, for single runs
    contacts : mapping                  the functions of c/impacts.h
    """
    parts, box = {"rates": rates, **(contacts or {})}, ca.SX(0, 1)
    if switches is not None and switches.numel():
        parts["switches"] = switches
        box, parts["bounds"] = symbolic.ranges_along(
            switches[: switches.numel() // 2] if ranged is None else ranged, x, p, t
        )
    if projected is not None:
        parts["project"] = projected
    if times is not None:
        parts["time_switches"] = times
    return _function(parts | {"outputs": outputs}, x, p, t, box, start)


def scheme_function(
    w: ca.SX,
    z: ca.SX,
    p: ca.SX,
    t: ca.SX,
    h: ca.SX,
    *,
    history: ca.SX,
    guess: ca.SX,
    correct: ca.SX,
    follow: ca.SX,
    outputs: ca.SX,
    projected: ca.SX | None,
    start: tuple[ca.SX, ca.SX, ca.SX] | None = None,
) -> ca.Function:
    """A function ((w, h, z), p, t) -> the results that c/implicit_step.h needs.

    `projected` (unless it is None) and `start` give the state, which is the first part of w.
    """
    x = ca.vertcat(w, h, z)

    def whole(state: ca.SX) -> ca.SX:
        return ca.vertcat(state, x[state.numel() :])

    parts = {"history": history, "guess": guess, "correct": correct, "follow": follow}
    if projected is not None:
        parts["project"] = whole(projected)
    parts["outputs"] = outputs
    if start is not None:  # the step length and the unknowns are not known yet: they begin as 0
        start = (*start[:2], ca.vertcat(start[2], ca.SX(x.numel() - start[2].numel(), 1)))
    return _function(parts, x, p, t, ca.SX(0, 1), start)


def _function(
    parts: dict[str, ca.SX], x: ca.SX, p: ca.SX, t: ca.SX, box: ca.SX, start: tuple[ca.SX, ca.SX, ca.SX] | None
) -> ca.Function:
    """A function (x, p, t, box) -> parts. If a start is given, the parts newton and start are added."""
    # All functions have the same inputs. No function has both a box and unknowns, so that one input serves for both.
    if start is not None:
        u, *of_u = start
        box = ca.vertcat(box, ca.SX.sym("u", max(0, u.numel() - box.numel())))
        parts["newton"], parts["start"] = ca.substitute(of_u, [u], [box[: u.numel()]])
    inputs = {"x": x, "p": p, "t": t, "box": box}
    return ca.Function("f", [*inputs.values()], [ca.densify(e) for e in parts.values()], [*inputs], list(parts))


class Source(NamedTuple):
    """The C source of an ensemble, which can be compiled in three parts. Text after text, they are one source.

    The equations of motion are the same for one run and for a study. Outputs, the start, and the sizes and lists of a
    task are its own. The engine depends on few sizes of the model, so that many models share it. Lanes receive the
    numbers of the equations as data, so that models with other numbers share a library. In one source, `sizes` come
    first.
    """

    sizes: str
    equations: str
    task: str
    engine: str
    numbers: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """One source."""
        return self.sizes + self.equations + self.task + self.engine


def source_of(
    f: ca.Function,
    scheme: Scheme | Tableau | None,
    hysteresis: Sequence[float] = (),
    contacts: Contacts | None = None,
    use: Use = "lanes",
    power: bool | None = None,
) -> Source:
    """The C source of an ensemble of f. The source of a large model is cached, because its generation takes seconds.

    Parameters
    ----------
    f : ca.Function            from `model_function` or `scheme_function`
    scheme                     of a `scheme_function`, or an explicit method with fixed steps; None for an embedded pair
    hysteresis : (m,)          distance by which the value of each switch must pass 0, larger than its rounding error
    contacts : Contacts        contacts and joints; their gaps and margins are the last switches
    use                        "lanes": c/ensemble.h; "run": single runs of one lane by c/one_run.h; "card": c/kernel.h
    power                      whether the last state, which is the integral of the power, is integrated; None if there
                               is no such state
    """

    write = functools.partial(_ensemble_source, f, scheme, hysteresis, contacts, use, power)
    if f.n_instructions() < LARGE_MODEL:
        return write()
    described = f"{f} {(scheme, hysteresis, contacts, use, power)!r} {_generator()}".encode()
    key = hashlib.sha256(described + instructions(f).identity()).hexdigest()[:32]
    path = cache.find(key, ".c")
    if path is not None:
        first, equations, task, engine, numbers = path.read_text(encoding="utf-8").split("\f")
        return Source(first, equations, task, engine, tuple(map(float, numbers.split())))
    source = write()
    cache.keep(key, "\f".join([*source[:4], " ".join(map(repr, source.numbers))]).encode(), ".c")
    return source


@functools.cache
def _generator() -> str:
    """A hash of every file of the package, because many files determine a generated source."""
    files = sorted(path for path in Path(__file__).parents[2].rglob("*") if path.suffix in (".py", ".h"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def _explicit_steps(
    graph: Graph, nodes: dict[str, list[int]], tableau: Tableau | None, hysteresis: Sequence[float], idle: int
) -> tuple[list[int], dict[str, float], list[str]]:
    """Places of the states, sizes, and C code of the steps of an explicit method. `nodes` is reordered in place."""
    order, n_own = _state_order(graph, nodes["rates"])
    place, n_integrals = [order.index(i) for i in range(len(order))], len(order) - n_own
    nodes["rates"] = [nodes["rates"][i] for i in order[n_integrals:]]
    for name in nodes.keys() & {"project", "start", "held"}:
        nodes[name] = [nodes[name][i] for i in order if i < len(nodes[name])]
    if hysteresis:  # two functions, because most evaluations of switches need no rates
        both, m = nodes["switches"], len(hysteresis)
        nodes |= {"switches": both[:m], "changes": both[m:]}
    integrals = n_integrals > 0
    if tableau:
        n_k, steps = len(tableau.A), [explicit_stages(tableau, integrals), c_source("fixed_step")]
    else:
        n_k, steps = PAIR_STAGES, [pair(integrals), c_source("embedded_pair")]
    return place, {"N_OWN": n_own - idle, "N_K": n_k * (n_own - idle)}, steps


def _scheme_sizes(nodes: Mapping[str, list[int]], scheme: Scheme) -> dict[str, float]:
    n_w, n_z = scheme.n_w, scheme.n_z
    return {
        "N_OWN": 0,
        "N_W": n_w,
        "N_Z": n_z,
        "N_TESTED": len(nodes["correct"]) - n_z,
        "N_ERRORS": len(nodes["follow"]) - n_w,
        "N_K": max(len(nodes["follow"]), len(nodes["correct"])),
        "ORDER": scheme.order,
        "GROWTH": scheme.growth,
    }


def _ensemble_source(
    f: ca.Function,
    scheme: Scheme | Tableau | None,
    hysteresis: Sequence[float],
    contacts: Contacts | None,
    use: Use,
    power: bool | None,
) -> Source:
    """The C source of an ensemble: functions of the model, which compute nodes of a graph, and files for the steps."""
    graph, idle = graph_of(f), int(power is False)
    nodes = dict(zip(f.name_out(), graph.outputs, strict=True))
    if isinstance(scheme, Scheme):
        place, own_sizes, steps = list(range(f.numel_in(0))), _scheme_sizes(nodes, scheme), [c_source("implicit_step")]
    else:
        place, own_sizes, steps = _explicit_steps(graph, nodes, scheme, hysteresis, idle)
    is_started = "start" in nodes
    for name in ("newton", "start"):
        nodes.setdefault(name, [])
    of_task = {name: nodes.pop(name) for name in ("outputs", "newton", "start")}
    is_data, n_x = use == "lanes", len(place) - idle
    equations = Emitter(graph, place, is_data, guarded=() if power is None else ("rates", "project"))
    of_equations = equations.source(nodes, "prepare_equations")
    task = Emitter(graph, place, is_data, before=equations)
    of_both = of_equations, task.source(of_task, "prepare")
    lists = _state_lists(graph, nodes | of_task, place, n_x, bool(hysteresis) or use == "run")
    numbers = {"hysteresis": list(hysteresis)}
    sizes = {
        "PROJECTED": int("project" in nodes),
        "N_S": len(hysteresis),
        "N_G": 0,
        "N_I": 0,
        "N_E": 0,
        **({"WIDTH": 1} if use != "lanes" else {}),
    }
    if contacts is not None:
        sizes |= _sizes_of(contacts)
        own_sizes["N_WORK"] = int(contacts.with_work)
        lists |= {"contact_state": contacts.closed, **contacts.joints}
        numbers |= {"displacement": list(contacts.displacements), "scales": [contacts.length, contacts.energy]}
    others = [value for values in numbers.values() for value in values] if is_data else []
    data = {**equations.numbers, **task.numbers, **dict(enumerate(others, task.end))}
    lists["number_place"] = list(data)
    sizes_of_model = {
        "N_P": f.numel_in(1),
        "N_C": task.end,
        "N_OTHER": len(others),
        "N_NUMBERS": len(data),
        "N_CARRIED": max(equations.n_carried, task.n_carried),
        "N_Y": len(of_task["outputs"]),
        "N_USED": len(lists["used"]),
        "STARTED": int(is_started),
        "N_U": len(of_task["newton"]),
        "N_X": n_x,
        "N_BOX": len(place),
        "N_RANGED": len(lists["ranged"]),
        **own_sizes,
    }
    of_run = {"WORK": task.end + len(others), "POWER": int(bool(power))}
    known = {f"{name.lower()}_of_model": value for name, value in sizes_of_model.items()}
    run = {f"{name.lower()}_of_run": value for name, value in of_run.items()}
    scalar, ends = {"lanes": ([], ["ensemble"]), "run": ([], []), "card": (["scalar"], ["kernel"])}[use]
    before = ["#define APART"] if use == "lanes" else []
    before += [*_defined(sizes), f"enum {{ {', '.join(FailureCode.__members__)} }};", c_source(*scalar, "lanes")]
    # The engine finds sizes and lists in the object file of the first part of the task.
    constants = [f"DATA const {_kind(value)} {name} = {value!r};" for name, value in {**known, **run}.items()]
    constants = ["#ifdef PART", *constants, "#endif"]
    constants += [_constants("int", name, v or [0]) for name, v in lists.items()]
    if use == "lanes":  # lanes share the data of pieces with Python. Other programs do not have these data
        pieces = [f"extern const double *{name};" for name in graph.pieces]
        constants += [f"const double *{name}; /* set when the library is opened */" for name in graph.pieces]
    else:
        pieces = [_data(name, own) for name, own in graph.pieces.items()]
        constants += [_constants("double", name, v or [0.0]) for name, v in numbers.items()]
    run_names = [f"extern MODEL const int {name};" for name in run] + _defined(dict(zip(of_run, run, strict=True)))
    head, declared = [*before, *run_names, *pieces], "MODEL void prepare_equations(const V *restrict, V *);"
    texts = [_part(equations, of_both[0], head, []), _part(task, of_both[1], [*head, declared], constants)]
    is_large = any(large for _, _, large in of_both)
    first = [*_defined({"LARGE": int(is_large), **sizes_of_model, **of_run}), *before, *pieces, ""]
    engine = ["#ifdef PART", *_defined(dict(zip(sizes_of_model, known, strict=True))), *before]
    engine += [f"extern MODEL const {_kind(value)} {name};" for name, value in known.items()]
    engine += [f"extern MODEL const int {name}[];" for name in sorted(lists)]
    engine += [f"MODEL void {name}(const V *restrict, V *, V, V *restrict);" for name in sorted(nodes | of_task)]
    engine += ["MODEL void prepare(const V *restrict, V *);", "#endif"]
    engine += [c_source("block", "projection", "switches", "impacts"), *steps, c_source("begin", *ends)]
    return Source("\n".join(first), texts[0], texts[1], "\n".join(engine) + "\n", tuple(data.values()))


def _part(emitter: Emitter, code: tuple[list[str], str, bool], head: Sequence[str], own: Sequence[str]) -> str:
    """The text of equations or of a task: a head for its own object file, the code of its emitter, and own data."""
    parts, functions, is_large = code
    text = ["#ifdef PART", *_defined({"N_PARTS": len(parts), "LARGE": int(is_large)}), *head, "#endif"]
    text += ["#undef NUMBERS", f"#define NUMBERS {emitter.numbers_at}"]
    text += [f"{_only_in(k)}\n{part}\n#endif" for k, part in enumerate(parts)]
    return "\n".join([*text, _only_in(0), *own, functions, "#endif\n"])


def _kind(number: float) -> str:
    return "int" if isinstance(number, int) else "double"


def _defined(sizes: Mapping[str, object]) -> list[str]:
    return [f"#define {name} {value}" for name, value in sizes.items()]


def _state_lists(
    graph: Graph, nodes: Mapping[str, list[int]], place: list[int], n_x: int, ends_anywhere: bool
) -> dict[str, Sequence[int]]:
    """Places of all states, of the states that are interpolated, and of the states on which bounds depend."""
    explicit = "rates" in nodes
    # Outputs need only a few states. If steps can end anywhere, all states are interpolated.
    of_outputs = range(n_x) if ends_anywhere else sorted(place[i] for i in graph.inputs(nodes["outputs"], 0))
    used = list(of_outputs) if explicit else []
    box = graph.inputs(nodes.get("bounds", ()), BOX)
    n_box = len(place)
    return {"place": place[:n_x], "used": used, "ranged": sorted({i % n_box for i in box if i < 4 * n_box})}


def _sizes_of(contacts: Contacts) -> dict[str, float]:
    """Sizes for c/impacts.h: numbers of gaps, states and rows, and the scales of impulses."""
    return {
        "N_G": len(contacts.names),
        "N_Q": contacts.n_q,
        "N_V": contacts.n_v,
        "WIDTH": 1,
        "N_E": len(contacts.joints.get("opens", ())),
        "N_PLACE": len(contacts.joints.get("place_state", ())),
        "N_OTHERS": len(contacts.joints.get("other_state", ())),
        "N_I": len(contacts.closed),
        "N_ROWS": contacts.n_rows,
    }


def _constants(kind: str, name: str, values: Iterable[float]) -> str:
    return f"DATA const {kind} {name}[] = {{{', '.join(map(repr, values))}}};"


def _data(name: str, pieces: Pieces) -> str:
    """The definition of pieces in C, with their data."""
    return f"{_constants('double', f'{name}_data', pieces.data.ravel().tolist())}\n#define {name} {name}_data"


def _only_in(part: int) -> str:
    """The line before the C code of one part, if a model is compiled in parts."""
    return f"#if !defined(PART) || PART == {part}"


def _state_order(graph: Graph, rates: list[int]) -> tuple[list[int], int]:
    """States in the order of `tableau`, and the number of states with slopes of their own."""
    # Fewer slopes need longer sums, which is faster only if the slopes do not fit into the first-level cache.
    if len(rates) <= CACHED_STATES:
        return list(range(len(rates))), len(rates)
    integral: dict[int, int] = {}
    for i, k in enumerate(rates):
        source, index = graph.data[k] if graph.operations[k] == INPUT else (-1, -1)
        if source == 0 and index not in integral and i not in integral:
            integral[index] = i
    integral = {v: x for v, x in integral.items() if v not in integral.values()}
    own = [*integral, *(i for i in range(len(rates)) if i not in integral and i not in integral.values())]
    return [*integral.values(), *own], len(own)
