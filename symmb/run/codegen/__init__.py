"""C code from CasADi expressions: generation, compilation, cache, and runs of many samples in parallel.

The generator writes the model of a scene before the text of fixed files in the folder c:

block, begin, ensemble       samples that share their steps, the start of these samples, and all blocks of an ensemble
embedded_pair                steps of DormandPrince and EventDriven. `accept_step` rejects a step with a large error,
                             `take_step` rejects a step with a large error of the dense output, or with a passed switch
fixed_step, implicit_step    RungeKutta, and implicit schemes; implicit_step can also reject a step
switches, impacts            ends of steps at kinks and jumps, and at contacts that close and open
projection                   projection onto constraints
model, step_control, tableau examples of what the generator writes
one_run, scene, fmu, main    one run, and exported programs and FMUs
scalar, kernel               the same sources on graphics cards, with one sample in each thread
dense_search, polynomial_ranges, tensor_fit   ranges and fits of polynomials
"""

from symmb._doors import open_door

open_door(__name__)
