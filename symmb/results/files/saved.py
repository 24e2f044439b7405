"""Results that can be saved as files."""

from pathlib import Path
from typing import Any, Self

from symmb.results.files.formats import Table, in_json, load, save
from symmb.results.files.record import Record
from symmb.results.files.schema import attributes, entries


class Saved:
    """A dataclass that converts its fields to a record and back, and possibly to a table."""

    def _record(self) -> dict[str, Any]:
        return entries(self)

    @classmethod
    def _of_record(cls, record: Record) -> Self:
        return cls(**attributes(cls, record))

    def _table(self) -> Table:
        raise NotImplementedError

    @classmethod
    def _of_table(cls, table: Record) -> Self:
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """The result as lists, texts and numbers. Numbers that are not finite are None."""
        return in_json(self._named_record())

    def _named_record(self) -> dict[str, Any]:
        return {"result": type(self).__name__} | self._record()

    def save(self, path: str | Path) -> None:
        """Write the complete result as .npz or .json, or a .csv table over time (runs and bounds only).

        Raises
        ------
        DeclarationError
            If the name has another suffix
        FileError
            If the file cannot be written; the previous file stays
        """
        sources = {"record": self._named_record, "entries": self.to_json}
        save(path, sources | ({"table": self._table} if _has_table(type(self)) else {}))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file that `save` has written. A table holds times and outputs only.

        Raises
        ------
        DeclarationError
            If the file is damaged or holds something else
        FileError
            If the file cannot be read
        """
        what, from_table = f"a result of {cls.__name__}.save", cls._of_table if _has_table(cls) else None
        return load(path, what, cls._of_record, from_table)


def _has_table(kind: type[Saved]) -> bool:
    return kind._table is not Saved._table
