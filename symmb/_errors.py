"""The errors that users see, one class for each stage that can fail, and the warning."""

import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

LONGEST_TEXT = 1500
"""Maximum number of characters in the text of an error. Names from users may have any length."""


class SymmbError(Exception):
    """Base class of all errors that symmb raises on purpose.

    Examples
    --------
    >>> import symmb as mb
    >>> try:
    ...     mb.Box(k=(2.0, 1.0))
    ... except mb.SymmbError as error:
    ...     print(type(error).__name__)
    DeclarationError
    """

    def __init__(self, *args: object) -> None:
        super().__init__(*(_shortened(each) if isinstance(each, str) else each for each in args))


class DeclarationError(SymmbError, ValueError):
    """A scene, a system or an option is declared wrongly. The text of the error states the fault and the remedy.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Box(k=(2.0, 1.0))
    Traceback (most recent call last):
        ...
    symmb._errors.DeclarationError: Box: 'k' has lower 2.0 above upper 1.0. Exchange them.
    """


class Faults(list[str]):
    """Faults of a declaration as sentences. One DeclarationError reports all faults."""

    @contextmanager
    def noted(self) -> Iterator[None]:
        """A context that notes a DeclarationError and continues, so that later faults are found too."""
        try:
            yield
        except DeclarationError as error:
            self.extend(str(error).split("\n"))

    def raise_any(self) -> None:
        """Raise a DeclarationError with one line for each distinct fault, if there are faults."""
        if self:
            raise DeclarationError("\n".join(dict.fromkeys(self)))


@contextmanager
def faults_of(owner: str, end: str = "") -> Iterator[None]:
    """A context that puts the name of the owner before the text of a DeclarationError, and `end` after it."""
    try:
        yield
    except DeclarationError as error:
        raise DeclarationError(f"{owner}: {error}{end}") from None


class NoParameterError(DeclarationError, KeyError):
    """A parameter with this name does not exist. This error is also a KeyError, because mappings raise a KeyError."""

    __str__ = Exception.__str__


class NoHandleError(DeclarationError, AttributeError):
    """A coordinate or rate with this name does not exist. This error is also an AttributeError, for `hasattr`."""


class FileError(SymmbError, OSError):
    """A file or a folder cannot be read, made or written. The text of the error names the file or the folder."""


class MissingFileError(FileError, FileNotFoundError):
    """A file, or the folder for a file, does not exist."""


class AssemblyError(SymmbError, ValueError):
    """The start values violate the constraints, or the constraints are redundant at the start.

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> rod = mb.Distance("rod", mb.Ground().point(0, 0), bob.point(0, 0), 1.0)
    >>> try:
    ...     mb.simulate(mb.Scene(mb.System(bob, rod), {"bob.x": 0.0, "bob.y": 3.0, "bob.z": 0.0}))
    ... except mb.AssemblyError:
    ...     print("the rod of 1 m does not reach as far")
    the rod of 1 m does not reach as far
    """


class SimulationError(SymmbError, RuntimeError):
    """A run failed. The text of the error names the time and the parameter values.

    Examples
    --------
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> push = mb.Force("push", bob.point(0, 0), (bob.x**2, 0))
    >>> try:
    ...     mb.simulate(mb.Scene(mb.System(bob, push), {"bob.x": 10.0}, [0.0, 10.0]), mb.CVODES())
    ... except mb.SimulationError:
    ...     print("x goes to infinity within 10 s")
    x goes to infinity within 10 s
    """


class PropagationError(SymmbError, ValueError):
    """A method needs something that the simulator does not provide.

    Examples
    --------
    >>> import symmb as mb
    >>> square = mb.FunctionSimulator(lambda a: [[a**2]], {"a": 1.0}, [0.0], ["y"])
    >>> try:
    ...     mb.propagate(square, mb.PolynomialChaos(budget=2), mb.Box(a=(0.0, 2.0)))
    ... except mb.PropagationError as error:
    ...     print(error)
    PolynomialChaos(budget=2): the first level takes 5 runs, more than the budget of 2.
    """


class SymmbWarning(UserWarning):
    """Important information about a result, or about its computation.

    Examples
    --------
    >>> import warnings
    >>> import symmb as mb
    >>> bob = mb.Body("bob", 1.0, pose=mb.Particle())
    >>> spring = mb.Spring("spring", mb.Ground().point(0, 0), bob.point(0, 0), 4.0)
    >>> scene = mb.Scene(mb.System(bob, spring), {"bob.x": 1.0}, [0.0, 1.0, 2.0])
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always", mb.SymmbWarning)
    ...     run = mb.simulate(scene, mb.Newmark(step=0.5))
    >>> len(caught), len(run.warnings)
    (1, 1)
    """


class _Doubted(Protocol):
    @property
    def doubts(self) -> tuple[str, ...]: ...


class WithWarnings:
    """A result with warnings. `doubts` is an older name of `warnings`."""

    @property
    def warnings(self: _Doubted) -> tuple[str, ...]:
        """Sentences that say what is uncertain. `doubts` is another name of this property."""
        return self.doubts


def _shortened(text: str) -> str:
    """The text, without its middle if it is too long."""
    half = LONGEST_TEXT // 2
    return text if len(text) <= LONGEST_TEXT else f"{text[:half]} ... {text[-half:]}"


def text_of(error: BaseException) -> str:
    """Type and text of an exception of the user's code, in one line. Some exceptions have no text."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = ""
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def warn_of(doubts: Sequence[str], subject: str) -> None:
    """Issue one SymmbWarning about what is uncertain in a result, at the line of the user's code that made the call."""
    if doubts:
        level, frame = 1, sys._getframe()
        while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _NO_USER:
            level, frame = level + 1, frame.f_back
        warnings.warn(f"{subject}: {' '.join(doubts)}", SymmbWarning, stacklevel=level)


_NO_USER = {__name__.partition(".")[0], "contextlib"}
"""Packages whose lines are not the user's. Functions of `contextlib` call decorated functions."""
