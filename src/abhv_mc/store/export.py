"""A campaign's tables as CSV, file by file, so that memory does not grow with the campaign."""

from collections.abc import Iterator
from pathlib import Path

import pyarrow.csv as pc
import pyarrow.parquet as pq

from abhv_mc.io.input_error import InputError
from abhv_mc.store.database import table_files
from abhv_mc.store.folder import write_whole
from abhv_mc.store.hashes import CheckedFolder


def export_csv(root: Path, out: Path) -> Iterator[Path]:
    """Write ``<table>.csv`` of every table into ``out`` and yield its path.

    Raises InputError without a campaign, for a table whose files have different columns, and where a run has changed
    the campaign meanwhile: what is there then belongs together no more.
    """
    checked = CheckedFolder(root)
    for name, files in table_files(checked).items():

        def write(aside: Path, files: list[Path] = files) -> None:
            schema = pq.read_schema(files[0]).remove_metadata()
            with pc.CSVWriter(aside, schema) as writer:
                for file in files:
                    with pq.ParquetFile(file) as part:
                        if not part.schema_arrow.equals(schema):
                            raise InputError(file, None, None, f"other columns than in {files[0].name}", "the same")
                        for batch in part.iter_batches():
                            writer.write_batch(batch.cast(schema))

        path = out / f"{name}.csv"
        try:
            write_whole(path, write)
        except (InputError, OSError):
            checked.refuse_changes()  # which tells more
            raise
        yield path
    checked.refuse_changes()
