"""Rows of a verification table: differences with their tolerances."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Row:
    """Largest difference of one quantity in one check-case."""

    case: str
    simulator: str  # simulator used as the reference
    quantity: str
    unit: str
    difference: float
    tolerance: float  # infinite if no tolerance is known
    ok: bool = field(init=False)  # False if the difference is NaN

    def __post_init__(self) -> None:
        object.__setattr__(self, "ok", self.difference <= self.tolerance)

    @property
    def judged(self) -> bool:
        """True if the row has a tolerance, so that it can fail."""
        return math.isfinite(self.tolerance)


def all_ok(rows: Sequence[Row]) -> bool:
    """Return True if there are rows and all of them are within tolerance."""
    return bool(rows) and all(row.ok for row in rows)


def rows_record(rows: Sequence[Row]) -> dict[str, Any]:
    """Return ``{"ok": bool, "rows": [...]}``; a missing tolerance is None."""
    listed = [asdict(row) | ({} if row.judged else {"tolerance": None}) for row in rows]
    return {"ok": all_ok(rows), "rows": listed}
