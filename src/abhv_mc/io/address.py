"""Addresses of object storage such as s3://bucket/folder.

A secret key is removed from an address when the address is read, so that no printed or stored text
contains the key.
"""

import re
from dataclasses import dataclass
from pathlib import Path

_HIDDEN = "..."
_KEYS: dict[str, str] = {}  # credentials of the form "user:key", by bucket


@dataclass(frozen=True)
class Address:
    """Address of object storage; its text form shows ``...`` instead of a key."""

    text: str

    def __str__(self) -> str:
        return self.text

    def _key(self) -> str:
        return _KEYS[_bucket(self.text)] if f"://{_HIDDEN}@" in self.text else ""

    def uri(self) -> str:
        """Return the address with its key, to be passed only to the object store."""
        return self.text.replace(f"{_HIDDEN}@", f"{self._key()}@", 1)

    def explain(self, error: Exception) -> str:
        """Return the first line of an error from the object store, with the key removed."""
        return str(error).splitlines()[0].replace(self._key() or _HIDDEN, _HIDDEN)


def read_address(path: Path | str) -> Address | None:
    """Return the address in a command-line argument; None if the argument is a path.

    ``Path`` collapses the double slash of an address, which this function restores.
    """
    match = re.match(r"([a-z][a-z0-9+.-]+):/+(.*)", str(path))
    if match is None:
        return None
    return Address(
        hide_key(f"{match[1]}://{'/' if match[1] in ('file', 'hdfs') else ''}{match[2]}")
    )


def hide_key(word: str) -> str:
    """Return a command-line argument with any access key in an address masked."""
    scheme, _, authority = word.partition("://")
    key, _, location = authority.rpartition("@")
    if ":" not in key:
        return word
    _KEYS[_bucket(location)] = key
    return f"{scheme}://{_HIDDEN}@{location}"


def _bucket(text: str) -> str:
    return re.split("[/?]", text.rpartition("@")[2])[0]
