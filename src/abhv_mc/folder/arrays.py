"""Arrays that a run or a search keeps for itself until it ends: .npy files that end with their checksum."""

import io
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.folder.layout import write_bytes


def write_array(path: Path, values: NDArray[Any]) -> None:
    """Write an array whole. Raises StorageFullError or InputError where the folder takes nothing."""
    file = io.BytesIO()  # numpy's own writing to a file does not say that a disk is full
    np.save(file, values, allow_pickle=False)
    write_bytes(path, file.getvalue() + _checksum(file.getvalue()))


def read_array(path: Path) -> NDArray[Any] | None:
    """The array, mapped from its file; None where the file is missing, or not as it was written."""
    try:
        content = path.read_bytes()
        if _checksum(content[:-4]) != content[-4:]:
            return None
        values: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
        return values
    except (OSError, ValueError, EOFError):
        return None


def _checksum(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(4, "little")
