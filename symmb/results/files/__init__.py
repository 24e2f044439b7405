"""Results in files: written completely or not at all, and checked when they are read."""

from symmb.results.files.formats import Table, in_json, load, require_usual_size, save, save_json
from symmb.results.files.jsonable import to_jsonable
from symmb.results.files.record import Record
from symmb.results.files.replacement import replacement, require_suffix, told
from symmb.results.files.saved import Saved
from symmb.results.files.schema import NAMES, NOT_KEPT, TIMES, attributes, entries, entry
