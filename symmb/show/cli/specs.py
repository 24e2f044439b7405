"""Methods and solvers on the command line."""

from collections.abc import Sequence

from symmb._specs import Spec
from symmb.bound.bounds import METHODS, read_method
from symmb.run.integrate import SOLVERS, WORDS, Solver, read_solver

method = read_method


def solver(text: str | None) -> Solver | None:
    """The solver of a text; None if the option was not given."""
    return None if text is None else read_solver(text)


def table(title: str, specs: Sequence[Spec]) -> str:
    """A table for `--help`: the texts that select methods or solvers, and the meaning of each text."""
    width = max(len(spec.form) for spec in specs) + 2
    return "\n".join([f"{title}:", *(f"  {spec.form.ljust(width)}{spec.text}" for spec in specs)])


def solver_table() -> str:
    """The table of solvers, with the texts of their options."""
    return f"{table('solvers', SOLVERS)}\n  Words that may follow: {', '.join(WORDS)}; as in dopri:1e-8:projection."


def method_table() -> str:
    """The table of methods."""
    return table("methods", METHODS)
