"""Arrays of an .npz file of anybody's: unpacked one by one where asked for, once their headers have said how large.

What a few kilobytes unpack to may be terabytes; numpy's own reader unpacks first.
"""

import contextlib
import math
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

MAX_BYTES = 2**30  # of all arrays together; the plan of an hour at 100 Hz is a third of it
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_KINDS = "biufU"  # no objects, which would be pickles
_HEADER_BYTES = 2**16  # more than any header
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


class PackedArrays(Mapping[str, NDArray[Any]]):
    """The arrays of an open file by name; each look-up unpacks one. Raises ValueError for what is no such array."""

    def __init__(self, packed: zipfile.ZipFile, max_bytes: int = MAX_BYTES) -> None:
        self._packed, self._left, self._most = packed, max_bytes, max_bytes

    def __getitem__(self, name: str) -> NDArray[Any]:
        member = self._packed.getinfo(f"{name}.npy")  # or KeyError
        if member.compress_type not in _METHODS:
            raise ValueError(f"{name}: packed in another way than numpy does")
        with self._packed.open(member) as file:
            size = _declared_bytes(file, name)
        self._left -= size
        if self._left < 0 or member.file_size > size + _HEADER_BYTES:
            raise ValueError(f"{name}: more than {self._most} bytes, or other ones than its header says")
        with self._packed.open(member) as file:
            return np.asarray(npy.read_array(file, allow_pickle=False))

    def __iter__(self) -> Iterator[str]:
        return (name.removesuffix(".npy") for name in self._packed.namelist())

    def __len__(self) -> int:
        return len(self._packed.namelist())


def _declared_bytes(file: IO[bytes], name: str) -> int:
    read_header = _HEADERS.get(npy.read_magic(file))
    if read_header is None:
        raise ValueError(f"{name}: a header of another version")
    shape, _, kind = read_header(file)
    if kind.kind not in _KINDS or min(shape, default=0) < 0:
        raise ValueError(f"{name}: {kind} {shape}")
    return math.prod(shape) * kind.itemsize


@contextlib.contextmanager
def open_packed(path: Path) -> Iterator[PackedArrays]:
    """The arrays of a file. Raises OSError, zipfile's errors, and in look-ups KeyError and ValueError."""
    with zipfile.ZipFile(path) as packed:
        yield PackedArrays(packed, MAX_BYTES)
