"""Euler-Bernoulli beams as flexible bodies in joints: the first four frequencies against characteristic equations."""

import numpy as np
import pytest

import symmb as mb

ROOTS = {
    "clamped-free": [1.8751040687119612, 4.6940911329741746, 7.8547574382376126, 10.995540734875467],
    "free-free": [4.7300407448627040, 7.8532046240958376, 10.995607838001671, 14.137165491257464],
    "clamped-clamped": [4.7300407448627040, 7.8532046240958376, 10.995607838001671, 14.137165491257464],
    "clamped-pinned": [3.9266023120479188, 7.0685827456287321, 10.210176122813031, 13.351768777754093],
    "pinned-free": [3.9266023120479188, 7.0685827456287321, 10.210176122813031, 13.351768777754093],
    "pinned-pinned": [np.pi, 2 * np.pi, 3 * np.pi, 4 * np.pi],
    "clamped-mass": [1.2479174096064695, 4.0311394367149595, 7.1341322409397458, 10.256621073714029],
}
"""beta L of cos(bL) cosh(bL) = -1, 1, tan(bL) = tanh(bL), and of a cantilever with its own mass at the tip; roots by
mpmath (Blevins, Formulas for Natural Frequency and Mode Shape, 1979, table 8-1)."""
JOINTS = {"clamped": mb.Weld, "pinned": mb.Revolute}
STEEL, LENGTH, ELEMENTS = mb.Material(E=2.1e11, nu=0.3, density=7850.0), 1.0, 40


@pytest.mark.parametrize("ends", ROOTS)
def test_four_frequencies(ends):
    section = mb.Section.circle(2e-4).without_shear()
    mesh = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (LENGTH, 0, 0)], section, STEEL, elements=ELEMENTS))
    beam = mb.FlexibleBody("beam", mesh.modes([0, ELEMENTS], count=20, planar=True), mb.Planar())
    elements, guess, ground = [beam], {"beam.x": LENGTH / 2}, mb.Ground()
    for x, end in zip((0.0, LENGTH), ends.split("-"), strict=True):
        if end in JOINTS:
            elements.append(JOINTS[end](f"at_{x:g}", ground.point(x, 0), beam.point(x, 0)))
        elif end == "mass":
            tip = mb.Body("tip", mass=STEEL.density * section.area * LENGTH, inertia=1e-12)
            elements += [tip, mb.Weld("end", beam.point(x, 0), tip.point(0, 0))]
            guess |= {"tip.x": x}
    lin = mb.linearize(mb.Scene(mb.System(*elements), guess=guess, times=[0.0, 1.0]))
    rate = np.sqrt(STEEL.E * section.Iz / (STEEL.density * section.area * LENGTH**4))
    np.testing.assert_allclose(2 * np.pi * lin.frequencies[:4], np.square(ROOTS[ends]) * rate, rtol=1e-4)
