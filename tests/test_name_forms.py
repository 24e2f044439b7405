"""Names have one form, that of Python's identifiers, wherever they come in."""

import pickle
import random
import sys
import time
import unicodedata

import numpy as np
import pytest
from faults import refused
from scipy.stats import uniform

import symmb as mb
from symmb._names import name_faults, normal

SAME = [
    ("\u00b5", "\u03bc"), ("\u212a", "K"), ("\ufb01", "fi"), ("e\u0301", "\u00e9"), ("\u017f", "s"),
    ("\u1d65", "v"),
]  # fmt: skip
TIMES = np.array([0.0, 1.0])


def spring(name):
    """A mass on a spring, whose names are made of one."""
    p, bob = mb.Parameters(**{name: 2.0}), mb.Body(f"b{name}", 1.0, pose=mb.Particle())
    element = mb.Spring(f"s{name}", mb.Ground().point(0, 0), bob.point(0, 0), getattr(p, name))
    return mb.Scene(mb.System(bob, element, parameters=p), {f"b{name}.x": 1.0}, TIMES, {f"x{name}": bob.x})


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_two_forms_of_a_name_are_one_at_every_entrance(one, other, tmp_path):
    scene = spring(one)
    p = scene.system.parameters
    assert [*p] == [other] and p[one] == p[other] == 2.0 and getattr(p, one).name() == other
    run = mb.simulate(scene, mb.CVODES(), parameters={one: 3.0})
    again = mb.simulate(spring(other), mb.CVODES(), parameters={other: 3.0})
    assert run[f"x{one}"].tobytes() == again[f"x{other}"].tobytes()
    assert str(scene.system.force(f"s{one}")) == str(scene.system.force(f"s{other}"))
    assert mb.Box(**{one: (1.0, 2.0)}) == mb.Box(**{other: (1.0, 2.0)}) == mb.Box.plus_minus({one: 1.5}, **{other: 0.5})
    assert mb.sweep(scene, {one: [1.0]}, solver=mb.CVODES())[f"x{other}"].shape == (1, 2)
    (tmp_path / "table.csv").write_text(f"name,nominal,plus\n{one},1.5,0.5\n", encoding="utf-8")
    assert mb.Box.read(tmp_path / "table.csv", {other: 1.5})[one] == (1.0, 2.0)
    f = mb.FunctionSimulator(lambda **values: values[other], {one: 1.0}, [0.0], [one])
    assert mb.propagate(f, mb.Vertex(), mb.Box(**{other: (0.0, 1.0)})).check({one: (None, 0.5)}).kept is False


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_laws_know_both_forms(one, other):
    f = mb.FunctionSimulator(lambda **values: values[other], {one: 1.0}, [0.0], ["y"])
    box, law = mb.Box(**{one: (0.0, 1.0)}), uniform(0.0, 1.0)
    bounds = mb.propagate(f, mb.PolynomialChaos(), box)
    found = [bounds.quantiles("y", [0.3], laws={name: law}).lower.tobytes() for name in (one, other)]
    assert found[0] == found[1]
    for sampling in (mb.MonteCarlo(9, laws={name: law}) for name in (one, other)):
        assert mb.propagate(f, sampling, box)["y"][0].shape == (1,)
    refused("twice", bounds.probability, "y", above=0.5, laws={one: law, other: law})


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_results_are_looked_up_in_both_forms(one, other, tmp_path):
    scene = spring(one)
    other_p = scene.system.parameters.with_nominal({one: 3.0})
    run = mb.simulate(scene, mb.CVODES())
    run.save(tmp_path / "run.json")
    fit = mb.calibrate(scene, {f"x{one}": run.values[:, 0]}, solver=mb.CVODES(), noise={f"x{one}": 0.1})
    linear = mb.linearize(scene)
    f = mb.FunctionSimulator(lambda **values: np.array([values[other]]), {one: 1.0}, [0.0], [one])
    widest = mb.tolerances(f, {one: (0.5, None)}, mb.Box(**{one: (0.9, 1.1)}), costs={one: lambda h: 1 / h})
    dictionaries = [run.parameters, mb.Trajectory.load(tmp_path / "run.json").parameters, fit.parameters, fit.laws]
    dictionaries += [fit.deviations, linear.parameters, widest.factors, widest.nominal, f.parameters]
    dictionaries += [mb.sweep(f, {one: [1.0]}).parameters, pickle.loads(pickle.dumps(fit)).parameters]
    for known in dictionaries:
        assert [*known] == [other] and known[one] is known[other] is known.get(one) and one in known
        assert known == dict(known) and "none" not in known and known.get("none", 5) == 5
        with pytest.raises(KeyError):
            known["none"]
    assert other_p[one] == 3.0 and fit.noise[f"x{one}"] == 0.1


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_two_forms_at_once_are_refused(one, other):
    bodies = [mb.Body(name, 1.0, pose=mb.Particle()) for name in (one, other)]
    scene = spring(one)
    for call in (
        lambda: mb.Parameters(**{one: 1.0, other: 2.0}),
        lambda: mb.Box(**{one: (0, 1), other: (1, 2)}),
        lambda: scene.with_outputs({one: bodies[0].x, other: bodies[0].x}),
        lambda: mb.simulate(scene, parameters={one: 1.0, other: 2.0}),
        lambda: mb.System(*bodies),
        lambda: mb.FunctionSimulator(len, {"a": 1.0}, [0.0], [one, other]),
    ):
        refused("twice", call)


def test_letters_have_the_form_of_identifiers_and_other_signs_stay():
    choice, letters = random.Random(0), [chr(k) for k in range(sys.maxunicode) if f"_{chr(k)}".isidentifier()]
    for _ in range(2000):
        word = "".join(choice.choices(letters, k=4))
        assert normal(word) == unicodedata.normalize("NFKC", word) == normal(normal(word))
    assert [normal(name) for name in ("v²", "CO₂", "½", "a–b")] == ["v²", "CO₂", "½", "a–b"]


def test_many_names_are_checked_in_a_moment():
    begin = time.process_time()
    assert name_faults([f"y{k}" for k in range(20_000)]) == []
    assert time.process_time() - begin < 1.0
