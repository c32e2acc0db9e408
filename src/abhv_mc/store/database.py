"""A campaign's Parquet files as the tables of a database that reaches nothing else."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abhv_mc.store.folder import CampaignFolder
from abhv_mc.store.hashes import data_files, read_checked

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


def open_database(root: Path) -> "duckdb.DuckDBPyConnection":
    """A database in memory with the campaign's tables. SQL can neither read nor write a file, nor load an extension.

    Raises InputError where there is no campaign, or a file of it is damaged.
    """
    import duckdb
    from pyarrow import dataset

    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    connection = duckdb.connect(config=_CLOSED)
    for name, files in table_files(folder, manifest).items():
        connection.register(name, dataset.dataset([str(file) for file in files], format="parquet"))
    return connection
