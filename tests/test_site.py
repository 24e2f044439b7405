"""The site is built without a warning. Its links lead somewhere, and its search answers what new users ask."""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

import pytest
from browser import PROGRAM, Browser
from page_fit import misfits

import symmb
from symmb.show.cli.scene_file import shipped_names

pytest.importorskip("furo")
pytest.importorskip("myst_nb")
pytest.importorskip("numpydoc")
SearchEnglish = pytest.importorskip("sphinx.search.en").SearchEnglish
ROOT = Path(__file__).parents[1]
QUESTIONS = [
    ("How do I put friction in a joint?", "friction joint", "contact"),
    ("How do I save results to csv?", "save results csv", "results"),
    ("Which solver should I choose?", "choose solver", "solvers"),
    ("How do I read a URDF?", "urdf", "urdf"),
    ("How do I read a model of MuJoCo?", "mujoco", "mjcf"),
    ("How do I take matrices of Nastran?", "nastran", "flexible"),
    ("Assembly fails, what now?", "assembly fails", "starting"),
    ("How do I make a motor?", "motor joint", "joints"),
    ("How do I bound an FMU?", "fmu bounds", "fmus"),
    ("How do I run on a SLURM cluster?", "slurm", "clusters"),
    ("How do I use all cores?", "cores processes", "executors"),
    ("How do I go on with a study that was killed?", "study killed", "stored_runs"),
    ("Which tolerance causes it?", "tolerance contribution", "contributions"),
    ("How do I give a parameter a normal distribution?", "normal distribution", "distributions"),
    ("What is the probability of failure?", "probability quantile", "distributions"),
    ("How do I get natural frequencies?", "frequencies modes", "linear"),
    ("When does it become unstable?", "critical speed", "linear"),
    ("How do I make a film?", "film", "drawing"),
    ("How do I fit parameters to measurements?", "measurements fit", "calibration"),
    ("How do I get derivatives with respect to parameters?", "derivatives parameters", "sweeps"),
    ("Which torque does the motor need?", "inverse dynamics", "inverse"),
    ("How do I make a beam that bends?", "flexible beam", "flexible"),
    ("How do I bound a program of my own?", "external program", "black_boxes"),
    ("How do I bound a Python function?", "python function bounds", "black_boxes"),
    ("Which method for many parameters?", "choose method", "methods"),
    ("How do I use it without Python?", "command line", "command_line"),
    ("What does the comparison's table mean?", "comparison", "comparisons"),
    ("How do I make two bodies touch?", "contact bodies", "contact"),
    ("What is a revolute joint?", "revolute", "api/Revolute"),
    ("What arguments does PolynomialChaos take?", "PolynomialChaos", "api/PolynomialChaos"),
    ("How fast is it?", "speed benchmarks", "speed"),
    ("How do I go from a drawing's tolerances to limits?", "tolerances drawing", "tolerances"),
    ("What if the mechanism is a URDF?", "my mechanism is a URDF", "urdf"),
    ("What if a parameter is measured?", "one parameter is measured", "calibration"),
    ("How do I give tolerances of ISO 2768?", "ISO 2768", "tolerances"),
    ("Where are natural frequencies?", "natural frequency", "linear"),
    ("How do I make runs in parallel?", "parallel", "executors"),
    ("How do I make a PID controller?", "PID controller", "joints"),
    ("How do I print a report?", "print report PDF", "results"),
    ("How do I take results to Excel?", "export to Excel", "results"),
    ("How do I resume a study?", "resume", "stored_runs"),
    ("How do I make a stepper motor?", "stepper motor", "joints"),
    ("Where is the process capability?", "Cpk", "distributions"),
    ("How do I make a belt?", "belt", "declaring"),
    ("How do I make a cable?", "cable", "declaring"),
    ("Which units have numbers?", "units", "declaring"),
    ("How do I keep a point on a plane?", "point plane", "declaring"),
    ("How many parts are rejected?", "reject rate", "distributions"),
]
"""What a new user asks, the words that they type, and a page that must be among the first three answers."""
SHOWN = "<table", "data:image/png;base64,"
NOTEBOOKS = {
    "tolerances": ["<iframe srcdoc=", *SHOWN, "The largest box that satisfies the limits"],
    "black_boxes": [*SHOWN, "runs of the FMU; its bounds differ from those of the program by"],
    "paper": ["<iframe srcdoc=", "<table", "± 20%   paper"],
}
"""Pages whose code runs in the build, and what is below their cells."""


def listed(files):
    return files if isinstance(files, list) else [files]


def answers(index, query):
    """Pages in the order of the site's own search: `searchtools.js` of Sphinx, with the scores of `scorer.js`."""
    language, query = SearchEnglish({}), query.lower()
    score, titles = {}, index["titles"]

    def found(file, points):
        score[file] = max(score.get(file, points), points)

    for title, places in index["alltitles"].items():
        if query in title.lower() and len(query) >= len(title) / 2:
            for file, _ in places:
                found(file, round(15 * len(query) / len(title)) + (titles[file] == title))
    for entry, places in index["indexentries"].items():
        if query in entry and len(query) >= len(entry) / 2:
            for file, _, main in places:
                found(file, round(100 * len(query) / len(entry)) if main else 0)
    for prefix, objects in index["objects"].items():
        for file, kind, priority, _, name in objects:
            last = name.lower().split(".")[-1]
            about = f"{prefix} {name} {index['objnames'][str(kind)][2]} {titles[file]}".lower()
            for word in query.split():
                if word in f"{prefix}.{name}".lower() and all(other in about for other in query.split()):
                    found(file, {0: 15, 1: 5, 2: -5}[priority] + (11 if word == last else 6 if word in last else 0))
    words = {language.stem(word) for word in query.split() if word not in language.stopwords and not word.isdigit()}
    points = {word: {} for word in words}
    for word in words:
        for terms, whole, part in ((index["terms"], 5, 2), (index["titleterms"], 15, 7)):
            matches = [word] if word in terms else [term for term in terms if word in term and len(word) > 2]
            for file in (file for term in matches for file in listed(terms[term])):
                points[word][file] = whole if word in terms else part
    for file in set.intersection(*(set(files) for files in points.values())):
        found(file, max(files[file] for files in points.values()))
    pages = index["docnames"]
    for file in score:
        score[file] += "/" not in pages[file] and pages[file] not in ("index", "tasks", "changes")
    return [pages[file] for file in sorted(score, key=lambda file: (-score[file], titles[file].lower()))]


