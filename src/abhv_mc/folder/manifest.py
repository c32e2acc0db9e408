"""The manifest: what a campaign's folder holds, and where it came from."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from abhv_mc.folder.layout import write_text
from abhv_mc.folder.manifest_check import find_fault
from abhv_mc.io.input_error import InputError

_WISH = "a manifest as it was written: restore it, or run with --fresh to delete what was flown and fly it anew"
_HASH = "manifest_hash"  # the last entry: SHA-256 of the text with nothing between its quotes
_TAIL = re.compile(rb'(?<="manifest_hash": ")([0-9a-f]{64})(?="\n}\n\Z)')
RUNNING, COMPLETE, INTERRUPTED = "running", "complete", "interrupted"


def write_manifest(path: Path, manifest: dict[str, Any]) -> None:
    """Write it whole, with its own hash."""
    text = json.dumps({key: value for key, value in manifest.items() if key != _HASH} | {_HASH: ""}, indent=2) + "\n"
    write_text(path, text.removesuffix('"\n}\n') + hashlib.sha256(text.encode()).hexdigest() + '"\n}\n')


def read_manifest(path: Path) -> dict[str, Any]:
    """Read what it says, altered or not. Raises InputError where there is none."""
    return _parse(path)[0]


def read_whole_manifest(path: Path) -> dict[str, Any]:
    """Read it. Raises InputError where there is none, or one that is not as it was written."""
    manifest, content = _parse(path)
    if (manifest.keys() & {_HASH, "files"}) and not _is_whole(content):  # older versions wrote neither
        raise InputError(path, None, None, "a damaged manifest (its text has another hash)", _WISH)
    return manifest


def _parse(path: Path) -> tuple[dict[str, Any], bytes]:
    if not path.exists():
        raise InputError(path, None, None, "no such file", "the folder of a campaign")
    if not path.is_file():  # a pipe would make its reader wait for ever
        raise InputError(path, None, None, "no plain file", "the folder of a campaign")
    try:
        content = path.read_bytes()
        manifest = json.loads(content)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(path, None, None, f"a damaged manifest ({error})", _WISH) from None
    if not isinstance(manifest, dict):
        raise InputError(path, None, None, "no mapping", _WISH)
    fault = find_fault(manifest)
    if fault is not None:
        raise InputError(path, None, None, f"a damaged manifest ({fault})", _WISH)
    return manifest, content


def _is_whole(content: bytes) -> bool:
    held = _TAIL.search(content)
    return held is not None and hashlib.sha256(_TAIL.sub(b"", content)).hexdigest() == held[1].decode()
