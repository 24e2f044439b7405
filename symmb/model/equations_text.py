"""The equations of a small system as lines of text."""

from collections.abc import Iterator

import casadi as ca

from symmb.model.system import System

_MOST = 12
"""Coordinates up to which the equations are printed. For larger systems the summary alone is printed."""
_LONGEST = 500
"""Most characters of an entry that is printed: longer ones cannot be read."""


def equations_text(system: System, latex: str = "--latex") -> str:
    """M, Q, Phi, Psi and gamma entry by entry, by the names of velocities and rows; empty without a body.

    What is too long refers to `latex`, the way to the equations in LaTeX.
    """
    n_q = system.q.numel()
    if n_q > _MOST:
        return f"The equations of {n_q} coordinates are not printed here: use {latex}."
    velocities, rows = system.collected.v_names, system.collected.row_names
    n_c = system.Phi.numel()
    vectors = (
        ("Q", system.Q, velocities),
        ("Phi", system.Phi, rows[:n_c]),
        ("Psi", system.Psi, rows[n_c:]),
        ("gamma", system.gamma, rows),
    )
    groups = [list(_matrix("M", system.M, velocities, latex)), *(list(_vector(*vector, latex)) for vector in vectors)]
    return "\n\n".join("\n".join(group) for group in groups if group)


def _matrix(name: str, A: ca.SX, names: tuple[str, ...], latex: str) -> Iterator[str]:
    """The upper triangle of a symmetric matrix, zeros left out."""
    A = ca.sparsify(ca.triu(A))
    for i, j in sorted(zip(*A.sparsity().get_triplet(), strict=True)):
        yield f"{name}[{names[i]}, {names[j]}] = {_entry(A[i, j], latex)}"


def _vector(name: str, a: ca.SX, names: tuple[str, ...], latex: str) -> Iterator[str]:
    for row, entry in zip(names, ca.vertsplit(a), strict=True):
        yield f"{name}[{row}] = {_entry(entry, latex)}"


def _entry(expression: ca.SX, latex: str) -> str:
    text = str(expression)
    return text if len(text) <= _LONGEST else f"... ({len(text)} characters: use {latex})"
