"""A campaign's Parquet files as the tables of a database that reaches nothing else."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abhv_mc.folder.hashes import data_files, read_checked, refuse_changes
from abhv_mc.folder.layout import CampaignFolder

if TYPE_CHECKING:
    import duckdb

_CLOSED: dict[str, str | bool | int | float | list[str]] = {
    "enable_external_access": "false",
    "python_enable_replacements": "false",
    "lock_configuration": "true",
}


def table_files(folder: CampaignFolder, manifest: Mapping[str, Any]) -> dict[str, list[Path]]:
    """The files of every table that the folder holds."""
    tables: dict[str, list[Path]] = {
        name: [] for name in ("flights", "samples", "histories", "envelopes", "nominal", "reference")
    }
    for path in data_files(folder, manifest):
        if path.suffix != ".parquet":
            continue
        tables[path.parent.name if path.parent != folder.root else path.stem].append(path)
    return {name: files for name, files in tables.items() if files}


@contextmanager
def open_database(root: Path) -> "Iterator[duckdb.DuckDBPyConnection]":
    """A database in memory with the campaign's tables. SQL can neither read nor write a file, nor load an extension.

    Raises InputError where there is no campaign, or a file of it is damaged, and at its end where a run has changed the
    folder meanwhile.
    """
    import duckdb
    from pyarrow import dataset

    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    Path.cwd()  # where the working folder has been deleted this raises, and duckdb would end the process
    with duckdb.connect(config=_CLOSED) as connection:
        for name, files in table_files(folder, manifest).items():
            connection.register(name, dataset.dataset([str(file) for file in files], format="parquet"))
        try:
            yield connection
        except duckdb.Error:
            refuse_changes(folder, manifest)  # which tells more
            raise
    refuse_changes(folder, manifest)
