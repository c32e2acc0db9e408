"""Which files an input file names, and those which they name."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from abhv_mc.control.law_file import find_law_files
from abhv_mc.io.documents import read_document

_YAML = (".yaml", ".yml")
_DATA = (".csv", ".parquet", ".pq", ".json", ".gz", ".py")


def find_references(path: Path, seen: frozenset[Path] = frozenset()) -> Iterator[Path]:
    """Files that a YAML file names by relative paths, and those that they name."""
    if path.suffix.lower() not in _YAML or path in seen:
        return
    data = read_document(path).data
    yield from (file.resolve() for file in find_law_files(path, data) if file.is_file())
    for text in _named_files(data):
        if Path(text).suffix.lower() in (*_YAML, *_DATA) and not Path(text).is_absolute():
            file = (path.parent / text).resolve()
            if file.is_file():
                yield file
                yield from find_references(file, seen | {path})


def _named_files(value: Any) -> Iterator[str]:
    """What stands at the one key that names a file in the files that a campaign refers to; text elsewhere is text."""
    for key, inner in value.items() if isinstance(value, dict) else ():
        if key in ("file", "python") and isinstance(inner, str):
            yield inner
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _named_files(inner)
