"""A campaign's Parquet files as the tables of a database."""

from pathlib import Path
from typing import TYPE_CHECKING

from abhv_mc.store.folder import CampaignFolder
from abhv_mc.store.manifest import read_manifest

if TYPE_CHECKING:
    import duckdb


def table_files(folder: CampaignFolder) -> dict[str, list[Path]]:
    """The files of every table that the folder holds."""
    files = {
        "flights": sorted(folder.flights.glob("*.parquet")),
        "samples": [folder.samples],
        "histories": sorted(folder.histories.glob("*.parquet")),
        "envelopes": [folder.envelopes],
        "nominal": [folder.nominal],
        "reference": [folder.reference],
    }
    return {name: found for name, paths in files.items() if (found := [path for path in paths if path.exists()])}


def open_database(root: Path) -> "duckdb.DuckDBPyConnection":
    """A database in memory whose views are the campaign's tables. Raises InputError where there is no campaign."""
    import duckdb

    folder = CampaignFolder(root)
    read_manifest(folder.manifest)
    connection = duckdb.connect()
    for name, files in table_files(folder).items():
        connection.read_parquet([str(file) for file in files]).create_view(name)
    return connection
