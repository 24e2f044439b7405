"""What hosts of the repository read: workflows, templates, and how to cite it. Addresses stand in one place."""

import re
import tomllib
from email.message import Message
from pathlib import Path

import planted_faults
import pytest

import symmb as mb
from symmb import _citation

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
README = (ROOT / "README.md").read_text(encoding="utf-8")
HOST = ROOT / ".github"
WORKFLOWS = {path.stem: yaml.safe_load(path.read_text(encoding="utf-8")) for path in HOST.glob("workflows/*.yml")}


@pytest.mark.parametrize("name", WORKFLOWS)
def test_jobs_have_limits_and_steps(name):
    workflow = WORKFLOWS[name]
    assert workflow["name"] == name and workflow["permissions"] == {"contents": "read"}
    for job in workflow["jobs"].values():
        assert job["runs-on"] and all(("uses" in step) != ("run" in step) for step in job["steps"])
        assert all(re.fullmatch(r"[\w./-]+@[\w./]+", step["uses"]) for step in job["steps"] if "uses" in step)
        assert "timeout-minutes" in job or not any("run" in step for step in job["steps"])
        assert set(job.get("needs", "").split()) <= set(workflow["jobs"])


def commands(name):
    return [step.get("run", "") for job in WORKFLOWS[name]["jobs"].values() for step in job["steps"]]


def test_workflows_run_what_texts_say_on_all_systems():
    texts = README + (HOST / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for command in ("python -m pytest -q -n 2", "sphinx-build -W -b html examples/guide build/site", ".ci/run"):
        assert command in texts and any(command in run for name in WORKFLOWS for run in commands(name))
    for name in WORKFLOWS:
        for path in re.findall(r"\.ci/\w+", " ".join(commands(name))):
            assert (ROOT / path).stat().st_mode & 0o100
    matrix = WORKFLOWS["tests"]["jobs"]["fast"]["strategy"]["matrix"]
    assert matrix["os"] == ["ubuntu-latest", "macos-latest"]
    prefix = "Programming Language :: Python :: 3."
    classifiers = [classifier for classifier in PROJECT["classifiers"] if classifier.startswith(prefix)]
    assert [f"{prefix}{version.removeprefix('3.')}" for version in matrix["python"]] == classifiers


def test_a_tag_publishes_what_the_checks_have_seen():
    build, publish = WORKFLOWS["release"]["jobs"].values()
    assert WORKFLOWS["release"][True] == {"push": {"tags": ["v*"]}}  # YAML reads the key `on` as true
    assert publish["permissions"] == {"id-token": "write"} and "password" not in str(publish)
    names = [step["uses"].split("@")[0] for step in publish["steps"]]
    assert names == ["actions/download-artifact", "pypa/gh-action-pypi-publish"]
    kept = [step["with"] for step in build["steps"] if "upload-artifact" in step.get("uses", "")]
    assert [kept[0]["name"], kept[0]["path"]] == [publish["steps"][0]["with"][key] for key in ("name", "path")]
    tag = next(step for step in build["steps"] if "TAG" in step.get("env", {}))
    code = re.sub(r'^python -c "|"$', "", tag["run"].strip())
    for name in (PROJECT["version"], "9.9.9"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("TAG", f"v{name}")
            patch.chdir(ROOT)
            if name == PROJECT["version"]:
                exec(code)
            else:
                with pytest.raises(AssertionError):
                    exec(code)


@pytest.mark.parametrize("path", sorted(HOST.glob("ISSUE_TEMPLATE/[!c]*.yml")), ids=lambda path: path.stem)
def test_templates_ask_for_something(path):
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert form["name"] and form["description"] and form["labels"]
    names = [part["id"] for part in form["body"]]
    assert len(set(names)) == len(names) and any(part.get("validations") for part in form["body"])
    assert all(part["type"] in ("input", "textarea") and part["attributes"]["label"] for part in form["body"])


def test_the_citation_is_that_of_the_file():
    data = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    url = PROJECT["urls"].get("Repository", PROJECT["urls"].get("Homepage"))
    fields = dict(re.findall(r"^  (\w+) = \{(.*)\},$", mb.__citation__, re.MULTILINE))
    assert fields == {
        "author": "{The symmb authors}",
        "title": data["title"].replace("symmb", "{symmb}", 1),
        "year": str(data["date-released"].year),
        "version": data["version"],
        "license": data["license"],
    } | ({"url": url} if url else {})
    assert data["authors"] == [{"name": author["name"]} for author in PROJECT["authors"]]
    assert f"```bibtex\n{mb.__citation__}\n```" in README


def test_a_wheel_has_the_citation(tmp_path, monkeypatch):
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    assert wheel["wheel"]["force-include"] == {"CITATION.cff": "symmb/CITATION.cff"}
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (tmp_path / "CITATION.cff").write_text(text.replace("symmb:", "another:"), encoding="utf-8")
    monkeypatch.setattr(_citation, "_PACKAGE", tmp_path)
    assert "title = {another:" in mb.__citation__


@pytest.mark.parametrize(
    ("named", "url"),
    [
        ([], None),
        (["Documentation, https://a.org/docs"], None),
        (["Homepage, https://a.org", "Repository, https://b.org/x, y"], "https://b.org/x, y"),
        (["Homepage, https://a.org"], "https://a.org"),
    ],
)
def test_the_citation_takes_the_address_of_the_metadata(named, url, monkeypatch):
    metadata = Message()
    for text in named:
        metadata["Project-URL"] = text
    monkeypatch.setattr(_citation, "metadata", lambda name: metadata)
    assert ("url" in mb.__citation__) == (url is not None)
    assert url is None or f"  url = {{{url}}},\n" in mb.__citation__


def test_readme_claims_no_address_but_those_of_the_project():
    urls = [url for url in re.findall(r"https?://[^\s)\"]+", README)]
    assert {*urls} == {*PROJECT["urls"].values()}
    assert ("the repository that you cloned" in README) == (not PROJECT["urls"])


@pytest.mark.parametrize("fault", planted_faults.FAULTS, ids=lambda fault: fault.name)
def test_a_planted_fault_has_its_place_and_its_tests(fault):
    assert fault.before != fault.after
    assert (ROOT / fault.file).read_text(encoding="utf-8").count(fault.before) == 1
    assert all((ROOT / "tests" / room).is_dir() for room in fault.rooms.split())
