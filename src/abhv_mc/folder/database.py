"""A campaign's Parquet files as the tables of a database that reaches nothing else."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from abhv_mc.folder.hashes import CheckedFolder, data_files

if TYPE_CHECKING:
    import duckdb

_CLOSED: dict[str, str | bool | int | float | list[str]] = {
    "enable_external_access": "false",
    "python_enable_replacements": "false",
    "lock_configuration": "true",
}


def table_files(checked: CheckedFolder) -> dict[str, list[Path]]:
    """The files of every table that the folder holds."""
    folder = checked.folder
    tables: dict[str, list[Path]] = {
        name: [] for name in ("flights", "samples", "histories", "envelopes", "nominal", "reference")
    }
    for path in data_files(folder, checked.manifest):
        if path.suffix != ".parquet":
            continue
        tables[path.parent.name if path.parent != folder.root else path.stem].append(path)
    return {name: files for name, files in tables.items() if files}


def open_database(root: Path) -> "AbstractContextManager[duckdb.DuckDBPyConnection]":
    """A database in memory with the campaign's tables. SQL can neither read nor write a file, nor load an extension.

    Raises InputError where there is no campaign, or a file of it is damaged, and at its end where a run has changed the
    folder meanwhile.
    """
    return _connect(CheckedFolder(root))


@contextmanager
def _connect(checked: CheckedFolder) -> "Iterator[duckdb.DuckDBPyConnection]":
    import duckdb
    from pyarrow import dataset

    Path.cwd()  # where the working folder has been deleted this raises, and duckdb would end the process
    with duckdb.connect(config=_CLOSED) as connection:
        for name, files in table_files(checked).items():
            connection.register(name, dataset.dataset([str(file) for file in files], format="parquet"))
        try:
            yield connection
        except duckdb.Error:
            checked.refuse_changes()  # which tells more
            raise
    checked.refuse_changes()
