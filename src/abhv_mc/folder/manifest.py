"""The manifest: what a campaign's folder holds, and where it came from."""

import hashlib
import json
from pathlib import Path
from typing import Any

from abhv_mc.folder.layout import write_text
from abhv_mc.io.input_error import InputError

FORMAT = 1  # of the folder: what lies in it, and how
RUNNING, COMPLETE, INTERRUPTED = "running", "complete", "interrupted"
_HASH = "manifest_hash"  # of the other entries
_WISH = "a copy of the manifest as it was, or the campaign flown anew: another folder (-o DIR), or --fresh"


def write_manifest(path: Path, manifest: dict[str, Any]) -> None:
    """Write it whole, with the folder's format number and its own hash."""
    content = {"format": FORMAT} | {key: value for key, value in manifest.items() if key != _HASH}
    write_text(path, json.dumps(content | {_HASH: _hash(content)}, indent=2) + "\n")


def read_manifest(path: Path) -> dict[str, Any]:
    """Read it. Raises InputError where there is none, one of another format, or one that is not as it was written."""
    if not path.is_file():
        raise InputError(path, "no such file", "the folder of a campaign")
    try:
        manifest = json.loads(path.read_bytes())
    except ValueError as error:
        raise InputError(path, f"a damaged manifest ({error})", _WISH) from None
    held = manifest.get("format") if isinstance(manifest, dict) else None
    if held != FORMAT:
        found = "a folder without a format number" if held is None else f"a folder of format {held}"
        raise InputError(path, found, f"format {FORMAT}: the version that wrote it, or the campaign anew")
    if manifest.pop(_HASH, None) != _hash(manifest):
        raise InputError(path, "a damaged manifest (its entries have another hash)", _WISH)
    return manifest


def _hash(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()
