"""Arrays small enough to travel inside a page: 16 bits a value, together compressed, as text."""

import base64
import gzip
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

_MISSING = 0xFFFF
_STEPS = _MISSING - 1


def pack_arrays(arrays: Mapping[str, ArrayLike]) -> tuple[dict[str, object], str]:
    """Where each array lies and what its numbers mean, and all of them as base64 of gzip.

    A number is ``low + (high - low) * n / 65534`` with ``n`` in 16 bits; 65535 is a missing or infinite one. So a value
    is off by at most 1/131068 of its array's range. Along the last axis each ``n`` is stored as its difference to the
    one before, modulo 65536: smooth curves take half the bytes then. All low bytes come first, then all high ones.
    """
    places: dict[str, object] = {}
    parts: list[NDArray[np.uint16]] = []
    start = 0
    for name, given in arrays.items():
        values = np.asarray(given, dtype=np.float64)
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        scaled = (values - low) * (_STEPS / (high - low)) if high > low else np.zeros(values.shape)
        codes = np.where(np.isfinite(values), np.rint(np.nan_to_num(scaled, posinf=0.0, neginf=0.0)), _MISSING)
        parts.append(np.diff(codes.astype(np.int64), prepend=0, axis=-1).ravel().astype(np.uint16))
        places[name] = {"start": start, "shape": list(values.shape), "low": low, "high": high}
        start += values.size
    steps = np.concatenate(parts) if parts else np.empty(0, np.uint16)
    planes = (steps & 0xFF).astype(np.uint8).tobytes() + (steps >> 8).astype(np.uint8).tobytes()
    return places, pack_bytes(planes)


def pack_bytes(content: bytes) -> str:
    """Base64 of gzip, the same at every call."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
