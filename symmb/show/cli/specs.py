"""Methods and solvers on the command line."""

import inspect
from collections.abc import Sequence

from symmb._errors import DeclarationError
from symmb._specs import Spec
from symmb.bound.methods import METHODS, Method, method_of, read_method
from symmb.run.integrate import SOLVERS, WORDS, Solver, read_solver
from symmb.show.cli.scene_file import value_in_module


def method(text: str) -> Method:
    """The method of a text, such as "pce:4", or "module:Name" for a class or an object in a module of the user."""
    module, colon, name = text.partition(":")
    if module in {entry.word for entry in METHODS} or not colon:
        return read_method(text)
    if not name.isidentifier() or not all(part.isidentifier() for part in module.split(".")):
        try:
            return read_method(text)
        except DeclarationError as error:
            own = "A method of your own is MODULE:NAME, for a class or an object in MODULE.py."
            raise DeclarationError(f"{error} {own}") from error
    found = value_in_module(module, name, Method)
    if isinstance(found, type) and issubclass(found, Method):
        if inspect.isabstract(found):
            raise DeclarationError(f"{text}: the class must define the function bounds(self, runs).")
        try:
            found = found()
        except TypeError as error:
            raise DeclarationError(
                f"{text}: the class cannot be called without arguments ({error}). Name an object of the class, such as "
                f"mine = {name}(...) in {module}.py by {module}:mine."
            ) from error
    return method_of(text, found)


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
    own = "  MODULE:NAME".ljust(max(len(spec.form) for spec in METHODS) + 4)
    return f"{table('methods', METHODS)}\n{own}a method of your own, a subclass of mb.Method"
