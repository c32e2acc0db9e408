"""Table of metrics: names, units, definitions, and which values are worse.

Metrics in arrays have the order of the table. Metrics that a campaign declares and stability
margins of linearized loops are also records of the type ``Metric``.
"""

import math
from collections.abc import Iterable
from typing import Any

from abhv_mc.flights.metrics import (
    MARGINS,
    Group,
    Metric,
    default_bad,
    is_never_negative,
    label_of,
    name_end,
    unit_of,
)
from abhv_mc.flights.statistic import Statistic
from abhv_mc_vehicle.flight.channels import SURFACES, SWINGS, name_effector_signals


def _count(
    name: str,
    doc: str,
    label: str,
    group: Group,
    *,
    statistic: Statistic,
    nonnegative: bool = False,
    **fields: Any,
) -> Metric:
    """Make a metric; the name determines the unit, the statistic ``bad`` and ``empty``."""
    never = is_never_negative(statistic, nonnegative)
    empty = (
        {Statistic.MIN: math.inf, Statistic.MAX: -math.inf}.get(statistic, 0.0)
        if not never
        else 0.0
    )
    return Metric(
        name=name,
        doc=doc,
        label=label,
        group=group,
        statistic=statistic,
        empty=empty,
        never_negative=never,
        **{"unit": unit_of(name), "bad": default_bad(statistic)} | fields,
    )


def _error(
    name: str,
    unit: str,
    quantity: str,
    label: str,
    of: str,
    *,
    leads: str = "",
    settles: bool = False,
) -> tuple[Metric, ...]:
    end = name_end(unit)
    kinds = [
        ("rms", f"{quantity}, rms over the control ticks", Statistic.RMS),
        ("max", f"{quantity}, largest absolute value", Statistic.MAX_ABS),
        ("settled_max", "largest absolute error, excluding 5 s after each step of the reference",
         Statistic.MAX_ABS),
    ]  # fmt: skip
    return tuple(
        _count(
            f"{name}_{kind}_{end}",
            doc,
            f"{label}, {kind.replace('_', ', ')}",
            "tracking",
            of=of,
            statistic=statistic,
            leads=kind == leads,
            settled=kind == "settled_max",
        )
        for kind, doc, statistic in kinds[: 3 if settles else 2]
    )


def _surface(name: str) -> tuple[Metric, ...]:
    label = name.capitalize()
    return (
        _count(f"{name}_rms_deg", f"rms {name} deflection relative to initial trim",
               f"{label}, rms", "usage", of=f"{name}_from_trim_deg", statistic=Statistic.RMS),
        _count(f"{name}_max_deg", f"largest absolute {name} deflection", f"{label}, max",
               "usage", of=f"{name}_deg", statistic=Statistic.MAX_ABS),
        _count(f"{name}_travel_deg", f"sum of the absolute changes of the {name} deflection",
               f"{label} travel", "usage", of=f"{name}_moved_deg", statistic=Statistic.SUM,
               nonnegative=True),
    )  # fmt: skip


