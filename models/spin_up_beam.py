"""Cantilever that is spun up about its root, in the plane. Centrifugal forces stiffen the beam.

                               .- '
       psi(t)            . - '     tip
        _       . - '
       (o)==- '
      ////

The root follows psi' = omega_s/t_s (t - t_s/(2 pi) sin(2 pi t/t_s)) up to t_s, and omega_s afterwards. Without
geometric stiffening the modes lose their stiffness near 3.8 rad/s and the motion diverges.

Source: Simo and Vu-Quoc, On the dynamics of flexible beams under large overall motions, J. Appl. Mech. 53 (1986).
"""

import casadi as ca
import numpy as np

import symmb as mb

LENGTH, AXIAL, SHEAR, BENDING, LINE_MASS = 10.0, 2.8e7, 1.0e7, 1.4e4, 1.2
SPEED, RISE = 6.0, 15.0


def modes(count: int, *, stiffening: bool = True) -> mb.Modes:
    """Modes of the cantilever in the plane."""
    area = 1.0  # any value: stiffnesses and mass per metre define the beam
    section = mb.Section(area, BENDING / AXIAL, BENDING / AXIAL, 2 * BENDING / AXIAL).without_shear()
    material = mb.Material(E=AXIAL / area, density=LINE_MASS / area, nu=0.3)
    beam = mb.Beam([(0, 0, 0), (LENGTH, 0, 0)], section, material, elements=20)
    return mb.FiniteElements.beams(beam).modes(count=count, clamped=0, stiffening=stiffening, planar=True)


def scene(*, count: int = 3, stiffening: bool = True) -> mb.Scene:
    """Twenty seconds of spin-up.

    Parameters
    ----------
    count : int            number of modes of the beam
    stiffening : bool      whether bending shortens the beam (geometric stiffening)
    """
    p = mb.Parameters(omega_s=SPEED)
    ground = mb.Ground()
    beam = mb.FlexibleBody("beam", modes(count, stiffening=stiffening), mb.Planar())
    rising = p.omega_s / RISE * (mb.t**2 / 2 + (RISE / (2 * ca.pi)) ** 2 * (ca.cos(2 * ca.pi * mb.t / RISE) - 1))
    steady = p.omega_s * (mb.t - RISE / 2)
    system = mb.System(
        beam,
        mb.Revolute("root", ground.point(0, 0), beam.point(0, 0)),
        mb.Motion("spin", beam.theta, ca.if_else(mb.t < RISE, rising, steady)),
        parameters=p,
    )
    tip = beam.point(LENGTH, 0)
    along, across = ca.vertsplit((beam.rotation.T @ tip.r)[:2])
    return mb.Scene(
        system,
        times=np.linspace(0.0, 20.0, 401),
        outputs={"u1": along - LENGTH, "u2": across, "tip_x": tip.x, "tip_y": tip.y, "psi": beam.theta},
        box=mb.Box.around(p, 0.05),
        name="spin_up_beam",
    )
