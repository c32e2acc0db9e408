"""A row of the proof: how far something is from what it should be, and how far it may be."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from abhv_mc.folder.layout import write_text


@dataclass(frozen=True)
class Row:
    """One quantity of one case; ``difference`` is the worst one."""

    case: str
    simulator: str  # what it is compared with
    quantity: str
    unit: str
    difference: float
    tolerance: float
    ok: bool = field(init=False)  # False for a difference that is not a number

    def __post_init__(self) -> None:
        object.__setattr__(self, "ok", self.difference <= self.tolerance)


def all_ok(rows: Sequence[Row]) -> bool:
    """Whether there is something to show and all of it is within its tolerance."""
    return bool(rows) and all(row.ok for row in rows)


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write ``{"ok": bool, "rows": [...]}``; a difference that is not finite becomes null."""
    content = [asdict(row) for row in rows]
    for row in content:
        row["difference"] = row["difference"] if math.isfinite(row["difference"]) else None
    text = json.dumps({"ok": all_ok(rows), "rows": content}, indent=2, allow_nan=False)
    write_text(path, text + "\n")
