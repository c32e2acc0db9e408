"""Reading of a folder's `report.json`, checked by its hash."""

import json
from pathlib import Path
from typing import Any

from abhv_mc.folder.manifest import Manifest, hash_entries

HASH = "hash"  # entry of `report.json` with the hash of all other entries


def read_numbers(folder: Path) -> dict[str, Any] | None:
    """Read a folder's `report.json` without its hash; None if missing or damaged."""
    try:
        content: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
        return content if content.pop(HASH) == hash_entries(content) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def read_current_numbers(folder: Path, manifest: Manifest) -> dict[str, Any] | None:
    """Read a folder's `report.json`; None if missing, damaged or outdated."""
    content = read_numbers(folder) or {}
    state = manifest.digest, manifest.state, len(manifest.requirement_sets)
    stored = *map(content.get, ("digest", "state")), content.get("requirement_sets", 0)
    return content if stored == state else None
