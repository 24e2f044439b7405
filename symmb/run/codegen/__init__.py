"""C from CasADi expressions: generation, compilation, cache, and runs of many samples in parallel.

The fixed parts of the C are in the folder c.
"""

from symmb.run.codegen import cache
from symmb.run.codegen.build import (
    SLOW,
    NoCompilerError,
    compiler_advice,
    has_compiler,
    load,
    portable_library,
    require_compiler,
    with_compiler,
)
from symmb.run.codegen.c_source import C_FOLDER, c_fields, c_number, c_source
from symmb.run.codegen.contacts import BLAMED, CLOSES, IMPACT, OPENS, Contacts
from symmb.run.codegen.engine import MOST_PASSES, Engine, FailedSamples, FixedStep, Lanes, StepEnds, Tolerances
from symmb.run.codegen.failures import REASONS, FailureCode
from symmb.run.codegen.model_source import Scheme, model_function, scheme_function
from symmb.run.codegen.scene_source import SceneSource, scene_source
from symmb.run.codegen.threads import cores, on_threads, side_by_side
