"""The equations of a small system as lines of text."""

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
    M = ca.sparsify(ca.triu(system.M))  # zeros are left out
    pairs = sorted(zip(*M.sparsity().get_triplet(), strict=True))
    groups = [[f"M[{velocities[i]}, {velocities[j]}] = {_entry(M[i, j], latex)}" for i, j in pairs]]
    for name, vector, names in vectors:
        entries = zip(names, ca.vertsplit(vector), strict=True)
        groups.append([f"{name}[{row}] = {_entry(entry, latex)}" for row, entry in entries])
    return "\n\n".join("\n".join(group) for group in groups if group)


def _entry(expression: ca.SX, latex: str) -> str:
    text = str(expression)
    return text if len(text) <= _LONGEST else f"... ({len(text)} characters: use {latex})"
