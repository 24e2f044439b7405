"""What a user declares: frozen values that hold expressions, and no equations of motion yet.

In:   numbers, expressions of CasADi or SymPy, and files of robots, meshes and finite elements.
Out:  parameters, bodies, joints, forces, contacts and quantities of time, each with its own part of the equations.

symbolic     expressions: the border to SymPy, switches, ranges, factorizations, evaluation of many samples
structures   finite elements, beams, and the modes of a flexible body
mechanics    bodies, joints, forces, contacts, outputs; `robots` reads URDF and MJCF

An element says what it adds: terms of M, forces, or rows of constraints. Nothing here knows the whole system.
"""
