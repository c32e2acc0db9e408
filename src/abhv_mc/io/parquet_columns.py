"""Columns of a Parquet table from and to arrays, without what pyarrow does the same by: it imports pandas there.

That is a third of a second of each command, a fifth of a run with nothing new.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def column_values(column: pa.ChunkedArray) -> NDArray[Any]:
    """The numbers of a column, copied; nulls are NaN."""
    if column.null_count or not column.num_chunks:
        return np.asarray(column.to_numpy())
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])


def distinct_texts(column: pa.ChunkedArray) -> tuple[list[str], NDArray[np.intp]]:
    """The texts of a column, ascending, and which of them each row [row] has."""
    encoded = column.cast(pa.string()).combine_chunks().dictionary_encode()
    texts, back = np.unique(
        np.array(encoded.dictionary.to_pylist(), dtype=np.str_), return_inverse=True
    )
    return texts.tolist(), back[np.from_dlpack(encoded.indices)]


def number_column(values: NDArray[Any]) -> pa.Array:
    """A column of numbers [row]."""
    buffers = [None, pa.py_buffer(np.ascontiguousarray(values))]
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), buffers)


def text_column(texts: Sequence[str]) -> pa.Array:
    """A column of texts [row]."""
    encoded = [text.encode() for text in texts]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.Array.from_buffers(
        pa.string(), len(encoded), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))]
    )
