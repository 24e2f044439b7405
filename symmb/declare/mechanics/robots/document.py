"""XML elements with the lines on which they stand. Entities are refused: they can make a small file a huge one."""

import math
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from xml.parsers import expat

from symmb._errors import DeclarationError
from symmb._magnitudes import LARGEST
from symmb._names import name_fault

_CLOSE = 0.75
"""Similarity from which an unknown name is a misspelt one. Less similar names are those of extensions."""

_NOT_IN_NAMES = ".[] "


@dataclass(eq=False)
class Tag:
    """An element of an XML file: its name, its attributes, the elements in it, and its line."""

    name: str
    attributes: dict[str, str]
    file: str
    line: int
    inside: list["Tag"] = field(default_factory=list)
    parent: "Tag | None" = None
    passed: dict[str, list["Tag"]] | None = None
    """Places of what does not matter in the file, by what it is; None if the file is read strictly."""

    @property
    def title(self) -> str:
        """The element with its own name, or with that of the element around it that has one."""
        own = self.attributes.get("name", "").strip()
        if own:
            return f"<{self.name} name={own!r}>"
        above = self.parent
        while above is not None and not above.attributes.get("name", "").strip():
            above = above.parent
        return f"<{self.name}>" + (f" of {above.title}" if above is not None and above.parent is not None else "")

    def fault(self, text: str) -> DeclarationError:
        """An error that names the file, the line and the element."""
        return DeclarationError(f"{self.file}, line {self.line}, {self.title}: {text}")

    def pass_over(self, what: str, fault: DeclarationError) -> None:
        """Note what does not matter. Its fault is raised if the file is read strictly."""
        if self.passed is None:
            raise fault
        self.passed.setdefault(what, []).append(self)

    def all(self, name: str) -> Iterator["Tag"]:
        """The elements of that name right inside."""
        return (tag for tag in self.inside if tag.name == name)

    def one(self, name: str) -> "Tag | None":
        """The only element of that name right inside, None if there is none."""
        found = [*self.all(name)]
        if len(found) > 1:
            raise found[1].fault(f"this is the second <{name}>, where one is allowed; remove one of them.")
        return found[0] if found else None

    def needed(self, name: str) -> "Tag":
        """The element of that name right inside, which must be there."""
        found = self.one(name)
        if found is None:
            raise self.fault(f"it has no <{name}>; add one.")
        return found

    def text(self, attribute: str) -> str:
        """An attribute, which must be there and hold a text."""
        value = self.attributes.get(attribute)
        if value is None:
            raise self.fault(f"it has no attribute {attribute!r}; add {attribute}='...'.")
        if not value.strip():
            raise self.fault(f"the attribute {attribute!r} is empty; give it a value.")
        return value.strip()

    def own_name(self) -> str:
        """The attribute `name`, as a name that symmb allows."""
        name = self.text("name")
        fault = name_fault(name, without=_NOT_IN_NAMES)
        if fault:
            error = self.fault(f"the name {name!r} cannot be used, as {fault.rstrip('.')}; rename it.")
            if name_fault(self.reference("name")):
                raise error
            self.pass_over("dots, brackets and spaces in names, which are _ now", error)
        return self.reference("name")

    def reference(self, attribute: str) -> str:
        """The name in an attribute, as `own_name` has it."""
        return re.sub(f"[{re.escape(_NOT_IN_NAMES)}]", "_", self.text(attribute))

    def numbers(self, attribute: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """The numbers of an attribute, as many as the default has, which stands for an attribute that is not there."""
        if attribute not in self.attributes:
            return default
        text, values, count = self.attributes[attribute], [], len(default)
        for word in text.split():
            try:
                values.append(float(word if "_" not in word else ""))  # Python takes 1_0 for 10
            except ValueError:
                hint = "; run the file through xacro first" if "$" in word else ""
                raise self.fault(f"{attribute}={text!r} holds {word!r}, which is no number{hint}.") from None
        if len(values) != count:
            expected = "one number" if count == 1 else f"{count} numbers"
            raise self.fault(f"{attribute}={text!r} holds {len(values)} numbers, where {expected} must stand.")
        if not all(map(math.isfinite, values)):
            raise self.fault(f"{attribute}={text!r} is not finite; give a number that is.")
        if self.name != "limit" and max(map(abs, values)) > LARGEST:  # limits may be as good as infinite
            raise self.fault(f"{attribute}={text!r} is beyond {LARGEST:g}; give it in SI units.")
        return tuple(values)

    def number(self, attribute: str, default: float | None = None) -> float:
        """The number of an attribute, which must be there if there is no default."""
        if default is None:
            self.text(attribute)
        return self.numbers(attribute, (default or 0.0,))[0]

    def not_negative(self, attribute: str, default: float | None = None, what: str = "") -> float:
        """The number of an attribute, which must be 0 or more."""
        value = self.number(attribute, default)
        if value < 0:
            raise self.fault(f"{what or attribute} {value:g} is negative; give 0 or more.")
        return value

    def check(self, elements: Collection[str], attributes: Collection[str]) -> None:
        """Raise if the name of an element inside, or of an attribute, is nearly one of those that are known.

        Other unknown names are those of extensions, which have no meaning here.
        """
        for tag in self.inside:
            if tag.name.startswith("xacro:"):
                raise tag.fault("xacro has not expanded this file; run it through the program xacro first.")
            meant = "" if ":" in tag.name else _meant(tag.name, elements)
            if meant:
                raise tag.fault(f"this element is not known; did you mean <{meant}>?")
        for name in self.attributes:
            meant = _meant(name, attributes)
            if meant:
                error = self.fault(f"the attribute {name!r} is not known; did you mean {meant!r}?")
                if meant not in self.attributes:
                    raise error
                self.pass_over(f"the attribute {name!r} of <{self.name}>", error)

    def check_exactly(self, attributes: Collection[str], *, others_matter: bool = False) -> None:
        """Raise or pass over if there is an attribute that is not known and has no prefix, which extensions have."""
        self.check((), attributes)
        for name in self.attributes:
            if name not in attributes and ":" not in name and not _meant(name, attributes):
                error = self.fault(f"the attribute {name!r} is not known; known are {', '.join(attributes)}.")
                if others_matter:
                    raise error
                self.pass_over(f"the attribute {name!r} of <{self.name}>", error)


def _meant(name: str, known: Collection[str]) -> str:
    """The known name that a misspelt one is close to; empty if it is known, or if none is close."""
    close = () if name in known else get_close_matches(name.lower(), known, n=1, cutoff=_CLOSE)
    return close[0] if close else ""


def told(passed: dict[str, list[Tag]]) -> list[str]:
    """One sentence that lists what is passed over, with the first line and the count of each; empty if nothing is."""
    kinds = []
    for what, tags in passed.items():
        more = f" and {len(tags) - 1} more" if len(tags) > 1 else ""
        kinds.append(f"{what} (line {tags[0].line}{more})")
    return [f"Passed over are: {'; '.join(kinds)}. With strict=True they are errors."] if kinds else []


def read_document(path: Path, passed: dict[str, list[Tag]] | None) -> Tag:
    """The outermost element of an XML file, which must be well-formed and declare no entities."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DeclarationError(f"{path}: this file cannot be read ({error.strerror}).") from None
    reading = _Reading(path.name, passed)
    try:
        reading.parser.Parse(content, True)
    except expat.ExpatError as error:
        name = reading.open[-1].title if reading.open else "the document"
        reason = expat.errors.messages.get(error.code, "unknown") if error.code else "unknown"
        raise DeclarationError(
            f"{path.name}, line {error.lineno}, {name}: this is not well-formed XML ({reason})."
        ) from None
    except DeclarationError:  # a ValueError, of an entity
        raise
    except (ValueError, LookupError) as error:  # an encoding that Python does not know
        line = reading.parser.CurrentLineNumber
        raise DeclarationError(f"{path.name}, line {line}, the document: it cannot be decoded ({error}).") from None
    assert reading.root is not None  # else the parser had found no element
    return reading.root


class _Reading:
    """A parser and the elements that it has found so far."""

    def __init__(self, file: str, passed: dict[str, list[Tag]] | None) -> None:
        self.file, self.passed = file, passed
        self.root: Tag | None = None
        self.prefix = ""
        """Of the namespace of the outermost element, such as "urdf:". Elements with others are those of extensions."""
        self.open: list[Tag] = []
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = lambda name: self.open.pop()
        self.parser.EntityDeclHandler = self._entity

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        parent = self.open[-1] if self.open else None
        if parent is None:
            self.prefix = name[: name.rfind(":") + 1]
        tag = Tag(
            name.removeprefix(self.prefix),
            attributes,
            self.file,
            self.parser.CurrentLineNumber,
            parent=parent,
            passed=self.passed,
        )
        if parent is None:
            self.root = tag
        else:
            parent.inside.append(tag)
        self.open.append(tag)

    def _entity(self, name: str, *_: object) -> None:
        raise DeclarationError(
            f"{self.file}, line {self.parser.CurrentLineNumber}, <!ENTITY {name}>: entities are not read: write the "
            "text of this one itself."
        )
