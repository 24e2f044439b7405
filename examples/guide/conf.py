"""The site of symmb: the guide, a page for each public name, and the examples. CONTRIBUTING.md has the command.

Pages of the guide are Markdown files that code hosts show too. Pages of names and of examples are written into `api`
and `gallery` beside them at each build; git ignores these.
"""

import ast
import builtins
import inspect
import os
import re
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from html import escape
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.request import urlopen

from sphinx.util.inspect import stringify_signature

import symmb
from symmb._names import public_names
from symmb.declare.mechanics import Element
from symmb.show.cli.scene_file import shipped_names

HERE = Path(__file__).parent
EXAMPLES = HERE.parent
ROOT = EXAMPLES.parent
DRAWN = HERE / "gallery" / "site" / "drawn"
"""What the examples write, in a folder each."""
DRAWN.mkdir(parents=True, exist_ok=True)

os.environ["TQDM_DISABLE"] = "1"  # notebooks show results alone

project, author, copyright = "symmb", "The symmb authors", "The symmb authors"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.intersphinx", "numpydoc"]
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_timeout = 1800  # [s] of one cell: seconds on a machine at rest, and longer only if it hangs
nb_execution_raise_on_error = True
exclude_patterns = ["_build", "gallery/site/**.png", "drawn/*/logs", "drawn/**.db"]
html_extra_path = ["gallery/site"]
html_static_path = ["site.css", "../figures/mechanisms"]
html_css_files = ["site.css"]
default_role = "code"
smartquotes = False  # texts of code and primes of derivatives keep their marks
html_theme = "furo"
html_title = "symmb"
html_copy_source = False
html_show_sphinx = False
html_search_scorer = str(HERE / "scorer.js")
ADDRESSES = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"].get("urls", {})
"""Of the project, by name: empty as long as there are none."""
html_baseurl = ADDRESSES.get("Documentation", "")
html_theme_options = {
    "footer_icons": [{"name": name, "url": url, "html": name, "class": ""} for name, url in ADDRESSES.items()]
}
add_module_names = False
autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "none"
numpydoc_show_class_members = False
python_maximum_signature_line_length = 90

OTHERS = {
    "numpy": "https://numpy.org/doc/stable/",
    "python": "https://docs.python.org/3/",
    "scipy": "https://docs.scipy.org/doc/scipy/",
    "sympy": "https://docs.sympy.org/latest/",
    "xarray": "https://docs.xarray.dev/en/stable/",
}
"""Sites whose pages this one links to. CasADi's has no inventory of its names."""


def answers(site: str) -> bool:
    """Whether a site gives its inventory. Without a network the site is built without such links."""
    try:
        with urlopen(f"{site}objects.inv", timeout=5) as reply:
            return reply.status == 200
    except OSError:
        return False


intersphinx_mapping = {name: (site, None) for name, site in OTHERS.items() if answers(site)}

GROUPS = {
    "Models": "declaring urdf mjcf starting",
    "Bodies": "declaring flexible",
    "Shapes of bodies in drawings": "drawing",
    "Joints, motors, stops": "joints drives",
    "Forces": "declaring",
    "Contact, friction, impacts": "contact",
    "Scalar outputs": "scalar_outputs",
    "Runs": "sweeps drawing live",
    "Solvers": "solvers",
    "Bounds and their methods": "methods",
    "Nodes and polynomials": "methods",
    "Answers": "tolerances comparisons calibration",
    "Linearisation": "linear",
    "Black boxes": "black_boxes fmus stored_runs",
    "Scenes for other programs": "fmus",
    "Results": "results contributions",
    "Errors": "starting",
}
"""Pages of the guide for each subject of `symmb/__init__.pyi`."""

