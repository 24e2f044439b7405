"""How to cite symmb: the data of `CITATION.cff`, and the web address of the project, if there is one."""

import re
from importlib.metadata import metadata
from pathlib import Path

_PACKAGE = Path(__file__).parent
_FILE = "CITATION.cff"
ADDRESSES = "Repository", "Homepage"
"""Names in `[project.urls]` of `pyproject.toml`. A citation contains the first address that exists."""


def citation() -> str:
    """The BibTeX entry of symmb. A wheel contains `CITATION.cff`; a checkout has the file beside the package."""
    file = _PACKAGE / _FILE
    text = (file if file.exists() else _PACKAGE.parent / _FILE).read_text(encoding="utf-8")
    text = text.partition("\nreferences:")[0]

    def entry(name: str) -> str:
        found = re.search(rf"^(?:  - )?{name}: *\"?(.*?)\"?$", text, re.MULTILINE)
        assert found is not None, f"{_FILE} has no {name}"
        return found[1]

    fields = {
        "author": f"{{{entry('name')}}}",  # the inner braces prevent that BibTeX divides the name of a group
        "title": entry("title").replace("symmb", "{symmb}", 1),
        "year": entry("date-released")[:4],
        "version": entry("version"),
        "license": entry("license"),
    }
    named = dict(line.split(", ", 1) for line in metadata("symmb").get_all("Project-URL") or [])
    for name in reversed(ADDRESSES):
        if name in named:
            fields["url"] = named[name]
    return "@software{symmb,\n" + "".join(f"  {name} = {{{value}}},\n" for name, value in fields.items()) + "}"
