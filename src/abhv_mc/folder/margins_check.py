"""Whether ``margins.json`` is one that a campaign may have written: the report counts and prints what it says."""

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from abhv_mc.folder.manifest_check import Count, Entries, Number, Text, first_fault
from abhv_mc.io.input_error import InputError

_WISH = "the margins as the campaign wrote them: restore the file, or make it anew (abhv-mc run)"
Margin = Number | None


class _Loop(Entries):
    loop: Text
    stable: bool
    gain_margin_low_db: Margin
    gain_margin_high_db: Margin
    phase_margin_deg: Margin
    delay_margin_ms: Margin


class _AllLoops(Entries):
    loop: Text
    stable: bool
    disk_gain_db: Margin
    disk_phase_deg: Margin
    delay_margin_ms: Margin
    poles: list[Annotated[list[Number], Field(min_length=2, max_length=2)]] | None = None

    @model_validator(mode="after")
    def _name_poles(self) -> "_AllLoops":
        if not self.stable and self.poles is None:
            raise ValueError("an unstable loop without poles")
        return self


class _Controller(Entries):
    fault: Text | None = None
    nominal: list[dict[Text, Any]] | None = None
    corners: list[dict[Text, bool | Text | Margin]] = []
    corners_unstable: Count = 0

    @model_validator(mode="after")
    def _check_rows(self) -> "_Controller":
        if self.nominal is None:
            if self.fault is None:
                raise ValueError("neither margins nor a fault")
            return self
        if len(self.nominal) < 2:
            raise ValueError("no loops")
        for row in self.nominal[:-1]:
            _Loop.model_validate(row)
        _AllLoops.model_validate(self.nominal[-1])
        if any("loop" not in row for row in self.corners):
            raise ValueError("a corner without its loop")
        return self


class _Margins(Entries):
    corners: Count = 0
    all_corners: bool = False
    controllers: dict[Text, _Controller] = {}

    @model_validator(mode="after")
    def _count_corners(self) -> "_Margins":
        if self.controllers and "corners" not in self.model_fields_set:
            raise ValueError("no number of corners")
        return self


def read_margins(path: Path) -> dict[str, Any]:
    """What the file says; nothing where there is none. Raises InputError."""
    if not path.is_file():
        return {}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(path, None, None, f"no JSON ({error})", _WISH) from None
    fault = first_fault(_Margins, found)
    if fault is not None:
        raise InputError(path, None, None, fault, _WISH)
    return dict(found)
