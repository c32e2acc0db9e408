"""Conversion between Parquet columns and arrays without importing pandas or pyarrow.compute.

The corresponding functions of pyarrow import pandas or pyarrow.compute, which takes a third of a
second.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from abhv_mc.array_types import Indices

_FEW = 10_000  # maximum number of rows converted without pyarrow.compute, whose import is slow


def arrow_memory(content: bytes) -> pa.Buffer:
    """Copy bytes to memory owned by Arrow, from which a table can be read."""
    # Threads of Arrow may free a table's source while the interpreter exits. If the memory belonged
    # to Python, the process would abort (apache/arrow issue 34314).
    stream = pa.BufferOutputStream()
    stream.write(content)
    return stream.getvalue()


def column_values(column: pa.ChunkedArray) -> NDArray[Any]:
    """Return the numbers of a column as a copy, with NaN for nulls."""
    if column.null_count or not column.num_chunks:
        return np.asarray(column.to_numpy())
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])


def distinct_texts(column: pa.ChunkedArray) -> tuple[list[str], Indices]:
    """Return the sorted distinct strings of a column, and the index of each row's string."""
    encoded = None
    if pa.types.is_dictionary(column.type):
        encoded = column.unify_dictionaries().combine_chunks()
    elif len(column) > _FEW:
        encoded = column.cast(pa.string()).combine_chunks().dictionary_encode()
    cells = np.array((encoded.dictionary if encoded else column).to_pylist(), dtype=np.str_)
    texts, inverse = np.unique(cells, return_inverse=True)
    return texts.tolist(), inverse[np.from_dlpack(encoded.indices)] if encoded else inverse


def number_column(values: NDArray[Any]) -> pa.Array:
    """Convert numbers [row] to a column."""
    buffers = [None, pa.py_buffer(np.ascontiguousarray(values))]
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), buffers)


def text_column(texts: Sequence[str]) -> pa.Array:
    """Convert strings [row] to a column."""
    encoded = [text.encode() for text in texts]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.Array.from_buffers(
        pa.string(), len(encoded), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))]
    )
