"""A row of the proof: how far something is from what it should be, and how far it may be."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Row:
    """One quantity of one case; ``difference`` is the worst one."""

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
        """Whether there is a tolerance."""
        return math.isfinite(self.tolerance)


def all_ok(rows: Sequence[Row]) -> bool:
    """Whether there is something to show and all of it is within its tolerance."""
    return bool(rows) and all(row.ok for row in rows)


def rows_record(rows: Sequence[Row]) -> dict[str, Any]:
    """``{"ok": bool, "rows": [...]}``; a tolerance that there is not is None."""
    listed = [asdict(row) | ({} if row.judged else {"tolerance": None}) for row in rows]
    return {"ok": all_ok(rows), "rows": listed}
