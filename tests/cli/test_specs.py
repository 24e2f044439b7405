"""The table of methods and solvers that the command line knows."""

import inspect
import re

import pytest

import symmb as mb
from symmb.bound.bounds.method import Method
from symmb.run.integrate.solver import Solver
from symmb.show.cli import specs
from symmb.show.cli.main import main


def written(form, number="3"):
    """A text of a form, everything in brackets given."""
    return re.sub(
        r"[A-Z]+", lambda name: "0.125" if "TOL" in name[0] else number, form.replace("[", "").replace("]", "")
    )


def concrete(kind):
    for child in kind.__subclasses__():
        yield from concrete(child)
        if child.__module__.startswith("symmb.") and not inspect.isabstract(child):
            yield child


def test_every_method_and_solver_has_a_spec():
    made = {type(specs.method(written(spec.form))) for spec in specs.METHODS}
    made |= {type(specs.solver(written(spec.form))) for spec in specs.SOLVERS}
    assert made == {*concrete(Method), *concrete(Solver)}


@pytest.mark.parametrize("spec", specs.METHODS, ids=lambda spec: spec.form)
def test_a_methods_spec_reads_as_its_text_says(spec):
    text = re.sub(r"(R?TOL)|[A-Z]{4,}", lambda name: "0.125" if name[1] else "3", spec.text)
    read = repr(specs.method(written(spec.form)))
    assert text.removesuffix(", adaptive") in (read, read.replace("(3)", "(order=3)"))


def test_help_prints_the_table(capsys):
    for arguments in (["--help"], ["compare", "--help"]):
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        assert stop.value.code == 0
        shown = capsys.readouterr().out
        for spec in (*specs.METHODS, *specs.SOLVERS):
            assert spec.form in shown and spec.text in shown


@pytest.mark.parametrize(
    ("text", "solver"),
    [
        ("cvodes:stiff", mb.CVODES(stiff=True)),
        ("cvodes:1e-6:stiff:projection", mb.CVODES(1e-6, stiff=True, stabilization=mb.Projection())),
        ("dopri:1e-8:baumgarte", mb.DormandPrince(1e-8, stabilization=mb.Baumgarte())),
        ("rosenbrock:lagrangian", mb.Rosenbrock(stabilization=mb.AugmentedLagrangian())),
    ],
)
def test_words_of_solvers(text, solver):
    assert specs.solver(text) == solver


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stiff", "Write the name of a solver first"),
        ("dopri:projection:baumgarte", "sets an option twice"),
        ("dopri:stiff", "has no option 'stiff'"),
        ("idas:lagrangian", "for solvers that eliminate the multipliers"),
    ],
)
def test_wrong_words_of_solvers(text, message):
    with pytest.raises(mb.DeclarationError, match=message):
        specs.solver(text)
