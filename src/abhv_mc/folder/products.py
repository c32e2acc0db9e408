"""Products of a results folder: files computed from the inputs and the flights.

A run adds flights but never replaces them. A product is current if it is complete and has the
expected key. The key lists all values that the product depends on and that may change in a folder.
Inputs, settings and code are not in the key, because they are constant in a folder. Workers, blocks
and shards are not in the key, because no result depends on them.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq

from abhv_mc.folder import envelope_states
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.layout import CampaignFolder

KEY = "key"  # name of the key in JSON files and in Parquet metadata


class Product(NamedTuple):
    """Computed file with its key."""

    path: Path
    key: str

    def is_current(self, files: FileHashes) -> bool:
        """Return whether the file is complete and has the expected key.

        Files of older versions have no key and are also accepted.
        """
        return files.knows(self.path) and _read_key(self.path) in (None, self.key)


def _read_key(path: Path) -> str | None:
    if path.suffix == ".json":
        key: str | None = json.loads(path.read_bytes()).get(KEY)
        return key
    stored = (pq.read_schema(path).metadata or {}).get(f"abhv_mc.{KEY}".encode())
    return None if stored is None else stored.decode()


class Products:
    """Products of a campaign with ``runs`` flights per controller, except histories."""

    def __init__(self, folder: CampaignFolder, controllers: Iterable[str], runs: int) -> None:
        names = " ".join(sorted(controllers))
        self.samples = Product(folder.samples, str(runs))
        self.nominal = Product(folder.nominal, names)
        self.reference = Product(folder.reference, "mission")
        first = min(runs, envelope_states.ENVELOPE_FLIGHTS)
        self.envelopes = Product(folder.envelopes, f"{names} {first}")
        self.margins = Product(folder.margins, names)

    def forget_stale(self, files: FileHashes) -> None:
        """Remove stale products from ``files``, so that a resumed run computes them again."""
        files.forget(
            *(product.path for product in vars(self).values() if not product.is_current(files))
        )
