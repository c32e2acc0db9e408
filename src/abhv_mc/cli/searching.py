"""What the searching commands share."""

import json
from pathlib import Path
from typing import Any

from abhv_mc.io.input_error import InputError


def refuse_shard(shard: str | None) -> None:
    """A search has no parts. Raises InputError."""
    if shard is not None:
        wanted = (
            "no shards: each batch of a search depends on the one before; --workers or --scheduler share its flights"
        )
        raise InputError("--shard", None, None, shard, wanted)


def write_json(path: Path | None, numbers: dict[str, Any]) -> None:
    """Write the result where it is asked for."""
    if path is not None:
        from abhv_mc.store.folder import write_text

        write_text(path, json.dumps(numbers, indent=2) + "\n")
