"""From equations to runs, and to what of a run can be trusted.

In:   the equations and the start of a scene, a solver, and samples of the parameters.
Out:  a Trajectory of one run, or outputs of many side by side; linearizations; warnings.

schemes        time steps as data: tableaus, and the formulas of implicit steps
codegen        C of a model around fixed loops, its cache, and the engine that runs it; `c` holds the loops
events         impacts, switches and pulses: when a motion is not smooth
integrate      solvers
formulations   equations, start and outputs in the same coordinates, and the Program that runs them
verification   drift, energy, noise and a second way: what a run says about itself
simulation     `simulate`, `prepare`, `sweep`, sensitivities: which solver, and runs of a scene
linear         linearization, modes and steady motions

Scene -> Formulations -> Program -> Trajectory, or outputs of samples. A Program is a scene with a solver and times; it
never changes, and compiles at its first use. The way of one run, in `simulation.single_run`: choose the solver by pilot
runs, make its program, run it, examine the run. The way of many: a study asks a DAESimulator, which has a program, for
`run(P)`.
"""
