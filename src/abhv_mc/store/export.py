"""A campaign's tables as CSV, file by file, so that memory does not grow with the campaign."""

from collections.abc import Iterator
from pathlib import Path

import pyarrow.csv as pc
import pyarrow.parquet as pq

from abhv_mc.store.database import table_files
from abhv_mc.store.folder import CampaignFolder, write_whole
from abhv_mc.store.hashes import read_checked


def export_csv(root: Path, out: Path) -> Iterator[Path]:
    """Write ``<table>.csv`` of every table into ``out`` and yield its path. Raises InputError without a campaign."""
    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    for name, files in table_files(folder, manifest).items():

        def write(aside: Path, files: list[Path] = files) -> None:
            schema = pq.read_schema(files[0]).remove_metadata()
            with pc.CSVWriter(aside, schema) as writer:
                for file in files:
                    for batch in pq.ParquetFile(file).iter_batches():
                        writer.write_batch(batch.cast(schema))

        path = out / f"{name}.csv"
        write_whole(path, write)
        yield path
