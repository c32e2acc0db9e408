"""SQL over a campaign's tables; what is wrong with it is bad input."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from abhv_mc.io.input_error import InputError
from abhv_mc.store.database import open_database

if TYPE_CHECKING:
    import duckdb


@contextlib.contextmanager
def answered(root: Path, sql: str) -> Iterator["duckdb.DuckDBPyRelation | None"]:
    """The answer to SQL over the tables of the campaign in ``root``, to be read meanwhile; None where nothing is asked.

    Raises InputError for what cannot be answered, also where that shows as the answer is read.
    """
    import duckdb

    with open_database(root) as connection:
        try:
            yield connection.sql(sql)
        except duckdb.Error as error:
            words = str(error).partition("\nTraceback")[0]  # duckdb adds one where Python lacks what a type needs
            raise InputError("query", None, None, words, "SQL that duckdb can answer") from None
