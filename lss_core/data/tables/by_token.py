"""Tokens followed from table to table; one that leads nowhere is an error."""

from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from lss_core.data.tables.reading import Record, Sample, Scene, table_path
from lss_core.errors import DataError

Value = TypeVar("Value")


class ByToken(dict[str, Value]):
    """Values by the token of the record they come from; a token without record is an error.

    Args:
        folder: Holds the tables.
        record_type: Whose tokens these are.
        asked_by: Whose records name the tokens that are looked up.
        pairs: Of token and value; of several with one token the last counts.
    """

    def __init__(
        self,
        folder: Path,
        record_type: type[Record],
        asked_by: type[Record],
        pairs: Iterable[tuple[str, Value]],
    ) -> None:
        super().__init__(pairs)
        self._table = table_path(folder, record_type)
        self._asking = table_path(folder, asked_by).name

    def __missing__(self, token: str) -> Value:
        raise DataError(
            f"The table '{self._table}' has no record '{token}', which {self._asking} names; "
            "unpack both anew."
        )


def rows_of(
    folder: Path, records: list[Scene] | list[Sample], asked_by: type[Record]
) -> ByToken[int]:
    """Rows of records by token, of which there is one each.

    Args:
        folder: Holds the tables.
        records: All of a table.
        asked_by: Whose records name the tokens that are looked up.

    Raises:
        DataError: If two records have one token.
    """
    kind = type(records[0])
    pairs = ((record.token, row) for row, record in enumerate(records))
    rows = ByToken(folder, kind, asked_by, pairs)
    if len(rows) < len(records):
        double = next(r.token for row, r in enumerate(records) if rows[r.token] != row)
        raise DataError(
            f"The table '{table_path(folder, kind)}' has several records '{double}'; unpack it "
            "anew."
        )
    return rows
