"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .formats import (
    Table as Table,
    in_json as in_json,
    load as load,
    require_usual_size as require_usual_size,
    save as save,
    save_json as save_json,
    to_jsonable as to_jsonable,
)
from .record import Record as Record
from .replacement import replacement as replacement, require_suffix as require_suffix, told as told
from .saved import (
    NAMES as NAMES,
    NOT_KEPT as NOT_KEPT,
    TIMES as TIMES,
    Saved as Saved,
    attributes as attributes,
    entries as entries,
    entry as entry,
)
