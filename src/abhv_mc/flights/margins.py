"""Stability margins of linearized loops, as metrics."""

from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.signals import Signal
from abhv_mc.flights.statistic import Statistic


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
MARGINS: tuple[Metric, ...] = (
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
MARGIN_FAULTS: tuple[Signal, ...] = (
    Signal("margin_points_unstable", "-", "points at which the closed loop is unstable"),
    Signal(
        "margin_points_at_limit",
        "-",
        "points at which a command, a surface or the engine is at a limit",
    ),
)
MARGIN_VALUES: tuple[Signal, ...] = (*MARGINS, *MARGIN_FAULTS)
MARGIN_NAMES = tuple(metric.name for metric in MARGINS)
