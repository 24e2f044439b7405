"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .chain import bounded as bounded
from .choices import over_parts as over_parts
from .hull import distance as distance, hull_of as hull_of
