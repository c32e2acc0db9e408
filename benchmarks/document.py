"""Output of benchmarks: JSON files, and marked sections of a Markdown document."""

import json
from pathlib import Path
from typing import Any


def write_json(path: Path, value: Any) -> None:
    """Write indented JSON, and create the folder if necessary."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")


def replace_part(path: Path, name: str, text: str) -> None:
    """Replace the text between ``<!-- name -->`` and ``<!-- /name -->``.

    Raise ValueError if a marker is missing.
    """
    opening, closing = f"<!-- {name} -->", f"<!-- /{name} -->"
    before, has_opening, remainder = path.read_text(encoding="utf-8").partition(opening)
    _, has_closing, after = remainder.partition(closing)
    if not (has_opening and has_closing):
        raise ValueError(f"{path} has no section {opening} ... {closing}")
    path.write_text(f"{before}{opening}\n{text}\n{closing}{after}", encoding="utf-8")
