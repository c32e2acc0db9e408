"""Metrics: numbers that are computed for each flight, and margins of linearized loops."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from abhv_mc.bounds import Bounds
from abhv_mc.flights.signals import Signal
from abhv_mc.flights.statistic import Statistic

Bad = Literal[
    "high", "low", "size"
]  # which values are worse: large, small or large absolute values
Group = Literal["tracking", "usage", "loads", "stability", "user"]
NEEDS_LIMIT = (Statistic.TIME_OUTSIDE, Statistic.LAST_OUTSIDE, Statistic.FIRST_OUTSIDE)
TAKES_LIMIT = (*NEEDS_LIMIT, Statistic.REVERSALS)
_SIZES = (Statistic.MAX_ABS, Statistic.RMS, Statistic.PEAK_TO_PEAK, Statistic.TRAVEL, *TAKES_LIMIT)
# Units with which names may end; longer suffixes precede shorter ones.
_NAMED_UNITS = ("J/m2", "W/m2", "m/s", "deg/s", "deg", "kg", "Pa", "m", "s", "g", "N", "J")
# Name suffixes that differ from the letters of the unit.
_ENDS = {"m/s": "mps", "deg/s": "dps", "-": ""}


@dataclass(frozen=True)
class Metric(Signal):
    """Number that is computed for each flight, with its names and its definition."""

    label: str  # label without the unit
    bad: Bad
    group: Group
    of: str  # source, expression of sources, or formula; "" for a margin
    statistic: Statistic
    limit: float = 0.0  # limit used by the statistic, or probability of a quantile
    start: float = 0.0  # start of the time window, s
    end: float = math.inf  # end of the time window, s
    settled: bool = False  # whether to exclude 5 s after each step of the reference
    empty: float = math.nan  # value if a flight ends before the window
    never_negative: bool = False
    leads: bool = False  # whether the metric is listed first in reports without requirements
    customary: float = 0.0  # customary lower limit of a stability margin
    plateaus: tuple[float, ...] = ()  # values that many flights may have exactly
    # Finding that the report states if values are large.
    finding: Literal["", "saturates", "cycles", "leaves_tables"] = ""
    band: Bounds | None = None  # limits of a two-sided requirement

    @property
    def label_with_unit(self) -> str:
        """Label with unit, for axes and column headings."""
        return self.label if self.unit == "-" else f"{self.label} ({self.unit})"

    def with_unit(self, value: str) -> str:
        """Return a formatted value with unit."""
        return value if self.unit == "-" else f"{value}\N{NO-BREAK SPACE}{self.unit}"

    @property
    def phrase(self) -> str:
        """Label for use in a sentence, such as 'rms angle of attack error'."""
        head, *qualifiers = self.label.split(", ")
        head = head if head[1:2].isupper() else head[:1].lower() + head[1:]
        return " ".join([*reversed(qualifiers), head])

    @property
    def counted(self) -> str:
        """Definition of the metric, such as 'max_abs of bank_error_deg, from 5 s'."""
        if not self.of:
            return "of the linearized loops"
        text = f"{self.statistic.word} of {self.of}"
        text += f", limit {self.limit:g}" if self.statistic in TAKES_LIMIT else ""
        text += f", share {self.limit:g}" if self.statistic == Statistic.QUANTILE else ""
        text += f", from {self.start:g} s" if self.start else ""
        text += f", to {self.end:g} s" if self.end < math.inf else ""
        return f"{text}, outside the transients" if self.settled else text

    def as_texts(self) -> dict[str, str]:
        """Return the strings that a report shows for the metric."""
        keys = ("label", "label_with_unit", "phrase", "unit", "doc", "group", "bad")
        return {key: getattr(self, key) for key in keys}

    def as_entry(self) -> dict[str, Any]:
        """Return the metric as declared in a campaign file."""
        keys = ("name", "label", "unit", "doc", "bad", "group", "of", "settled")
        return {
            **{key: getattr(self, key) for key in keys},
            "statistic": self.statistic.word,
            "limit": self.limit if self.statistic in TAKES_LIMIT else None,
            "share": self.limit if self.statistic == Statistic.QUANTILE else None,
            "from": self.start,
            "to": self.end if self.end < math.inf else None,
        }


def name_end(unit: str) -> str:
    """Return the suffix of names for a unit, such as 'mps', 'j_m2' or '', without underscore."""
    return _ENDS.get(unit, unit.lower().replace("/", "_").replace(" ", "_"))


def unit_of(name: str) -> str:
    """Return the unit that follows from a name, or '-'."""
    return next((unit for unit in _NAMED_UNITS if name.endswith(f"_{name_end(unit)}")), "-")


def label_of(name: str, unit: str) -> str:
    """Return the default label of a declared metric: its name without the unit."""
    label = name.removesuffix(f"_{name_end(unit)}") if name_end(unit) else name
    label = label.replace("_", " ")
    return label[0].upper() + label[1:]


def default_bad(statistic: Statistic) -> Bad:
    """Return which values are worse by default: low for a minimum or robustness, else high."""
    return "low" if statistic in (Statistic.MIN, Statistic.ROBUSTNESS) else "high"


def is_never_negative(statistic: Statistic, nonnegative: bool) -> bool:
    """Return whether a statistic of a quantity is never negative."""
    return statistic in _SIZES or nonnegative


_TEXT = tuple(
    field.name
    for field in fields(Metric)
    if field.name not in ("circular", "customary", "plateaus", "leads", "band", "finding")
)
NO_METRICS = np.empty((0, len(_TEXT)), dtype=np.str_)


def pack_metrics(metrics: Iterable[Metric]) -> NDArray[np.str_]:
    """Pack declared metrics as strings [metric, field] for plan files."""
    rows = [[_as_text(getattr(metric, name)) for name in _TEXT] for metric in metrics]
    return np.array(rows, dtype=np.str_) if rows else NO_METRICS


def _as_text(value: Any) -> str:
    if isinstance(value, Statistic):
        return value.name
    return str(int(value) if isinstance(value, bool) else value)


def unpack_metrics(rows: NDArray[np.str_]) -> tuple[Metric, ...]:
    """Restore metrics from packed text. Raise ValueError or KeyError if a row is invalid."""
    if rows.ndim != 2 or rows.shape[1] != len(_TEXT):
        raise ValueError(f"the declared metrics have the invalid shape {rows.shape}")
    return tuple(_record(dict(zip(_TEXT, row, strict=True))) for row in rows.tolist())


def _record(text: dict[str, Any]) -> Metric:
    text["statistic"] = Statistic[text["statistic"]]
    text |= {name: float(text[name]) for name in ("limit", "start", "end", "empty")}
    text |= {name: text[name] == "1" for name in ("settled", "never_negative")}
    if text["bad"] not in ("high", "low", "size") or text["group"] not in ("user", "usage"):
        raise ValueError(
            f"a declared metric has the invalid 'bad: {text['bad']}' or 'group: {text['group']}'"
        )
    return Metric(**text)


def _margin(
    name: str,
    unit: str,
    doc: str,
    label: str,
    plateaus: tuple[float, ...],
    *,
    customary: float = 0.0,
) -> Metric:
    return Metric(
        name=name,
        unit=unit,
        doc=doc,
        label=label,
        bad="low",
        group="stability",
        of="",
        statistic=Statistic.MIN,
        never_negative=True,
        plateaus=plateaus,
        customary=customary,
    )


# Smallest margins over all loops and points; a margin that is not computed is NaN.
MARGINS = (
    _margin("gain_margin_min_db", "dB",
            "smallest gain margin, up or down, over loops and points",
            "Gain margin, min", (0.0, 60.0), customary=6.0),
    _margin("phase_margin_min_deg", "deg", "smallest phase margin over loops and points",
            "Phase margin, min", (0.0, 180.0), customary=30.0),
    _margin("delay_margin_min_ms", "ms", "smallest delay margin over loops and points",
            "Delay margin, min", (0.0, 1000.0)),
    _margin("disk_margin_min", "-",
            "smallest disk margin over points, for simultaneous perturbations of all loops",
            "Disk margin, min", (0.0,)),
)  # fmt: skip
GAIN_MARGIN, PHASE_MARGIN = MARGINS[:2]
# Reasons why a point has no margin; missing margins count as zero.
MARGIN_FAULTS = (
    Signal("margin_points_unstable", "-", "points at which the closed loop is unstable"),
    Signal(
        "margin_points_at_limit",
        "-",
        "points at which a command, a surface or the engine is at a limit",
    ),
)
MARGIN_VALUES = (*MARGINS, *MARGIN_FAULTS)
MARGIN_NAMES = tuple(metric.name for metric in MARGINS)