OPTIONS_ALONE = {"Solvers"}
"""Subjects whose classes have members for contributors alone."""
_OF_ELEMENTS = (
    "actions alignment assembly_cosines axes bodies d doubtful faults flag frames handle holding impacts kind lam "
    "loads measured nearest number offset opens own_frames parts place place_faults position_rows positive pressure "
    "round rows settle sizes states title turn_states turns velocity_rows"
)
FOR_CONTRIBUTORS = {
    "Models": (
        "asked bind block_sizes curve_names curve_units doubtful faults guessed guesses inertial keeping kind memory "
        "number parts place_faults positive prescribed remembered settle sign_faults solved_hashes title"
    ),
    "Bodies": (
        "carried faults inertial is_stiffening laws lively nearly_singular number_of of_structure owner "
        "sections_at_ends turns used_nodes with_numbers"
    ),
    "Runs": "compiled jets kink march second_look solved_by",
    "Results": "have_good_surrogate some_as_html",
    "Joints, motors, stops": _OF_ELEMENTS,
    "Forces": _OF_ELEMENTS,
    "Contact, friction, impacts": _OF_ELEMENTS,
    "Bounds and their methods": "bounds doubtful_miss planned_runs",
}
"""Members of other subjects that are for contributors, who find them in the code."""

LONG = {"artillery"}
"""Scripts that take minutes: the build does not run them."""
PATIENCE = 300.0
"""Time for one of the others [s]. Each takes less than a minute on a machine that does nothing else."""


def page_of(name: str) -> str:
    """Where a public name has its page. Pages of `sweep` and `Sweep` differ on all file systems."""
    twin = name.islower() and any(other != name and other.lower() == name for other in dir(symmb))
    return f"api/{name}_function" if twin else f"api/{name}"


def write(page: str, *lines: str) -> str:
    """Write a page, if it has changed; its address."""
    path, text = HERE / f"{page}.rst", "\n".join([*lines, ""])
    path.parent.mkdir(exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
    return page


def heading(title: str, mark: str = "=") -> str:
    return f"{title}\n{mark * len(title)}\n"


def titled(name: str) -> str:
    return name.replace("_", " ").capitalize()


def directive(name: str, argument: str, *lines: str) -> str:
    return "\n   ".join([f".. {name}:: {argument}", *lines]) + "\n"


def explained(title: str) -> str:
    """Links to pages of the guide."""
    return f"In the guide: {', '.join(f':doc:`/{page}`' for page in GROUPS[title].split())}.\n"


def write_names() -> set[str]:
    """A page for each public name, and one that lists all."""
    groups = public_names()
    written = set()
    for title, name in ((title, name) for title, names in groups.items() for name in names):
        value = getattr(symmb, name)
        options, kind = [], "autodata"
        if inspect.isclass(value):
            others = ",".join(base.__name__ for base in value.__mro__ if not base.__module__.startswith("symmb"))
            options, kind = ["   :members:", f"   :inherited-members: {others}"], "autoclass"
            if hidden := FOR_CONTRIBUTORS.get(title):
                options.append(f"   :exclude-members: {', '.join(hidden.split())}")
            if title in OPTIONS_ALONE:
                options = []
        elif callable(value):
            kind = "autofunction"
        else:
            options = ["   :no-value:"]
        body = "\n".join([f".. {kind}:: symmb.{name}", *options])
        written.add(write(page_of(name), heading(name), explained(title), body))
    sections = [heading("Names"), "All public names, by subject. `import symmb as mb` gives them as `mb.Name`.\n"]
    for title, names in groups.items():
        sections += [heading(title, "-"), explained(title)]
        sections += [directive("autosummary", "", ":nosignatures:", "", *(f"~symmb.{name}" for name in names))]
    pages = [f"/{page_of(name)}" for names in groups.values() for name in names]
    sections.append(directive("toctree", "", ":hidden:", "", *pages))
    return written | {write("api/index", *sections)}


def run_example(script: Path) -> bool:
    """Run a script with a folder for its pictures, unless it and symmb are older than what it wrote.

    Whether the site has what it draws now. If it takes too long, what an earlier build drew stays.
    """
    folder = DRAWN / script.stem
    printed, sources = (
        folder / "printed.txt",
        [script, *(ROOT / "models").glob("*.py"), *Path(symmb.__file__).parent.rglob("*.*")],
    )
    newest = max(path.stat().st_mtime for path in sources if path.suffix != ".pyc")
    if printed.exists() and printed.stat().st_mtime > newest:
        return True
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "PYTHONPATH": paths}
    with TemporaryDirectory(ignore_cleanup_errors=True) as new:
        command = [sys.executable, str(script), new]
        try:
            done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=new, timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            return False
        if done.returncode:
            raise RuntimeError(f"{script.name} failed:\n{done.stderr}")
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(new, folder)
    printed.write_text(done.stdout.replace(new, "FOLDER"), encoding="utf-8")
    return True


