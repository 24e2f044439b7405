"""From equations to runs, and to warnings about these runs.

In:   the equations and the start of a scene, a solver, and samples of the parameters.
Out:  a Trajectory of one run, or the outputs of many runs in parallel; linearizations; warnings.

schemes        time steps as data: tableaus, and the formulas of implicit steps
codegen        C code of a model with fixed loops from `c`, the cache of such code, and the engine that runs it
events         impacts, switches and pulses, at which a motion is not smooth
integrate      solvers
formulations   equations, start and outputs in the same coordinates, and the Program that runs them
verification   checks of runs: drift, energy, noise and a second solver
simulation     `simulate`, `prepare`, `sweep`, sensitivities: the choice of the solver, and runs of a scene
linear         linearization, modes and steady motions

Scene -> Formulations -> Program -> Trajectory, or outputs of samples. A Program is a scene with a solver and times. A
Program never changes, and compiles at its first use. One run, in `simulation.single_run`: choose the solver by pilot
runs, make the program, run it, examine the run. Many runs: a study calls `run(P)` of a DAESimulator with a program.
"""
