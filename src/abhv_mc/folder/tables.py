"""Tables of a campaign, as CSV files or as an SQL database without access to files."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import pyarrow.parquet as pq

from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.folder.hashes import data_files, read_checked, refuse_changes_after
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.manifest import Manifest
from abhv_mc.io.csv_table import write_batches
from abhv_mc.io.messages import InputError

if TYPE_CHECKING:
    import pyarrow as pa
    from duckdb import DuckDBPyConnection, DuckDBPyRelation

T = TypeVar("T")
_INTERRUPTS, _PAUSE = 300, 0.1  # attempts to interrupt duckdb, and pause in s between attempts
_CLOSED: dict[str, str | bool | int | float | list[str]] = {
    "enable_external_access": "false",
    "python_enable_replacements": "false",
    "lock_configuration": "true",
}


def table_files(folder: CampaignFolder, manifest: Manifest) -> dict[str, list[Path]]:
    """Return the files of each table in a results folder."""
    tables: dict[str, list[Path]] = {
        name: []
        for name in ("flights", "samples", "histories", "envelopes", "nominal", "reference")
    }
    for path in data_files(folder, manifest):
        if path.suffix != ".parquet":
            continue
        tables[path.parent.name if path.parent != folder.root else path.stem].append(path)
    return {name: files for name, files in tables.items() if files}


def export_csv(root: Path, out: Path) -> Iterator[Path]:
    """Write each table to ``out/<table>.csv`` and yield the paths.

    Memory use does not depend on the number of flights. Raise InputError if there is no campaign,
    or if a run has changed the folder meanwhile (the CSV files may then be inconsistent).
    """
    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    with refuse_changes_after(folder, manifest):
        for name, files in table_files(folder, manifest).items():
            path = out / f"{name}.csv"
            write_whole(path, partial(_write_csv, files))
            yield path


def _write_csv(files: list[Path], path: Path) -> None:
    write_batches(path, pq.read_schema(files[0]).remove_metadata(), _read_batches(files))


def _read_batches(files: list[Path]) -> "Iterator[pa.RecordBatch]":
    for file in files:
        with pq.ParquetFile(file) as table:
            yield from table.iter_batches()


@contextlib.contextmanager
def open_database(root: Path) -> "Iterator[DuckDBPyConnection]":
    """Open an in-memory database with the tables of a campaign.

    SQL statements cannot read or write files or load extensions. Raise InputError if there is no
    campaign or a file is damaged, and on exit if a run has changed the folder meanwhile.
    """
    import duckdb
    from pyarrow import dataset

    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    Path.cwd()  # Raise if the working directory was deleted, because duckdb would abort.
    with duckdb.connect(config=_CLOSED) as connection, refuse_changes_after(folder, manifest):
        for name, files in table_files(folder, manifest).items():
            connection.register(
                name, dataset.dataset([str(file) for file in files], format="parquet")
            )
        yield connection


def run_query(folder: Path, sql: str, convert: "Callable[[DuckDBPyRelation], T]") -> T | None:
    """Return the converted result of an SQL statement, or None if it has no result.

    Ctrl-C interrupts the statement. Raise InputError if the statement fails.
    """
    import duckdb

    connections = []
    ended = threading.Event()

    def answer() -> T | None:
        with open_database(folder) as database:
            connections.append(database)
            relation = database.sql(sql)
            return None if relation is None else convert(relation)

    def work() -> T | None:
        try:
            return answer()
        finally:  # Python cannot exit while another thread destroys duckdb objects.
            ended.set()

    try:
        return run_in_thread(work)  # duckdb cannot be interrupted in the main thread.
    except KeyboardInterrupt:
        for _ in range(_INTERRUPTS):  # duckdb ignores interrupts before a statement has started.
            for database in connections:
                with contextlib.suppress(duckdb.Error):  # The connection may have been closed.
                    database.interrupt()
            if ended.wait(_PAUSE):
                break
        raise
    # ArithmeticError and ValueError come from values that Python cannot represent.
    except (duckdb.Error, ArithmeticError, ValueError) as error:
        # duckdb adds a traceback if a Python package for a type is missing.
        problem = str(error).partition("\nTraceback")[0]
        expected = "a valid SQL statement for duckdb"
        if isinstance(error, duckdb.BinderException):
            expected += ' (quote names that contain a dot: select "aero.lift" from samples)'
        # The message of duckdb has several lines, so it follows the sentence.
        raise InputError("query", "the statement failed", f"{expected}\n{problem}") from None
