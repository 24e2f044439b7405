"""Slider-crank with an elastic connecting rod. The crank is driven at 150 rad/s.

            o  ~ ~
     l1   /    `  ~  l2, elastic
        / 150 t    `  ~
    ===o. . . . . . . .`[m3]. . > x        no gravity
       |                =======

The rod's frame is clamped to the crank pin and points to the wrist pin. The rod has four shapes. Two are sine functions
across the rod. Two are quadratic functions along the rod, of a finite element with a node at half length.

Source: Simeon, Modelling a flexible slider crank mechanism by a mixed system of DAEs and PDEs, Math. Modelling of
Systems 2 (1996); problem "crank" of the Test Set for IVP Solvers. The program of this problem omits the factor 1/15 in
the masses of the shapes along the rod, and uses pi = 3.1415927.
"""

import casadi as ca
import numpy as np
from scipy.linalg import eigh

import symmb as mb

OMEGA = 150.0
L1, L2 = 0.15, 0.3
M1, M2, M3 = 0.36, 0.151104, 0.075552
J1, J2 = 0.002727, 0.0045339259
YOUNG, HEIGHT, WIDTH, DENSITY = 2e11, 0.008, 0.008, 7870.0


def rod_modes(*, published: bool = False) -> tuple[mb.Modes, np.ndarray]:
    """Modes of the rod, and the amplitudes (4, 4) of its shapes in each mode [kg^-1/2].

    Parameters
    ----------
    published : bool       True: modes as in the program that computed the published solution
    """
    pi, share = (3.1415927, 1.0) if published else (np.pi, 1 / 15)
    mass = DENSITY * WIDTH * HEIGHT * L2
    bending = pi**4 / 24 * (HEIGHT / L2) ** 2
    stiffness = WIDTH * HEIGHT * YOUNG / L2 * np.array(
        [[bending, 0, 0, 0], [0, 16 * bending, 0, 0], [0, 0, 16 / 3, -8 / 3], [0, 0, -8 / 3, 7 / 3]]
    )  # fmt: skip
    gram = mass * np.array([[0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 8 * share, share], [0, 0, share, 2 * share]])
    squares, shapes = eigh(stiffness, gram)
    along, across = mass * np.array([0, 0, 2 / 3, 1 / 6]), mass * np.array([2 / pi, 0, 0, 0])
    x_along, x_across = mass * L2 * np.array([0, 0, 1 / 3, 1 / 6]), mass * L2 * np.array([1 / pi, -0.5 / pi, 0, 0])
    # Integrals of a shape across times a shape along. The moment of momentum u_x v_y - u_y v_x consists of them.
    mixed = np.zeros((4, 4))
    mixed[:2, 2:] = mass * np.array([[16 / pi**3, 1 / pi - 8 / pi**3], [0, -0.5 / pi]])
    n, turn = 4, np.array([0.0, 0.0, 1.0])
    zz = np.zeros((n, n, 3, 3))
    zz[:, :, 2, 2] = np.eye(n)
    J = np.diag([0.0, J2, J2])
    at_nodes = np.zeros((3, 3, n))
    at_nodes[1] = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 0]]
    at_nodes[2, 0, 3] = 1.0
    S = np.array([along, across, np.zeros(n)]) @ shapes
    return mb.Modes(
        mass=M2,
        center=np.array([L2 / 2, 0.0, 0.0]),
        J0=J,
        J1=2 * np.einsum("j,kl->jkl", x_along @ shapes, np.outer(turn, turn)),
        J2=zz,
        S=S,
        G0=np.outer(turn, x_across @ shapes),
        G1=np.einsum("ij,k->ikj", shapes.T @ (mixed.T - mixed) @ shapes, turn),
        stiffness=squares,
        damping=np.zeros(n),
        origin=np.zeros(3),
        positions=np.array([[0.0, 0, 0], [L2 / 2, 0, 0], [L2, 0, 0]]),
        shapes=at_nodes @ shapes,
        rotations=np.zeros((3, 3, n)),
        S2=np.zeros((3, n, n)),
        shapes2=np.zeros((3, 3, n, n)),
    ), shapes


def scene(
    *,
    published: bool = False,
    amplitudes: tuple[float, ...] = (0.0, 0.0, 1.03339863e-5, 1.69327969e-5),
    rates: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
    offset: float = 0.0,
) -> mb.Scene:
    """More than two turns of the crank.

    Parameters
    ----------
    published : bool       True: modes as in the program that computed the published solution
    amplitudes, rates      amplitudes [m] and rates [m/s] of the four shapes of the rod at the start
    offset : float         position of the wrist pin along the guide, from the slider's centre [m]
    """
    p = mb.Parameters(m3=M3)
    modes, shapes = rod_modes(published=published)
    back = np.linalg.inv(shapes)
    ground = mb.Ground()
    crank = mb.Body("crank", mass=M1, inertia=J1 - M1 * L1**2 / 4)
    rod = mb.FlexibleBody("rod", modes, mb.Planar())
    slider = mb.Body("slider", mass=p.m3, inertia=p.m3 * HEIGHT**2)  # it never turns
    system = mb.System(
        crank,
        rod,
        slider,
        mb.Revolute("main", ground.point(0, 0), crank.point(-L1 / 2, 0)),
        mb.Revolute("pin", crank.point(L1 / 2, 0), rod.node(0)),
        mb.Revolute("wrist", rod.node(2), slider.point(offset, 0)),
        mb.Prismatic("guide", ground.point(0, 0), slider.point(0, 0), axis=(1, 0, 0)),
        mb.Motion("drive", crank.theta, OMEGA * mb.t),
        parameters=p,
    )
    eta, eta_dot = back @ np.array(amplitudes), back @ np.array(rates)
    start = {f"rod.eta{j + 1}": float(eta[j]) for j in range(4)}
    start |= {f"rod.eta{j + 1}_dot": float(eta_dot[j]) for j in range(4)}
    q = ca.DM(shapes) @ rod.eta
    return mb.Scene(
        system,
        start=start,
        guess={"slider.x": L1 + L2, "rod.x": L1},
        times=np.linspace(0.0, 0.1, 101),
        outputs={
            "rod_theta": rod.theta,
            "slider_x": slider.x,
            "middle_across": q[0],
            "across_2": q[1],
            "middle_along": q[2],
            "tip_along": q[3],
        },
        box=mb.Box.around(p, 0.05),
        name="slider_crank_flexible",
    )
