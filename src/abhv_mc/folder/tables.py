"""A campaign's tables as CSV, and as SQL sees them: in a database that reaches nothing else."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import pyarrow.parquet as pq

from abhv_mc.folder.hashes import data_files, read_checked, unchanged
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.manifest import Manifest
from abhv_mc.io.csv_table import write_batches
from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.child import run_in_thread

if TYPE_CHECKING:
    import pyarrow as pa
    from duckdb import DuckDBPyConnection, DuckDBPyRelation

T = TypeVar("T")
_INTERRUPTS, _PAUSE = 300, 0.1  # and s between them: what duckdb may take to heed one
_CLOSED: dict[str, str | bool | int | float | list[str]] = {
    "enable_external_access": "false",
    "python_enable_replacements": "false",
    "lock_configuration": "true",
}


def table_files(folder: CampaignFolder, manifest: Manifest) -> dict[str, list[Path]]:
    """The files of every table that the folder holds."""
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
    """Write ``<table>.csv`` of every table into ``out`` and yield its path; memory does not grow with the campaign.

    Raises InputError without a campaign, and where a run has changed it meanwhile: what is there then belongs together
    no more.
    """
    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    with unchanged(folder, manifest):
        for name, files in table_files(folder, manifest).items():
            path = out / f"{name}.csv"
            write_whole(path, partial(_write_csv, files))
            yield path


def _write_csv(files: list[Path], path: Path) -> None:
    schema = pq.read_schema(files[0]).remove_metadata()
    write_batches(path, schema, _read_batches(files))


def _read_batches(files: list[Path]) -> "Iterator[pa.RecordBatch]":
    for file in files:
        with pq.ParquetFile(file) as part:
            yield from part.iter_batches()


@contextlib.contextmanager
def open_database(root: Path) -> "Iterator[DuckDBPyConnection]":
    """A database in memory with the campaign's tables. SQL can neither read nor write a file, nor load an extension.

    Raises InputError where there is no campaign, or a file of it is damaged, and at its end where a run has changed the
    folder meanwhile.
    """
    import duckdb
    from pyarrow import dataset

    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    Path.cwd()  # where the working folder has been deleted this raises, and duckdb would end the process
    with duckdb.connect(config=_CLOSED) as connection, unchanged(folder, manifest):
        for name, files in table_files(folder, manifest).items():
            connection.register(
                name, dataset.dataset([str(file) for file in files], format="parquet")
            )
        yield connection


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
        return run_in_thread(
            work
        )  # in a thread of its own, as duckdb heeds no interrupt in the main one
    except KeyboardInterrupt:
        for _ in range(_INTERRUPTS):  # until it heeds one, as it knows none of before it begins
            for database in opened:
                with contextlib.suppress(
                    duckdb.Error
                ):  # it may have ended and been closed this moment
                    database.interrupt()
            if ended.wait(_PAUSE):
                break
        raise
    except (
        duckdb.Error,
        ArithmeticError,
        ValueError,
    ) as error:  # the last two: of values that Python cannot hold
        words = str(error).partition("\nTraceback")[
            0
        ]  # duckdb adds one where Python lacks what a type needs
        wish = "SQL that duckdb can answer"
        if isinstance(error, duckdb.BinderException):
            wish += (
                '; a name with a dot is written in double quotes: select "aero.lift" from samples'
            )
        raise InputError("query", words, wish) from None
