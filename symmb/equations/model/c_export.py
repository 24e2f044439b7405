"""C source of a model's Functions, with a header that explains them and a main program that uses them.

The files need only a C compiler, not symmb or CasADi.
"""

import math
import os
from collections.abc import Iterable, Mapping, Sequence, Sized
from pathlib import Path
from string import Template
from typing import Any

import casadi as ca

from symmb._cleanup import real_path, temporary_folder
from symmb._errors import DeclarationError
from symmb._options import shown
from symmb.results.files import replacement, told

_EXAMPLE = Path(__file__).with_name("example.c.in")
"""Template of the main program, with placeholders for names and numbers."""


def save_c(
    functions: Mapping[str, ca.Function], folder: str | Path, *, name: str = "model", example: str | None = None
) -> tuple[Path, ...]:
    """Write `<name>.c` and `<name>.h`, and `main.c` if its text is given. Existing files are replaced.

    The names of the C functions are `<name>_<key>`, because a function `gamma` would clash with math.h.
    """
    if not (name.isidentifier() and name.isascii()):
        raise DeclarationError(f"name='{name}' is not a C identifier. Use letters, digits and underscores.")
    if not functions:
        raise DeclarationError("The mapping of Functions is empty. Pass at least one Function.")
    if not isinstance(folder, str | os.PathLike) or "\0" in str(folder):
        raise DeclarationError(f"The name of a folder must be a text or a Path, got {shown(folder)}.")
    with told(folder, "made"):
        folder = real_path(folder)
        folder.mkdir(parents=True, exist_ok=True)
    renamed = [_renamed(f, f"{name}_{key}") for key, f in functions.items()]
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": True})
    for f in renamed:
        generator.add(f)
    with temporary_folder() as generated:
        source = Path(generator.generate(f"{generated}{os.sep}")).read_text(encoding="utf-8")
        prototypes = Path(generated, f"{name}.h").read_text(encoding="utf-8")
    guard, comments = f"{name.upper()}_H", "\n".join(map(_comment, renamed))
    header = f"#ifndef {guard}\n#define {guard}\n\n{_HEADER}\n{comments}\n{prototypes}\n#endif\n"
    texts = {f"{name}.c": source, f"{name}.h": header}
    if example is not None:
        texts["main.c"] = example
    for file_name, text in texts.items():
        with replacement(folder / file_name) as file:
            file.write(text.encode())
    return tuple(folder / file_name for file_name in texts)


def example_c(
    rhs: ca.Function,
    *,
    q: Sequence[float],
    v: Sequence[float],
    s: Sequence[float] = (),
    parameters: Mapping[str, float],
    coordinates: Sequence[str],
    t0: float,
    t1: float,
    steps: int,
    name: str = "model",
) -> str:
    """Text of a `main.c` that integrates the model and prints time and coordinates, step by step.

    The method is the classical Runge-Kutta method of order 4 with a fixed step. States are not projected onto the
    constraints: the violation depends on the step size. `rhs` is (q, v, p, t) -> (qdot, vdot), or (q, v, s, p, t) ->
    (qdot, vdot, sdot), and its key is "rhs". `parameters` are in the order of p. `coordinates` are the headings of the
    columns.
    """
    _require_start(rhs, {"q": q, "v": v, "s": s, "p": parameters, "t": (t0,)}, coordinates)
    if steps < 1 or not all(map(math.isfinite, [*q, *v, *s, *parameters.values(), t0, t1])):
        raise DeclarationError("The example needs at least one step and finite start values, parameters and times.")
    labels = [*coordinates, *(f"v[{i}]" for i in range(len(v))), *(f"s[{i}]" for i in range(len(s)))]
    begins = ["", " + N_Q", " + N_Q + N_V"][: rhs.n_in() - 2]
    return Template(_EXAMPLE.read_text(encoding="utf-8")).substitute(
        name=name,
        n_q=len(q),
        n_v=len(v),
        n_s=len(s),
        steps=steps,
        t0=float(t0),
        t1=float(t1),
        start=_numbers(zip(labels, [*q, *v, *s], strict=True)),
        parameters=_numbers(parameters.items()),
        heads=", ".join(map(_quoted, coordinates)),
        arguments=", ".join([*(f"x{begin}" for begin in begins), "P", "&t"]),
        results=", ".join(f"rates{begin}" for begin in begins),
        blocks=len(begins),
        sz_arg=rhs.sz_arg(),
        sz_res=rhs.sz_res(),
        sz_iw=rhs.sz_iw() or 1,
        sz_w=rhs.sz_w() or 1,
    )


def _require_start(rhs: ca.Function, start: Mapping[str, Sized], coordinates: Sequence[str]) -> None:
    """Raise DeclarationError unless the start has the sizes of the inputs of rhs."""
    has_states = rhs.n_in() != 4
    sizes = {key: len(values) for key, values in start.items() if has_states or key != "s"}
    expected = {key: rhs.nnz_in(i) for i, key in enumerate(sizes)}
    n_q, n_s = len(start["q"]), len(start["s"])
    if sizes != expected or len(coordinates) != n_q or (n_s and not has_states):
        raise DeclarationError(
            f"The start does not fit rhs, which needs values of these lengths: {expected}. "
            f"The start has the lengths {sizes}, values of {n_s} states s, and names of {len(coordinates)} coordinates."
        )


def _renamed(f: ca.Function, name: str) -> ca.Function:
    inputs: Any = f.sx_in() if f.is_a("SXFunction") else f.mx_in()
    return ca.Function(name, inputs, f.call(inputs, True, False), f.name_in(), f.name_out())


def _comment(f: ca.Function) -> str:
    lines = [f"{f.name()}({', '.join(f.name_in())}) -> ({', '.join(f.name_out())})"]
    lines += [f"  arg[{i}]  {_layout(f.name_in(i), f.sparsity_in(i))}" for i in range(f.n_in())]
    lines += [f"  res[{i}]  {_layout(f.name_out(i), f.sparsity_out(i))}" for i in range(f.n_out())]
    return "/* " + "\n * ".join(lines) + "\n */"


def _layout(name: str, pattern: ca.Sparsity) -> str:
    size = f"{name:<8} {pattern.size1()} x {pattern.size2()}"
    if pattern.is_dense():
        return size
    entries = " ".join(f"({row},{column})" for row, column in zip(*pattern.get_triplet(), strict=True))
    return f"{size}, stored: {entries or 'none'}"


def _numbers(labelled: Iterable[tuple[str, float]]) -> str:
    """The numbers of a C array, one per line with a label. An empty array gets a zero, which C requires."""
    labelled = [(label.replace("*/", "* /"), value) for label, value in labelled]
    return "\n".join(f"    {float(value)!r}, /* {label} */" for label, value in labelled) or "    0.0"


def _quoted(text: str) -> str:
    """A text as a C string."""
    return '"' + text.replace("\\", r"\\").replace('"', r"\"") + '"'


_HEADER = """\
/* All functions are called in the same way:
 *
 *     int flag = f(arg, res, iw, w, mem);                flag is 0 if all went well
 *
 * arg[i] points to the numbers of input i. res[i] points to the memory for output i, or is 0 if output i is not needed.
 * Matrices are stored column by column. If entries of a matrix are listed below, only these are stored, in this
 * order. (row, column) are counted from 0. f_sparsity_out(i) returns the same pattern in compressed columns:
 * {rows, columns, start of each column..., total, row of each nonzero...}, or {rows, columns, 1} if all
 * entries are stored. f_work returns the lengths of arg, res, iw and w. Get mem from f_checkout() and release
 * it with f_release(mem).
 */
"""
