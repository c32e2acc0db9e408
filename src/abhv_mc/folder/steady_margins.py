"""Stability margins in steady flight at the mission's start (``margins.json``)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from abhv_mc.io.input_error import InputError


@dataclass(frozen=True)
class LoopMargins:
    """Margins of one loop, or of simultaneous perturbations of all loops (``all``).

    A margin is None if no perturbation destabilizes the loop, or if it is already unstable.
    """

    loop: str
    stable: bool = True
    gain_margin_low_db: float | None = None
    gain_margin_high_db: float | None = None
    phase_margin_deg: float | None = None
    delay_margin_ms: float | None = None
    sensitivity_peak: float | None = None
    crossover_rad_s: float | None = None
    disk_margin: float | None = None  # only of ``all``, as the next two
    disk_gain_db: float | None = None
    disk_phase_deg: float | None = None
    reason: str | None = None  # why there is no loop
    # Whether the loop is among the least margins; an effector's is not if the law commands axes.
    counts: bool = True
    # Unstable poles of ``all``, 1/s, real and imaginary part.
    poles: tuple[tuple[float, float], ...] = ()

    @property
    def gain_db(self) -> float:
        """Smaller of both gain margins, dB; infinite if neither bounds the gain."""
        sides = (self.gain_margin_low_db, self.gain_margin_high_db)
        return min((abs(side) for side in sides if side is not None), default=float("inf"))


@dataclass(frozen=True)
class ControllerMargins:
    """Margins of one controller's loops, of which ``all`` is the last.

    ``corners`` are the smallest margins at the corners of the dispersions.
    """

    fault: str | None = None  # why there are none
    nominal: tuple[LoopMargins, ...] = ()
    corners_without_trim: int = 0
    corners_unstable: int = 0
    corners: tuple[LoopMargins, ...] = ()


@dataclass(frozen=True)
class SteadyMargins:
    """Margins of all controllers; none if the vehicle has no surfaces or engine."""

    corners: int = 0  # number of corners evaluated
    all_corners: bool = False  # whether these are all corners; else a random selection
    controllers: Mapping[str, ControllerMargins] = field(default_factory=dict)


_FILE = TypeAdapter(SteadyMargins)


def read_steady_margins(path: Path) -> SteadyMargins:
    """Read the file; return no margins if it is missing. Raise InputError if it is invalid."""
    if not path.is_file():
        return SteadyMargins()
    try:
        return _FILE.validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        problem = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise InputError(
            path, problem, "the margins that a campaign wrote: --fresh computes them again"
        ) from None
