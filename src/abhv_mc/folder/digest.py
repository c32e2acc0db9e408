"""The digest of a campaign: equal exactly when the flights tables are, however they were flown.

Each row is hashed alone (BLAKE2b over controller, flight, outcome and the bits of every sample and metric) and the
hashes are added modulo 2**256: the sum knows no order, no block size and no resume. Rows of flights that could not
be computed on a machine (``failed_to_run``) say nothing about the vehicle and are left out.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.flight.outcome import Outcome

_MODULUS = 1 << 256


@dataclass(frozen=True)
class Digest:
    """A sum of row hashes."""

    value: int = 0

    def __add__(self, other: "Digest") -> "Digest":
        return Digest((self.value + other.value) % _MODULUS)

    def __str__(self) -> str:
        return f"{self.value:064x}"


def digest_rows(
    controller: str,
    flight: NDArray[np.int64],
    outcome: Sequence[str],
    columns: dict[str, NDArray[np.float64]],
) -> Digest:
    """Digest of rows; ``columns`` are all samples and metrics by name, in any order."""
    names = sorted(columns)
    key = hashlib.blake2b("|".join(["abhv-mc flights 1", controller, *names]).encode(), digest_size=32).digest()
    values = np.stack([columns[name] for name in names], axis=1).astype("<f8") if names else np.empty((len(flight), 0))
    values[np.isnan(values)] = np.nan  # one bit pattern for every not-a-number
    failed = Outcome.FAILED_TO_RUN.code
    total = 0
    for number, word, row in zip(flight.astype("<i8"), outcome, np.ascontiguousarray(values), strict=True):
        if word != failed:
            text = number.tobytes() + word.encode() + b"|" + row.tobytes()
            total += int.from_bytes(hashlib.blake2b(text, digest_size=32, key=key).digest(), "little")
    return Digest(total % _MODULUS)
