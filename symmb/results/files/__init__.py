"""Results in files: written completely or not at all, and checked when they are read."""

from symmb.results.files.formats import Table, in_json, load, require_usual_size, save, save_json, to_jsonable
from symmb.results.files.record import Record
from symmb.results.files.replacement import replacement, require_suffix, told
from symmb.results.files.saved import NAMES, NOT_KEPT, TIMES, Saved, attributes, entries, entry