def shown(script: Path, title: str, drawn: bool) -> list[str]:
    """What a script drew and printed, now or in an earlier build; else what the repository has of its pictures."""
    folder, name = DRAWN / script.stem, script.stem
    said = [] if drawn else ["It takes long, and the build of this page did not wait for its end.\n"]
    if not (folder / "printed.txt").exists():
        code = script.read_text(encoding="utf-8")
        kept = [file.name for file in sorted((EXAMPLES / "figures").iterdir()) if f'"{file.name}"' in code]
        said.append("These pictures are of an earlier run.\n" if kept else "Run it to see its pictures.\n")
        return said + [directive("image", f"/../figures/{file}", ":width: 100%", f":alt: {title}") for file in kept]
    if not drawn:
        said.append("What it drew and printed is of an earlier run.\n")
    files = sorted(folder.iterdir())
    pictures = [
        directive("image", f"/gallery/site/drawn/{name}/{file.name}", ":width: 100%", f":alt: {title}")
        for file in files
        if file.suffix == ".png"
    ]
    frame = '<iframe src="../drawn/{}/{}" title="{}" loading="lazy"></iframe>'
    found = [file for file in files if file.suffix == ".html"]
    pages = [directive("raw", "html", "", frame.format(name, file.name, title)) for file in found]
    if len(found) > 1:
        pages = [cards([card(f"../drawn/{name}/{file.stem}", titled(file.stem), "") for file in found])]
    text = (folder / "printed.txt").read_text(encoding="utf-8")
    printed = ["It prints\n", directive("code-block", "text", ":class: whole", "", *text.splitlines())]
    return [*said, *pages, *pictures, *(printed if text.strip() else [])]


CARDS = {"live_mechanisms": "four_bar", "paper_section_4_2": "double_pendulum", "weave_speed": "bicycle"}
"""Examples whose card shows the mechanism of a shipped scene."""


def card(page: str, title: str, text: str) -> str:
    """A part of the gallery that links to a page: a picture of the mechanism, if there is one, title and a sentence."""
    name = page.rpartition("/")[2].removeprefix("model_")
    picture = f"{CARDS.get(name, name)}.png"
    there = (EXAMPLES / "figures" / "mechanisms" / picture).exists()
    image = f'<img src="../_static/{picture}" alt="">' if there else ""
    sentence = re.split(r"(?<=[.?!])\s", " ".join(text.split()), maxsplit=1)[0]
    return f'<a class="card" href="{page}.html">{image}<b>{escape(title)}</b> {escape(sentence)}</a>'


def cards(entries: list[str]) -> str:
    return directive("raw", "html", "", '<div class="cards">', *entries, "</div>")


def included(file: str, tree: ast.Module) -> str:
    """The code of a file, by its path in `examples`, below its docstring."""
    lines = f":lines: {(tree.body[0].end_lineno or 0) + 2}-"
    return directive("literalinclude", f"/../{file}", ":class: whole", lines)


def write_models() -> tuple[set[str], list[str]]:
    """A page for each shipped scene, and its card."""
    written, entries = set(), []
    for name in shipped_names():
        code = (ROOT / "models" / f"{name}.py").read_text(encoding="utf-8")
        tree, title = ast.parse(code), f"{titled(name)}, a model"
        text = ast.get_docstring(tree) or ""
        picture = f"figures/mechanisms/{name}.png"
        drawn = [directive("image", f"/../{picture}", f":alt: {title}")] if (EXAMPLES / picture).exists() else []
        about = f"`models/{name}.py`. `symmb view {name} -o {name}.html` draws it.\n"
        body = included(f"../models/{name}.py", tree)
        said = directive("code-block", "text", ":class: prose", "", *text.splitlines())
        written.add(write(f"gallery/model_{name}", heading(title), about, *drawn, said, body))
        entries.append(card(f"model_{name}", title.removesuffix(", a model"), text))
    return written, entries


