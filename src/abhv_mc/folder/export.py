"""A campaign's tables as CSV, file by file, so that memory does not grow with the campaign."""

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq

from abhv_mc.folder.hashes import read_checked, refuse_changes
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.sql import table_files
from abhv_mc.io.input_error import InputError


def export_csv(root: Path, out: Path) -> Iterator[Path]:
    """Write ``<table>.csv`` of every table into ``out`` and yield its path.

    Raises InputError without a campaign, and where a run has changed it meanwhile: what is there then belongs together
    no more.
    """
    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    for name, files in table_files(folder, manifest).items():

        def write(temporary: Path, files: list[Path] = files) -> None:
            schema = pq.read_schema(files[0]).remove_metadata()
            with pc.CSVWriter(temporary, schema) as writer:
                for batch in _read(files, schema):
                    writer.write_batch(batch)

        path = out / f"{name}.csv"
        try:
            write_whole(path, write)
        except (InputError, OSError):
            refuse_changes(folder, manifest)  # which tells more
            raise
        yield path
    refuse_changes(folder, manifest)


def _read(files: list[Path], schema: pa.Schema) -> Iterator[pa.RecordBatch]:
    for file in files:
        with pq.ParquetFile(file) as part:
            for batch in part.iter_batches():
                yield batch.cast(schema)
