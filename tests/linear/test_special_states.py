"""Linearisations of redundant loops, spinning bodies and repeated eigenvalues against closed forms."""

import numpy as np
import pytest

import symmb as mb


@pytest.mark.parametrize("coordinates", [None, "body"])
def test_a_redundant_loop(coordinates):
    """A bar that hangs on three parallel cranks, of which one is redundant, swings as a pendulum."""
    ground, bar = mb.Ground(), mb.Body("bar", 2.0, 5.0)
    elements, guess = [bar, mb.Gravity(0, -9.81)], {"bar.y": -1.0}
    for k, x in enumerate((-1.0, 0.0, 1.0)):
        crank = mb.Body(f"crank{k}", 1.0, 1 / 12)
        top = mb.Revolute(f"top{k}", ground.point(x, 0), crank.point(0, 0.5))
        elements += [crank, top, mb.Revolute(f"foot{k}", crank.point(0, -0.5), bar.point(x, 0))]
        guess |= {f"crank{k}.x": x, f"crank{k}.y": -0.5}
    scene = mb.Scene(mb.System(*elements), {"crank0.theta": 0.0}, guess=guess, coordinates=coordinates)
    assert 2 * np.pi * mb.linearize(scene).frequencies == pytest.approx([np.sqrt(9.81 * 3.5 / 3)], rel=1e-9)


def test_a_body_that_spins_freely():
    """Euler's equations about principal axes with inertias 1, 2, 3: the middle one is unstable."""
    body = mb.Body("body", 1.0, (1.0, 2.0, 3.0), mb.Spatial())
    axes = {(0.0, 2.0, 0.0): np.sqrt(1 / 3), (0.0, 0.0, 2.0): 1j * np.sqrt(1 / 1), (2.0, 0.0, 0.0): 1j * np.sqrt(1 / 3)}
    for omega, rate in axes.items():
        lin = mb.linearize(mb.Scene(mb.System(body), {"body.omega": omega}))
        assert np.abs(lin.eigenvalues - 2 * rate).min() < 1e-9
        assert (lin.stability == "unstable") == (omega[1] > 0)


def test_repeated_eigenvalues_keep_their_modes():
    p = mb.Parameters(k=9.0)
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    motion = ((mass.x, mass.vx), (mass.y, mass.vy), (mass.z, mass.vz))
    law = mb.Force("law", mass.point(0, 0, 0), tuple(-p.k * place - 0.4 * rate for place, rate in motion))
    lin = mb.linearize(mb.Scene(mb.System(mass, law, parameters=p)))
    assert 2 * np.pi * lin.frequencies == pytest.approx([3.0, 3.0, 3.0], rel=1e-9)
    shapes = np.array([[abs(amplitude) for amplitude in mode.shape.values()] for mode in lin.modes])
    assert np.linalg.matrix_rank(shapes) == 3


@pytest.mark.parametrize("values", [(1.0, 1.0, 1e160), (1e-98, 1e150, 1e170), (1.0, 1.0, 1.7e308)])
def test_strong_dampers_do_not_overflow(values):
    """The fast eigenvalue is -c/m. Squares of such numbers overflow."""
    m, k, c = values
    p = mb.Parameters(m=m, k=k, c=c)
    mass = mb.Body("mass", p.m, 1.0)
    slide = mb.Prismatic("slide", mb.Ground().point(0, 0), mass.point(0, 0), (1, 0))
    law = mb.Force("law", mass.point(0, 0), (-p.k * mass.x - p.c * mass.vx, 0))
    found = mb.linearize(mb.Scene(mb.System(mass, slide, law, parameters=p))).eigenvalues
    assert found[1] == pytest.approx(-c / m, rel=1e-9) and abs(found[0]) <= 1e-13 * c / m
