"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .dae_simulator import DAESimulator as DAESimulator
from .derivatives import has_exact_jets as has_exact_jets
from .differences import HIGHEST_OF_DIFFERENCES as HIGHEST_OF_DIFFERENCES, differences as differences
from .figure_simulator import (
    FigureSimulator as FigureSimulator,
    SceneSimulator as SceneSimulator,
    motion_of as motion_of,
    never_holds as never_holds,
)
from .random_simulator import RandomSimulator as RandomSimulator
from .sensitivities import Sensitivities as Sensitivities, sensitivities as sensitivities
from .single_run import parameter_values as parameter_values, simulate as simulate
from .subject import (
    Device as Device,
    Subject as Subject,
    chosen_parameters as chosen_parameters,
    prepare as prepare,
    scene_of as scene_of,
)
from .sweep import Sweep as Sweep, side_by_side as side_by_side, sweep as sweep
from .trajectory import Trajectory as Trajectory
from .trajectory_file import PLAIN as PLAIN, labelled as labelled, of_record as of_record, of_table as of_table
