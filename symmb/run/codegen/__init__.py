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

from importlib import import_module
from typing import TYPE_CHECKING, Any

from symmb.run.codegen import cache
from symmb.run.codegen.build import (
    SLOW,
    NoCompilerError,
    compiler_advice,
    has_compiler,
    load,
    portable_library,
    require_compiler,
    web_module,
    with_compiler,
)
from symmb.run.codegen.c_source import C_FOLDER, Tables, c_fields, c_number, c_source, c_tables
from symmb.run.codegen.contacts import BLAMED, CLOSES, IMPACT, OPENS, Contacts
from symmb.run.codegen.engine import MOST_PASSES, Engine, FailedSamples, FixedStep, Lanes, StepEnds, StepTolerances
from symmb.run.codegen.failures import REASONS, FailureCode
from symmb.run.codegen.model_source import Scheme, model_function, scheme_function
from symmb.run.codegen.scene_source import SceneSource, quoted, scene_source
from symmb.run.codegen.threads import cores, on_threads, side_by_side

if TYPE_CHECKING:
    from symmb.run.codegen.card import Card, CardEngine, CudaCard, Summary


def __getattr__(name: str) -> Any:
    if name not in ("Card", "CardEngine", "CudaCard", "Summary"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("symmb.run.codegen.card"), name)  # loaded where a graphics card is asked for
