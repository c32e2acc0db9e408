"""Addresses such as s3://bucket/folder. A key in one is put away as it is read: no text has it from then on."""

import re
from dataclasses import dataclass
from pathlib import Path

_HIDDEN = "..."
_KEYS: dict[str, str] = {}  # what stands before the @, by the bucket behind it


@dataclass(frozen=True)
class Address:
    """An address, whose text says ``...`` for a key."""

    text: str

    def __str__(self) -> str:
        return self.text

    def _key(self) -> str:
        return _KEYS[_bucket(self.text)] if f"://{_HIDDEN}@" in self.text else ""

    def uri(self) -> str:
        """The address with its key: for the store alone."""
        return self.text.replace(f"{_HIDDEN}@", f"{self._key()}@", 1)

    def explain(self, error: Exception) -> str:
        """The first line of what a store says."""
        return str(error).splitlines()[0].replace(self._key() or _HIDDEN, _HIDDEN)


def read_address(path: Path | str) -> Address | None:
    """The address that a path on the command line is (its slashes may have been taken for doubled); None for a path."""
    match = re.match(r"([a-z][a-z0-9+.-]+):/+(.*)", str(path))
    if match is None:
        return None
    return Address(
        hide_key(f"{match[1]}://{'/' if match[1] in ('file', 'hdfs') else ''}{match[2]}")
    )


def hide_key(word: str) -> str:
    """A word of the command line; the key of an address in it is put away."""
    scheme, _, rest = word.partition("://")
    key, _, place = rest.rpartition("@")
    if ":" not in key:
        return word
    _KEYS[_bucket(place)] = key
    return f"{scheme}://{_HIDDEN}@{place}"


def _bucket(text: str) -> str:
    return re.split("[/?]", text.rpartition("@")[2])[0]
