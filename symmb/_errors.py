"""The errors a user meets, one for each stage that can fail, and the warning."""

import warnings
from collections.abc import Sequence

LONGEST_TEXT = 1500
"""Most characters of an error: names and lists of names that users give may have any length."""


class SymmbError(Exception):
    """Root of all errors raised on purpose by symmb."""

    def __init__(self, *args: object) -> None:
        super().__init__(*(_shortened(each) if isinstance(each, str) else each for each in args))


class DeclarationError(SymmbError, ValueError):
    """A scene, a system or an option is declared wrongly; the text names the fault and the remedy."""


class NoParameterError(DeclarationError, KeyError):
    """A name of a parameter that there is not. Mappings ask for a KeyError."""

    __str__ = Exception.__str__


class FileError(SymmbError, OSError):
    """A file or a folder cannot be read, made or written; the text names it."""


class MissingFileError(FileError, FileNotFoundError):
    """A file, or the folder that it belongs into, is not there."""


class AssemblyError(SymmbError, ValueError):
    """The start does not satisfy the constraints, or the constraints are redundant there."""


class SimulationError(SymmbError, RuntimeError):
    """A run broke down; the text names time and parameter values."""


class PropagationError(SymmbError, ValueError):
    """A method asks for something that the simulator at hand cannot give."""


class SymmbWarning(UserWarning):
    """Something that the user should know about a result, or about how it is computed."""


def _shortened(text: str) -> str:
    """A text whose middle is left out if it is long."""
    half = LONGEST_TEXT // 2
    return text if len(text) <= LONGEST_TEXT else f"{text[:half]} ... {text[-half:]}"


def text_of(error: BaseException) -> str:
    """Kind and text of an exception of the user's code in one line. The text of some cannot be made."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = ""
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def warn_of(doubts: Sequence[str], subject: str) -> None:
    """One SymmbWarning about what is doubtful in a result, at the user's line that called the caller."""
    if doubts:
        warnings.warn(f"{subject}: {' '.join(doubts)}", SymmbWarning, stacklevel=3)
