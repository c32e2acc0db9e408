"""Temporary arrays of a run or search, stored as .npy files with a checksum at the end."""

import io
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.folder.layout import explain_os_error
from abhv_mc.io.atomic_write import atomic_write


def write_array(path: Path, *blocks: NDArray[Any]) -> None:
    """Write the concatenated arrays ``blocks`` [row, ...] to a file.

    Raise StorageFullError or InputError if the file cannot be written.
    """
    header = io.BytesIO()
    shape = (sum(map(len, blocks)), *blocks[0].shape[1:])
    np.lib.format.write_array_header_1_0(
        header, {"descr": blocks[0].dtype.str, "fortran_order": False, "shape": shape}
    )
    pieces = [
        header.getbuffer(),
        *(np.ascontiguousarray(block).data.cast("B") for block in blocks if block.size),
    ]
    checksum = 0
    with (
        explain_os_error(path, writing=True),
        atomic_write(path) as temporary,
        temporary.open("wb") as file,
    ):
        for piece in pieces:
            checksum = zlib.crc32(piece, checksum)
            file.write(piece)
        file.write(checksum.to_bytes(4, "little"))


def read_array(path: Path) -> NDArray[Any] | None:
    """Return the array as a memory map, or None if the file is missing or damaged."""
    try:
        content = memoryview(path.read_bytes())
        if zlib.crc32(content[:-4]).to_bytes(4, "little") != content[-4:]:
            return None
        values = np.load(path, mmap_mode="r", allow_pickle=False)
        return values
    except (OSError, ValueError, EOFError):
        return None
