"""Input files and arguments of programs, with the names of parameters in braces."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from symmb._errors import DeclarationError
from symmb._options import shown

_LONGEST = 255
"""Bytes of the name of a file."""


def filled(template: str, values: Mapping[str, float]) -> str:
    """The text with `{name}` and `{name:format}` replaced for the names of values. Other braces stay.

    Without a format all digits of a number are written.

    Examples
    --------
    >>> filled("k = {k}; c = {c:.1f}; /* {comment} */", {"k": 0.1, "c": 2})
    'k = 0.1; c = 2.0; /* {comment} */'
    """

    def text(match: re.Match[str]) -> str:
        name, form = match.groups()
        return repr(float(values[name])) if form is None else format(float(values[name]), form)

    return re.sub(rf"\{{({_names(values)})(?::([^{{}}]*))?\}}", text, template)


def template_faults(template: str, values: Mapping[str, float]) -> Iterator[str]:
    """Faults of the formats in a template."""
    for name, form in re.findall(rf"\{{({_names(values)}):([^{{}}]*)\}}", template):
        try:
            format(float(values[name]), form)
        except (ValueError, MemoryError) as error:
            yield f"{{{name}:{form}}} is no format of a number ({error}). Use one such as {{{name}:.6e}}"


def is_filled(template: str, name: str) -> bool:
    """Whether a parameter stands in a template."""
    return re.search(rf"\{{{re.escape(name)}(:[^{{}}]*)?\}}", template) is not None


def template_texts(owner: str, templates: Mapping[str, str | Path]) -> dict[str, str]:
    """Texts by the path of the file in the folder of a run. A Path is a file that is read now.

    Raises
    ------
    DeclarationError        if a path leaves the folder, or a file cannot be read
    """
    if not isinstance(templates, Mapping):
        raise DeclarationError(
            f"{owner}: templates must be texts or paths by the name of the file, got {shown(templates)}."
        )
    texts = {}
    for name, template in templates.items():
        if not isinstance(name, str) or not is_inside(name):
            raise DeclarationError(f"{owner}: template {name!r}: the file must be inside the folder of the run.")
        if isinstance(template, Path):
            try:
                template = template.read_bytes().decode()  # with its line ends
            except (OSError, UnicodeDecodeError) as error:
                raise DeclarationError(f"{owner}: template {name!r}: {template} cannot be read: {error}.") from None
        if not isinstance(template, str) or not is_text(template):
            raise DeclarationError(f"{owner}: template {name!r}: expected a text or a Path, got {shown(template)}.")
        texts[name] = template
    return texts


def is_inside(name: str) -> bool:
    """Whether the path of a file lies inside the folder to which it is relative."""
    place = PurePosixPath(name)
    parts = [part.encode(errors="replace") for part in place.parts]
    return (
        0 < max(map(len, parts), default=0) <= _LONGEST
        and not place.is_absolute()
        and ".." not in place.parts
        and is_text(name)
    )


def is_text(text: str) -> bool:
    """Whether a text can be written into a file and handed to the system."""
    return "\0" not in text and text.encode(errors="ignore").decode() == text


def _names(values: Mapping[str, float]) -> str:
    return "|".join(map(re.escape, sorted(values, key=len, reverse=True)))
