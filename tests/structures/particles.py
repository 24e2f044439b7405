"""A flexible body of particles with shapes, and its motion by d'Alembert's principle, without any invariants."""

import casadi as ca
import numpy as np

import symmb as mb


def particle_modes(n: int, planar: bool = False, seed: int = 0) -> tuple[mb.Modes, np.ndarray, np.ndarray, np.ndarray]:
    """Modes of 12 particles with random shapes of unit modal mass; masses (g,), places (g, 3) and shapes (g, 3, n)."""
    rng = np.random.default_rng(seed)
    masses, places = rng.uniform(0.5, 1.5, 12), rng.normal(size=(12, 3))
    shapes = rng.normal(size=(12, 3, n))
    if planar:
        places[:, 2] = shapes[:, 2] = 0.0
    gram = np.einsum("g,gkj,gki->ji", masses, shapes, shapes)
    shapes = shapes @ np.linalg.inv(np.linalg.cholesky(gram)).T
    eye = np.eye(3)

    def inertia(X: np.ndarray) -> np.ndarray:
        return np.trace(X, axis1=-2, axis2=-1)[..., None, None] * eye - X

    K = np.einsum("g,gk,glj->jkl", masses, places, shapes)
    KK = np.einsum("g,gki,glj->ijkl", masses, shapes, shapes)
    levi = np.array([[[(i - j) * (j - k) * (k - i) / 2 for k in range(3)] for j in range(3)] for i in range(3)])
    modes = mb.Modes(
        mass=masses.sum(),
        center=masses @ places / masses.sum(),
        J0=inertia(np.einsum("g,gk,gl->kl", masses, places, places)),
        J1=inertia(K + K.swapaxes(1, 2)),
        J2=inertia((KK + KK.swapaxes(2, 3)) / 2),
        S=np.einsum("g,gkj->kj", masses, shapes),
        G0=np.einsum("akl,g,gk,glj->aj", levi, masses, places, shapes),
        G1=np.einsum("akl,g,gki,glj->iaj", levi, masses, shapes, shapes),
        stiffness=rng.uniform(50, 100, n),
        damping=rng.uniform(0, 0.5, n),
        origin=np.zeros(3),
        positions=places,
        shapes=shapes,
        rotations=np.zeros((12, 3, n)),
        S2=np.zeros((3, n, n)),
        shapes2=np.zeros((12, 3, n, n)),
    )
    return modes, masses, places, shapes


def accelerations(body: mb.FlexibleBody, masses: np.ndarray, gravity: np.ndarray) -> ca.Function:
    """(q, v) -> v' of a free body by the virtual power of its particles, all rates by CasADi from their positions."""
    m, q, v, rate = body.modes, body.frame.q, body.frame.v, body.frame.rate
    vdot = ca.SX.sym("vdot", v.numel())
    virtual = ca.SX(v.numel(), 1)
    for k, mass in enumerate(masses):
        r = body.node(k).r
        velocity = ca.jtimes(r, q, rate)
        acceleration = ca.jtimes(velocity, q, rate) + ca.jtimes(velocity, v, vdot)
        virtual += ca.jacobian(velocity, v).T @ (mass * (acceleration - gravity))
    n = len(m.stiffness)
    eta = q[-n:]
    elastic = ca.SX(m.stiffness) * eta + ca.SX(m.damping) * v[-n:]
    virtual += ca.vertcat(ca.SX(v.numel() - n, 1), elastic)
    A, b = ca.jacobian(virtual, vdot), ca.substitute(virtual, vdot, ca.SX.zeros(v.numel()))
    return ca.Function("accelerations", [q, v], [A, b])
