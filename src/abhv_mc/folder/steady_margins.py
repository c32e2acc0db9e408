"""Stability margins of the trimmed vehicle at the mission's start (``margins.json``)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from abhv_mc.folder.manifest import entry_error


@dataclass(frozen=True)
class LoopMargins:
    """Margins of one loop, or for simultaneous perturbations of all loops (``all``).

    A margin is None if no perturbation destabilizes the loop, or if the loop is unstable.
    """

    loop: str
    stable: bool = True
    gain_margin_low_db: float | None = None
    gain_margin_high_db: float | None = None
    phase_margin_deg: float | None = None
    delay_margin_ms: float | None = None
    sensitivity_peak: float | None = None
    crossover_rad_s: float | None = None
    # ``disk_margin``, ``disk_gain_db`` and ``disk_phase_deg`` are used only for the loop ``all``.
    disk_margin: float | None = None
    disk_gain_db: float | None = None
    disk_phase_deg: float | None = None
    reason: str | None = None  # reason why the loop does not exist
    # True if the loop is included in the smallest margins; effector loops are included only if the
    # effectors are commanded directly.
    counts: bool = True
    # Unstable poles of the loop ``all`` as real and imaginary parts, 1/s.
    poles: tuple[tuple[float, float], ...] = ()

    @property
    def gain_db(self) -> float:
        """Smaller of the two gain margins, dB; infinite if the gain is unlimited."""
        sides = (self.gain_margin_low_db, self.gain_margin_high_db)
        return min((abs(side) for side in sides if side is not None), default=float("inf"))


@dataclass(frozen=True)
class ControllerMargins:
    """Margins of all loops of one controller; the last loop is ``all``.

    ``corners`` contains the smallest margins at the corners of the dispersions.
    """

    fault: str | None = None  # reason why there are no margins
    nominal: tuple[LoopMargins, ...] = ()
    corners_without_trim: int = 0
    corners_unstable: int = 0
    corners: tuple[LoopMargins, ...] = ()


@dataclass(frozen=True)
class SteadyMargins:
    """Margins of all controllers; empty if the vehicle has no surfaces or engine."""

    corners: int = 0  # number of corners evaluated
    all_corners: bool = False  # True if all corners were evaluated, not a random selection
    controllers: Mapping[str, ControllerMargins] = field(default_factory=dict)


_FILE = TypeAdapter(SteadyMargins)


def read_steady_margins(path: Path) -> SteadyMargins:
    """Read margins, or return empty margins if the file is missing.

    Raise InputError if the file is invalid.
    """
    if not path.is_file():
        return SteadyMargins()
    try:
        return _FILE.validate_json(path.read_bytes())
    except ValidationError as error:
        raise entry_error(
            path, error, "the margins written by the campaign (--fresh computes them again)"
        ) from None
