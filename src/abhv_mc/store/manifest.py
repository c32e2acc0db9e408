"""The manifest: what a campaign's folder holds, and where it came from."""

import json
from pathlib import Path
from typing import Any

from abhv_mc.io.input_error import InputError
from abhv_mc.store.folder import write_text

_WISH = "a manifest as it was written: restore it, or run with --fresh to delete what was flown and fly it anew"
RUNNING, COMPLETE, INTERRUPTED = "running", "complete", "interrupted"


def write_manifest(path: Path, manifest: dict[str, Any]) -> None:
    """Write it whole."""
    write_text(path, json.dumps(manifest, indent=2) + "\n")


def read_manifest(path: Path) -> dict[str, Any]:
    """Read it. Raises InputError where there is none."""
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, None, None, "no such file", "the folder of a campaign") from None
    except (OSError, ValueError) as error:
        raise InputError(path, None, None, f"a damaged manifest ({error})", _WISH) from None
    if not isinstance(manifest, dict):
        raise InputError(path, None, None, "no mapping", _WISH)
    return manifest
