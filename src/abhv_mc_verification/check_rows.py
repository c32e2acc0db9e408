"""Rows of the verification: differences and their tolerances."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Row:
    """Largest difference of one quantity of one case."""

    case: str
    simulator: str  # what it is compared with
    quantity: str
    unit: str
    difference: float
    tolerance: float  # infinite where there is nothing to judge by
    ok: bool = field(init=False)  # False for a difference that is not a number

    def __post_init__(self) -> None:
        object.__setattr__(self, "ok", self.difference <= self.tolerance)

    @property
    def judged(self) -> bool:
        """True if there is a tolerance."""
        return math.isfinite(self.tolerance)


def all_ok(rows: Sequence[Row]) -> bool:
    """Return whether there are rows and all are within their tolerance."""
    return bool(rows) and all(row.ok for row in rows)


def rows_record(rows: Sequence[Row]) -> dict[str, Any]:
    """Return ``{"ok": bool, "rows": [...]}``; a missing tolerance is None."""
    listed = [asdict(row) | ({} if row.judged else {"tolerance": None}) for row in rows]
    return {"ok": all_ok(rows), "rows": listed}