def broken_links(site):
    """Links between pages of the site that lead to no page, or to no place on it."""
    pages = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    places = {path: set(re.findall(r'id="([^"]+)"', text)) for path, text in pages.items()}
    for path, text in pages.items():
        for file, place in set(re.findall(r'(?:href|src)="([^":#?]*)[^"#:]*#?([^":]*)"', text)):
            target = (path.parent / unquote(file)).resolve() if file else path
            if not target.exists() or (place and target in places and place not in places[target]):
                yield f"{path.relative_to(site)}: {file}#{place}"


def plain(text):
    """The text of a page, without its tags and line breaks."""
    return " ".join(re.sub("<[^>]*>", "", text).split())


def cards_without_pictures(text):
    """Pages whose card has no picture: they have no mechanism."""
    cards = re.findall(r'<a class="card" href="(\w+)\.html">(<img [^>]*>)?<b>[^<]+</b> [^<]+</a>', text)
    examples = {path.stem for path in (ROOT / "examples").glob("*.py")}
    assert {name for name, _ in cards} == examples | {f"model_{name}" for name in shipped_names()}
    return {name for name, picture in cards if not picture}


def pages_that_do_not_fit(site):
    """Pages of the guide and the gallery that are wider than screens or telephones, and what is too wide on them."""
    with Browser() as browser:
        for path in [*sorted(site.glob("*.html")), site / "gallery" / "index.html", site / "api" / "System.html"]:
            if path.stem not in ("search", "genindex"):
                browser.open(path)
                for width in (1280, 390):
                    browser.resize(width, 900)
                    for fault in misfits(browser, width == 1280 and path.parent == site):
                        yield f"{path.name} at {width}: {fault}"


def test_site(tmp_path):
    """One test, so that one process builds it."""
    command = [sys.executable, "-m", "sphinx", "-Wqb", "html", "--keep-going", ROOT / "examples" / "guide", tmp_path]
    built = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"SYMMB_CFLAGS": "-Og"})
    assert built.returncode == 0, built.stderr
    assert not list(broken_links(tmp_path))
    for page, shown in NOTEBOOKS.items():
        text = (tmp_path / f"{page}.html").read_text(encoding="utf-8")
        outputs = text.split('class="cell_output')[1:]
        assert len(outputs) >= 3 and all(any(part in output for output in outputs) for part in shown), page
    gallery = {path.stem: path.read_text(encoding="utf-8") for path in (tmp_path / "gallery").glob("*.html")}
    picture = re.compile(r'<(img|iframe) [^>]*src="\.\./(?:_images|drawn)/')
    drawn = {name: picture.findall(text) for name, text in gallery.items()}
    scripts = {path.stem for path in (ROOT / "examples").glob("*.py")}
    late = {name for name in scripts if "did not wait for its end" in gallery[name]}
    assert "artillery" in late and len(late) < len(scripts) / 2  # a busy machine has others
    assert {name for name in scripts - late if not drawn[name]} == {"cubic", "live_mechanisms"} - late
    pages = re.findall(r'href="(\.\./drawn/live_mechanisms/\w+\.html)"><img', gallery["live_mechanisms"])
    assert len(pages) == 6 * (find_spec("ziglang") is not None) or "live_mechanisms" in late
    assert sum("iframe" in drawn[name] for name in scripts) >= 14 - len(late - {"artillery"})

    assert cards_without_pictures(gallery["index"]) == {"black_box", "cluster", "cubic", "model_cubic"}
    if PROGRAM:
        assert not list(pages_that_do_not_fit(tmp_path))

    text = (tmp_path / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    pages = {(prefix, row[4]): index["docnames"][row[0]] for prefix, rows in index["objects"].items() for row in rows}
    of_names = {pages["symmb", name] for name in symmb.__all__}
    assert len(of_names) == len(symmb.__all__) and all(page.startswith("api/") for page in of_names)

    members = {(prefix, row[4]) for prefix, rows in index["objects"].items() for row in rows}
    assert ("symmb.Revolute", "angle") in members and ("symmb.PolynomialChaos", "paper") in members
    hidden = [("Revolute", "position_rows"), ("Vertex", "bounds"), ("CVODES", "integration"), ("HHT", "scheme")]
    assert not members & {(f"symmb.{kind}", name) for kind, name in hidden}

    of_api = {path.name: plain(path.read_text(encoding="utf-8")) for path in (tmp_path / "api").glob("*.html")}
    assert not {name for name, text in of_api.items() if "(*_, **__)" in text or "Returns True when the arg" in text}
    assert "Stop(name, joint, lower=None, upper=None, " in of_api["Stop.html"]

    failed = [(question, page) for question, words, page in QUESTIONS if page not in answers(index, words)[:3]]
    assert not failed
