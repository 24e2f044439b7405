"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .advice import advice as advice, reminder as reminder
from .equilibrium import find_equilibrium as find_equilibrium, imbalance as imbalance, is_stable as is_stable
from .joint_start import start_in_joints as start_in_joints
from .preparation import prepare_start as prepare_start, with_gated_rows as with_gated_rows
from .rank import independent_rows_and_columns as independent_rows_and_columns
from .singularity import Singularity as Singularity, singularity as singularity
from .start import Start as Start
