"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .between_times import with_peaks as with_peaks
from .contributions import Contributions as Contributions, contributions_of as contributions_of
from .envelope import Envelope as Envelope
from .laws import Correlation as Correlation, Laws as Laws, given_once as given_once, laws_text as laws_text
from .limits import (
    WARNED as WARNED,
    KeptLimit as KeptLimit,
    LimitCheck as LimitCheck,
    Limits as Limits,
    closest as closest,
    joined_limits as joined_limits,
    kept_limit as kept_limit,
    limit_pairs as limit_pairs,
    limit_text as limit_text,
    other_side as other_side,
    unit_suffix as unit_suffix,
)
from .probabilities import (
    Probability as Probability,
    Quantiles as Quantiles,
    probability_of as probability_of,
    quantiles_of as quantiles_of,
    samples_of as samples_of,
)
from .result import Bounds as Bounds
from .result_file import (
    INNER as INNER,
    Kind as Kind,
    box_coordinates as box_coordinates,
    box_entries as box_entries,
    box_of as box_of,
    inner_entries as inner_entries,
    kind_of as kind_of,
)
from .statistical import (
    Statistics as Statistics,
    laws_within as laws_within,
    rejects_of as rejects_of,
    statistics_of as statistics_of,
)
