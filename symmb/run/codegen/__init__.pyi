"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .build import (
    SLOW as SLOW,
    NoCompilerError as NoCompilerError,
    compiler_advice as compiler_advice,
    has_compiler as has_compiler,
    load as load,
    portable_library as portable_library,
    require_compiler as require_compiler,
    web_module as web_module,
    with_compiler as with_compiler,
)
from .c_source import (
    C_FOLDER as C_FOLDER,
    Tables as Tables,
    c_fields as c_fields,
    c_number as c_number,
    c_source as c_source,
    c_tables as c_tables,
)
from .card import Card as Card, CardEngine as CardEngine, CudaCard as CudaCard, Summary as Summary
from .contacts import BLAMED as BLAMED, CLOSES as CLOSES, IMPACT as IMPACT, OPENS as OPENS, Contacts as Contacts
from .engine import (
    MOST_PASSES as MOST_PASSES,
    Engine as Engine,
    FailedSamples as FailedSamples,
    FixedStep as FixedStep,
    Lanes as Lanes,
    StepEnds as StepEnds,
    StepTolerances as StepTolerances,
)
from .failures import REASONS as REASONS, FailureCode as FailureCode
from .model_source import Scheme as Scheme, model_function as model_function, scheme_function as scheme_function
from .scene_source import SceneSource as SceneSource, quoted as quoted, scene_source as scene_source
from .threads import cores as cores, on_threads as on_threads, side_by_side as side_by_side
