"""From a declaration to a differential-algebraic equation and a consistent start.

In:   elements of `declare`, in a System; start, times and outputs, in a Scene; and a Box of uncertain parameters.
Out:  M, Q, Phi, Phi_q and gamma as functions of CasADi, in coordinates of bodies or of joints, and states that satisfy
      the constraints.

model   System, Scene, Box; the equations, also as C code and as text
start   positions, velocities and equilibria that satisfy the constraints; the rank of the constraints

Equations are derived at their first use. The scene remembers the derived equations.
"""
