"""`margins.json`: the margins of each controller in steady flight at the mission's start, nominal and at corners."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from abhv_mc.io.input_error import InputError


@dataclass(frozen=True)
class LoopMargins:
    """The margins of one loop, or of ``all`` at once; None where nothing makes the loop unstable, or it is already."""

    loop: str
    stable: bool = True
    gain_margin_low_db: float | None = None
    gain_margin_high_db: float | None = None
    phase_margin_deg: float | None = None
    delay_margin_ms: float | None = None
    sensitivity_peak: float | None = None
    crossover_rad_s: float | None = None
    disk_margin: float | None = None  # these three of ``all``
    disk_gain_db: float | None = None
    disk_phase_deg: float | None = None
    reason: str | None = None  # why there is no loop
    counts: bool = True  # among the least margins; not an effector's where the law commands axes
    poles: tuple[
        tuple[float, float], ...
    ] = ()  # growing ones of ``all``, 1/s, real and imaginary part

    @property
    def gain_db(self) -> float:
        """The smaller gain margin of both sides, dB; infinite where nothing bounds it."""
        sides = (self.gain_margin_low_db, self.gain_margin_high_db)
        return min((abs(side) for side in sides if side is not None), default=float("inf"))


@dataclass(frozen=True)
class ControllerMargins:
    """One controller's loops, the last of them ``all``; at corners the least of each."""

    fault: str | None = None  # why there are none
    nominal: tuple[LoopMargins, ...] = ()
    corners_without_trim: int = 0
    corners_unstable: int = 0
    corners: tuple[LoopMargins, ...] = ()


@dataclass(frozen=True)
class SteadyMargins:
    """Those of all controllers; none where the vehicle has no surfaces or engine."""

    corners: int = 0  # how many were looked at
    all_corners: bool = False  # or some at random
    controllers: Mapping[str, ControllerMargins] = field(default_factory=dict)


_FILE = TypeAdapter(SteadyMargins)


def read_steady_margins(path: Path) -> SteadyMargins:
    """Read the file; empty where there is none. Raises InputError for another one."""
    if not path.is_file():
        return SteadyMargins()
    try:
        return _FILE.validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        found = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise InputError(
            path, found, "the margins that a campaign wrote: --fresh finds them again"
        ) from None
