"""SQL over a campaign's tables; what is wrong with it is bad input."""

import contextlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from abhv_mc.folder.database import open_database
from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.run_in_thread import run_in_thread

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection, DuckDBPyRelation

T = TypeVar("T")
_INTERRUPTS, _PAUSE = 300, 0.1  # and s between them: what duckdb may take to heed one


def ask(folder: Path, sql: str, take: "Callable[[DuckDBPyRelation], T]") -> T | None:
    """What ``take`` makes of the answer; None for a statement without one. Ctrl-C is heeded. Raises InputError."""
    import duckdb

    opened: list[DuckDBPyConnection] = []
    ended = threading.Event()

    def answer() -> T | None:
        with open_database(folder) as database:
            opened.append(database)
            found = database.sql(sql)
            return None if found is None else take(found)

    def work() -> T | None:
        try:
            return answer()
        finally:  # nothing of duckdb's is left to this thread: Python cannot end while it takes its objects down
            ended.set()

    try:
        return run_in_thread(work)  # in a thread of its own, as duckdb heeds no interrupt in the main one
    except KeyboardInterrupt:
        for _ in range(_INTERRUPTS):  # until it heeds one, as it knows none of before it begins
            for database in opened:
                with contextlib.suppress(duckdb.Error):  # it may have ended and been closed this moment
                    database.interrupt()
            if ended.wait(_PAUSE):
                break
        raise
    except (duckdb.Error, ArithmeticError, ValueError) as error:  # the last two: of values that Python cannot hold
        words = str(error).partition("\nTraceback")[0]  # duckdb adds one where Python lacks what a type needs
        raise InputError("query", words, "SQL that duckdb can answer") from None