def write_gallery() -> set[str]:
    """A page for each script in examples, with what it draws and prints, and one that lists all."""
    written, entries = set(), []
    scripts = sorted(EXAMPLES.glob("*.py"))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        drawn_now = list(pool.map(lambda script: script.stem not in LONG and run_example(script), scripts))
    for script, now in zip(scripts, drawn_now, strict=True):
        tree = ast.parse(script.read_text(encoding="utf-8"))
        text, title = ast.get_docstring(tree) or "", titled(re.sub(r"(\d)_(\d)", r"\1.\2", script.stem))
        code = included(script.name, tree)
        said = text.replace("\n\n    ", "\n\n::\n\n    ")  # commands
        page = [heading(title), f"`examples/{script.name}`\n", said, "", *shown(script, title, now), code]
        written.add(write(f"gallery/{script.stem}", *page))
        entries.append(card(script.stem, title, text))
    about = "These scripts are in `examples`. Each runs by itself, and checks its results against others.\n"
    models, of_models = write_models()
    scenes = "These scenes are in `models`, with their sources. Commands know them by name, as `symmb view four_bar`.\n"
    pages = directive("toctree", "", ":hidden:", "", *sorted(f"/{page}" for page in written | models))
    sections = [heading("Examples and models"), about, cards(entries), heading("Models", "-"), scenes, cards(of_models)]
    return written | models | {write("gallery/index", *sections, pages)}


def write_pages(app) -> None:
    """Write the pages of names and examples, and remove those of names and examples that are gone."""
    written = write_names() | write_gallery()
    for path in [*(HERE / "api").glob("*.*"), *(HERE / "gallery").glob("*.*")]:
        if f"{path.parent.name}/{path.stem}" not in written:
            path.unlink()


MOVING = "drawn/rod_on_a_spring/rod_on_a_spring.html"
"""The page of README's example. It takes the place of README's first picture, and plays."""


