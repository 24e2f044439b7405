"""Names of coordinates and constraints in messages."""

from symmb._types import Array
from symmb.equations.model import DAE


def coordinate_of(dae: DAE, displacement: int) -> str:
    """Name of the coordinate that a displacement moves."""
    body, _, part = dae.v_names[displacement].rpartition(".")
    part = "theta" if part == "omega" else part.replace("omega_", "rotation_")
    return f"{body}.{part.removeprefix('v') if part in ('vx', 'vy', 'vz') else part}"


def coordinate_with_value(dae: DAE, displacement: int, q: Array) -> str:
    """Name and value of the coordinate that a displacement moves; only the name for a spatial rotation."""
    name = coordinate_of(dae, displacement)
    return f"{name} = {q[dae.q_names.index(name)]:.6g}" if name in dae.q_names else name


def constraint_of_row(dae: DAE, row: int) -> str:
    """Name of the constraint of a row."""
    return next(name for name, rows in dae.rows.items() if rows.start <= row < rows.stop)
