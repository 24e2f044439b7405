"""Results in files: written whole or not at all, and checked when they are read."""

from symmb.files.formats import Table, in_json, load, require_usual_size, save, save_json
from symmb.files.jsonable import to_jsonable
from symmb.files.record import Record
from symmb.files.replacement import replacement, require_suffix, told
from symmb.files.saved import Saved
from symmb.files.schema import NAMES, NOT_KEPT, TIMES, attributes, entries, entry