def home() -> str:
    """README as the first page of the site."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8").replace("(examples/guide/index.md)", "(#guide)")
    readme = re.sub("</?p>", "", readme.replace("](examples/guide/", "](")).replace('src="examples/', 'src="../')
    readme = re.sub(r"\(examples/(\w+)\.py\)", r"(gallery/\1.rst)", readme)
    readme = readme.replace("`models/` with twenty-five mechanisms", "[twenty-five mechanisms](gallery/index.rst)")
    if not (HERE / "gallery" / "site" / MOVING).exists():
        return readme
    picture = re.search(r'<img [^>]*alt="(.*)">', readme)
    assert picture is not None
    frame = f'<iframe src="{MOVING}#play" title="{picture[1]}"></iframe>'
    return readme.replace(picture[0], frame, 1)


def add_contents(app, page: str, source: list[str]) -> None:
    """Begin the first page with README, and build the side bar from its lists of links."""
    if page == "index":
        guide = re.sub(r"^\[README\].*\n\n", "", source[0], flags=re.MULTILINE)
        source[0] = f"{home()}\n#{guide}"
        lists = re.findall(r"^(\S.*):\n\n((?:- .*\n)+)", source[0], re.MULTILINE)
        links = [(caption, re.findall(r"\]\(([\w/]+)\.md\)", text)) for caption, text in lists]
        links.append(("Reference", ["api/index", "gallery/index"]))
        for caption, pages in links:
            options = f":caption: {caption}\n" + ":hidden:\n" * (caption != "Reference")
            source[0] += "\n```{toctree}\n" + options + ":maxdepth: 1\n\n" + "\n".join(pages) + "\n```\n"


SIDE_BARS: dict[str, str] = {}
"""The tree of the side bar for the pages of each folder, without the marks of a page."""


def keep_side_bar(app, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    """Make the tree of the side bar once for each folder: for its other pages, only the marks differ.

    Sphinx would copy all its links for each page, which takes half of the time of a build.
    """
    make, folder = context["toctree"], page.rpartition("/")[0]

    def start(name: str) -> str:
        """The start of the link from a page of the folder to a page."""
        return f'<a class="reference internal" href="{app.builder.get_relative_uri(f"{folder}/_".strip("/"), name)}">'

    def tree(**options: Any) -> str:
        here = '<a class="current reference internal" href="#">'
        if folder not in SIDE_BARS:
            marked = make(**options).replace(here, start(page))
            SIDE_BARS[folder] = marked.replace(' current">', '">').replace('<ul class="current">', "<ul>")
        text = SIDE_BARS[folder]
        for name, link in {f"{folder}/index": start(f"{folder}/index"), page: here}.items():
            text = text.replace(f'">{start(name)}', f' current">{link}', 1)
        return text

    context["toctree"] = tree


ENTRIES = {"Parameters", "Attributes", "Returns", "Raises"}


def escaped(found: re.Match[str]) -> str:
    """Code that letters follow, as in `State`s, bars of absolute values, and dots: all are marks of other things."""
    code, letter = found[1], found[2]
    return rf"{code}\ {letter}" if letter else code or {"|": r"\|", "...": "…"}[found[0]]


def two_lines(app, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Put what docstrings say of a parameter below its name and type, as numpydoc wants it.

    They write `name : type      what it is`, or `name : what it is`, and go on in lines that are indented.
    """
    if name == "symmb.t":
        lines[:] = ["Time [s], the one independent variable of every law: a symbol of CasADi.", ""]
        lines += [
            "Examples",
            "--------",
            ">>> import casadi, symmb as mb",
            ">>> casadi.sin(2 * mb.t)",
            "SX(sin((2.*t)))",
        ]
    if what in ("attribute", "property") and "\n".join(lines).strip() in OF_BUILTINS:
        lines.clear()  # Sphinx takes the docstring of the type of the value
    old, section, at, code = [], "", 0, False
    for line in lines:
        code = bool(line) and (code or ">>>" in line)
        old.append(line if code else MARKS.sub(escaped, line))
    lines.clear()
    while at < len(old):
        line, at = old[at], at + 1
        if at < len(old) and old[at].startswith("---"):
            section = line
        if section not in ENTRIES or not line or line[0] in " -" or line == section:
            lines.append(line)
            continue
        more = list(takewhile(lambda line: line.startswith(" "), old[at:]))
        at += len(more)
        head, _, said = line.partition("  ")
        if not said and (not more or len(line) > WRAPPED):
            head, _, said = line.partition(" : ")
        lines += [head, *(f"    {text.strip()}" for text in (said, *more) if text.strip())]


OF_BUILTINS = {inspect.getdoc(kind) for kind in vars(builtins).values() if isinstance(kind, type)}
"""Docstrings of Python's own types."""
MARKS = re.compile(r"(`+[^`]*`+)(\w?)|\||(?<=, )\.\.\.")
WRAPPED = 95
"""Characters of a line from which on it goes on in the next one. Shorter ones end with the type."""


def of_init(app, what: str, name: str, value: Any, options: object, arguments: str, returns: str):
    """The arguments of an element. Sphinx prefers those of `Element.__new__`, which accepts all arguments."""
    if what == "class" and issubclass(value, Element):
        return stringify_signature(inspect.signature(value), show_annotation=False, show_return_annotation=False), None
    return None


def setup(app) -> None:
    app.connect("builder-inited", write_pages)
    app.connect("source-read", add_contents)
    app.connect("html-page-context", keep_side_bar, priority=400)  # before the theme asks for the tree
    app.connect("autodoc-process-docstring", two_lines, priority=100)
    app.connect("autodoc-process-signature", of_init)
