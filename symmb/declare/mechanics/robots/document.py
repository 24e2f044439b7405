"""XML elements with their line numbers. Entities are refused, because they can expand a small file to a huge one."""

import math
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from xml.parsers import expat

from symmb._errors import DeclarationError
from symmb._magnitudes import LARGEST
from symmb._names import counted, name_fault

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
    """Elements with harmless faults, by the kind of the fault; None if the file is read strictly."""

    @property
    def title(self) -> str:
        """The element with its name. Without a name, the closest enclosing element that has a name is added."""
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
        """Record a harmless fault of the kind `what`. If the file is read strictly, the fault is raised."""
        if self.passed is None:
            raise fault
        self.passed.setdefault(what, []).append(self)

    def all(self, name: str) -> Iterator["Tag"]:
        """The direct children with this name."""
        return (tag for tag in self.inside if tag.name == name)

    def one(self, name: str) -> "Tag | None":
        """The only direct child with this name, or None. A second child with the name is an error."""
        found = [*self.all(name)]
        if len(found) > 1:
            raise found[1].fault(f"this is the second <{name}>, but only one is allowed. Remove one of the two.")
        return found[0] if found else None

    def needed(self, name: str) -> "Tag":
        """The only direct child with this name. A missing child is an error."""
        found = self.one(name)
        if found is None:
            raise self.fault(f"this element has no <{name}>. Add a <{name}>.")
        return found

    def text(self, attribute: str) -> str:
        """The text of an attribute. A missing or empty attribute is an error."""
        value = self.attributes.get(attribute)
        if value is None:
            raise self.fault(f"this element has no attribute {attribute!r}. Add {attribute}='...'.")
        if not value.strip():
            raise self.fault(f"the attribute {attribute!r} is empty. Write a value.")
        return value.strip()

    def own_name(self) -> str:
        """The attribute `name`, changed to a name that symmb allows."""
        name = self.text("name")
        fault = name_fault(name, without=_NOT_IN_NAMES)
        if fault:
            error = self.fault(f"the name {name!r} cannot be used, because {fault.rstrip('.')}. Rename the element.")
            if name_fault(self.reference("name")):
                raise error
            self.pass_over("dots, brackets and spaces in names, which are replaced by _", error)
        return self.reference("name")

    def reference(self, attribute: str) -> str:
        """The name in an attribute, with the same replacements as in `own_name`."""
        return re.sub(f"[{re.escape(_NOT_IN_NAMES)}]", "_", self.text(attribute))

    def numbers(self, attribute: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """The numbers of an attribute, as many as the default has. The default replaces a missing attribute."""
        if attribute not in self.attributes:
            return default
        text, values, count = self.attributes[attribute], [], len(default)
        for word in text.split():
            try:
                values.append(float(word if "_" not in word else ""))  # Python takes 1_0 for 10
            except ValueError:
                hint = " Run the file through xacro first." if "$" in word else ""
                raise self.fault(f"{attribute}={text!r} contains {word!r}, which is not a number.{hint}") from None
        if len(values) != count:
            raise self.fault(f"{attribute}={text!r} contains {counted(len(values), 'number')}. Write {count}.")
        if not all(map(math.isfinite, values)):
            raise self.fault(f"{attribute}={text!r} is not finite. Write finite numbers.")
        if self.name != "limit" and max(map(abs, values)) > LARGEST:  # files write huge limits for "no limit"
            raise self.fault(f"{attribute}={text!r} exceeds {LARGEST:g}. Use SI units.")
        return tuple(values)

    def number(self, attribute: str, default: float | None = None) -> float:
        """The number of an attribute, or the default. Without a default, a missing attribute is an error."""
        if default is None:
            self.text(attribute)
        return self.numbers(attribute, (default or 0.0,))[0]

    def not_negative(self, attribute: str, default: float | None = None, what: str = "") -> float:
        """The number of an attribute. A negative number is an error."""
        value = self.number(attribute, default)
        if value < 0:
            raise self.fault(f"{what or attribute} {value:g} is negative. Write 0 or a positive number.")
        return value

    def check(self, elements: Collection[str], attributes: Collection[str]) -> None:
        """Raise an error if the name of a direct child or of an attribute is a misspelt known name.

        Other unknown names belong to extensions and are ignored.
        """
        for tag in self.inside:
            if tag.name.startswith("xacro:"):
                raise tag.fault("this file contains xacro macros. Run it through the program xacro first.")
            meant = "" if ":" in tag.name else _meant(tag.name, elements)
            if meant:
                raise tag.fault(f"this element is not known. Did you mean <{meant}>?")
        for name in self.attributes:
            meant = _meant(name, attributes)
            if meant:
                error = self.fault(f"the attribute {name!r} is not known. Did you mean {meant!r}?")
                if meant not in self.attributes:
                    raise error
                self.pass_over(f"the attribute {name!r} of <{self.name}>", error)

    def check_exactly(self, attributes: Collection[str], *, others_matter: bool = False) -> None:
        """Raise an error or record a harmless fault for each unknown attribute. Attributes with a prefix are ignored,
        because they belong to extensions."""
        self.check((), attributes)
        for name in self.attributes:
            if name not in attributes and ":" not in name and not _meant(name, attributes):
                error = self.fault(f"the attribute {name!r} is not known. Known attributes: {', '.join(attributes)}.")
                if others_matter:
                    raise error
                self.pass_over(f"the attribute {name!r} of <{self.name}>", error)


def _meant(name: str, known: Collection[str], similarity: float = 0.75) -> str:
    """The known name that is closest to a misspelt name; empty if the name is known, or if no name is close."""
    # Names of extensions are less similar to known names than misspelt names are.
    close = () if name in known else get_close_matches(name.lower(), known, n=1, cutoff=similarity)
    return close[0] if close else ""


def told(passed: dict[str, list[Tag]]) -> list[str]:
    """A list with one sentence that names each kind of harmless fault and its first line; empty without such faults."""
    kinds = []
    for what, tags in passed.items():
        more = f" and {len(tags) - 1} more" if len(tags) > 1 else ""
        kinds.append(f"{what} (line {tags[0].line}{more})")
    return [f"These faults are ignored: {'; '.join(kinds)}. With strict=True they are errors."] if kinds else []


def read_document(path: Path, passed: dict[str, list[Tag]] | None) -> Tag:
    """The root element of an XML file. A file that is not well-formed or declares entities is an error."""
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
            f"{path.name}, line {error.lineno}, {name}: the file is not well-formed XML ({reason})."
        ) from None
    except DeclarationError:  # of an entity; DeclarationError is a ValueError, too
        raise
    except (ValueError, LookupError) as error:  # an encoding that Python does not know
        line = reading.parser.CurrentLineNumber
        raise DeclarationError(
            f"{path.name}, line {line}, the document: the file cannot be decoded ({error})."
        ) from None
    assert reading.root is not None  # a document without an element is not well-formed
    return reading.root


class _Reading:
    """A parser, and the elements that have been parsed so far."""

    def __init__(self, file: str, passed: dict[str, list[Tag]] | None) -> None:
        self.file, self.passed = file, passed
        self.root: Tag | None = None
        self.prefix = ""
        """The namespace prefix of the root element, such as "urdf:". Other prefixes belong to extensions."""
        self.open: list[Tag] = []
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = lambda name: self.open.pop()
        self.parser.EntityDeclHandler = self._entity

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        parent = self.open[-1] if self.open else None
        if parent is None:
            self.prefix = name[: name.rfind(":") + 1]
        name, line = name.removeprefix(self.prefix), self.parser.CurrentLineNumber
        tag = Tag(name, attributes, self.file, line, parent=parent, passed=self.passed)
        if parent is None:
            self.root = tag
        else:
            parent.inside.append(tag)
        self.open.append(tag)

    def _entity(self, name: str, *_: object) -> None:
        raise DeclarationError(
            f"{self.file}, line {self.parser.CurrentLineNumber}, <!ENTITY {name}>: entities are not supported. Write "
            f"the text in place of &{name};."
        )
