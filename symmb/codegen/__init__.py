"""C from CasADi expressions: generation, compilation, cache, and runs of many samples in parallel.

The fixed parts of the C are in the folder c.
"""

from symmb.codegen import cache
from symmb.codegen.build import (
    SLOW,
    NoCompilerError,
    compiler_advice,
    has_compiler,
    load,
    portable_library,
    require_compiler,
    with_compiler,
)
from symmb.codegen.c_source import C_FOLDER, c_number, c_source
from symmb.codegen.contacts import BLAMED, CLOSES, IMPACT, OPENS, Contacts
from symmb.codegen.engine import MOST_PASSES, Engine, FailedSamples, FixedStep, Lanes, StepEnds, Tolerances
from symmb.codegen.failures import REASONS, FailureCode
from symmb.codegen.model_source import Scheme, model_function, scheme_function
from symmb.codegen.scene_source import SceneSource, scene_source
from symmb.codegen.threads import cores, on_threads, side_by_side
