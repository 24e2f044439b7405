"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .contributions import Contributions as Contributions
from .envelope import Envelope as Envelope
from .laws import Correlation as Correlation, Laws as Laws, given_once as given_once, laws_text as laws_text
from .limits import (
    WARNED as WARNED,
    KeptLimit as KeptLimit,
    LimitCheck as LimitCheck,
    Limits as Limits,
    limit_pairs as limit_pairs,
    limit_text as limit_text,
    other_side as other_side,
    unit_suffix as unit_suffix,
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
from .contributions import contributions_of as contributions_of
from .probabilities import Probability as Probability
from .probabilities import Quantiles as Quantiles
from .probabilities import probability_of as probability_of
from .probabilities import quantiles_of as quantiles_of
from .probabilities import samples_of as samples_of
from .between_times import with_peaks as with_peaks
from .limits import closest as closest
from .limits import joined_limits as joined_limits
from .limits import kept_limit as kept_limit