METRICS = (
    *_error("altitude_error", "m", "altitude error", "Altitude error", "altitude_error_m",
            leads="max"),
    *_error("speed_error", "m/s", "speed error", "Speed error", "speed_error_mps", leads="max"),
    *_error("heading_error", "deg", "heading error", "Heading error", "heading_error_deg"),
    *_error("cross_track_error", "m", "cross-track error", "Cross-track error", "cross_track_m"),
    _count("cross_track_error_final_m", "cross-track error at the end, actual minus reference",
           "Cross-track error at the end", "tracking", of="cross_track_m",
           statistic=Statistic.FINAL, bad="size"),
    *_error("angle_of_attack_error", "deg", "angle of attack minus the controller's command",
            "Angle of attack error from own command", "angle_of_attack_error_deg", leads="rms",
            settles=True),
    *_error("bank_error", "deg", "bank angle minus the controller's command",
            "Bank error from own command", "bank_error_deg", leads="rms", settles=True),
    *_error("sideslip", "deg", "sideslip", "Sideslip", "sideslip_deg", leads="rms"),
    _count("angle_of_attack_min_deg", "smallest angle of attack", "Angle of attack, min",
           "loads", of="angle_of_attack_deg", statistic=Statistic.MIN),
    _count("angle_of_attack_max_deg", "largest angle of attack", "Angle of attack, max",
           "loads", of="angle_of_attack_deg", statistic=Statistic.MAX),
    *(metric for name in SURFACES for metric in _surface(name)),
    _count("equivalence_ratio_min", "smallest throttle", "Throttle, min", "usage",
           of="equivalence_ratio", statistic=Statistic.MIN),
    _count("equivalence_ratio_max", "largest throttle", "Throttle, max", "usage",
           of="equivalence_ratio", statistic=Statistic.MAX),
    _count("fuel_used_kg", "fuel burnt", "Fuel used", "usage", of="fuel_used_kg",
           statistic=Statistic.FINAL),
    _count("dynamic_pressure_max_pa", "largest dynamic pressure", "Dynamic pressure, max",
           "loads", of="dynamic_pressure_pa", statistic=Statistic.MAX, nonnegative=True),
    _count("load_factor_max_g", "largest magnitude of the specific force", "Load factor, max",
           "loads", of="load_factor_g", statistic=Statistic.MAX, nonnegative=True),
    _count("surface_saturation_s", "time with a surface at a deflection limit",
           "Surface saturation", "usage", of="surface_saturated", statistic=Statistic.TIME_OUTSIDE,
           finding="saturates"),
    *(
        _count(f"{name}_ripple_deg",
               f"largest peak-to-peak cycle of the {phrase}, outside the transients",
               f"{label_of(name, '-')} ripple", "tracking", of=f"{name}_ripple_deg",
               statistic=Statistic.MAX, nonnegative=True, finding="cycles")
        for name, phrase in SWINGS.items()
    ),
    *(
        _count(f"{name}_cycle_hz",
               f"frequency of the largest cycle of the {phrase}, or zero",
               f"{label_of(name, '-')} cycle frequency", "tracking", of=f"{name}_cycle_hz",
               statistic=Statistic.FINAL, nonnegative=True, unit="Hz")
        for name, phrase in SWINGS.items()
    ),
    _count("engine_failed_s", "time with a failed or unstarted engine", "Engine failed",
           "loads", of="engine_failed", statistic=Statistic.TIME_OUTSIDE),
    _count("outside_tables_s", (
        "time outside the vehicle's tables, with clamped "
        "inputs"
    ), "Outside tables", "loads",
           of="outside_tables", statistic=Statistic.TIME_OUTSIDE, finding="leaves_tables"),
)  # fmt: skip


def effector_metrics(names: Iterable[str]) -> tuple[Metric, ...]:
    """Return the metrics of effectors with actuators, in the form of declared metrics."""
    return tuple(
        _count(f"{name}_{end}", f"{name.replace('_', ' ')}: {phrase}",
               f"{label_of(name, '-')}{after}", "usage", of=f"{name}{of}", statistic=statistic)
        for name in name_effector_signals(list(names))
        for end, phrase, after, of, statistic in (
            ("rms_deg", "deflection, rms", ", rms", "_deg", Statistic.RMS),
            ("max_deg", "largest absolute deflection", ", max", "_deg", Statistic.MAX_ABS),
            ("travel_deg", "sum of the absolute changes of the deflection", " travel",
             "_deg", Statistic.TRAVEL),
            ("saturation_s", "time at a limit", " saturation", "_saturated",
             Statistic.TIME_OUTSIDE),
        )
    )  # fmt: skip


METRIC_INDEX = {metric.name: i for i, metric in enumerate(METRICS)}
BUILT_IN = {metric.name: metric for metric in (*METRICS, *MARGINS)}
ELEVATOR_TRAVEL = next(m.name for m in METRICS if m.of == "elevator_moved_deg")
