"""The one table of recorded channels and of metrics: name, unit, meaning, source. Order is array order.

A source is either a quantity of the lane memory (a state of :mod:`abhv_mc.plant.state`, a variable of the tables, or a
named row, all in SI and radians, converted to degrees where the unit asks for them) or a function of
:mod:`abhv_mc.flight.derived`, which returns the channel's unit. A new channel or metric is an entry here,
and a function there where the lane memory does not hold the quantity.
"""

from dataclasses import dataclass
from enum import IntEnum


@dataclass(frozen=True)
class Signal:
    """A channel of the histories or a metric of a flight."""

    name: str  # ends with its unit
    unit: str
    doc: str


@dataclass(frozen=True)
class Channel(Signal):
    """What a history records."""

    source: str


class Statistic(IntEnum):
    """What a metric makes of its source over the control ticks of a flight."""

    RMS = 0
    MAX_ABS = 1
    MAX_ABS_SETTLED = 2  # leaving out 5 s after each step of the reference
    MIN = 3
    MAX = 4
    FINAL = 5
    SUM = 6  # of sizes
    DURATION = 7  # time in which the source is positive, s


@dataclass(frozen=True)
class Metric(Signal):
    """One number of a flight."""

    statistic: Statistic
    source: str
    initial: float | None = None  # value before the first tick; None: the statistic's own

    @property
    def never_negative(self) -> bool:
        """Whether no flight has a value below zero: sizes, sums of sizes, times, and what begins at zero and grows."""
        sizes = (Statistic.RMS, Statistic.MAX_ABS, Statistic.MAX_ABS_SETTLED, Statistic.SUM, Statistic.DURATION)
        return self.statistic in sizes or (self.statistic == Statistic.MAX and self.initial == 0.0)


CHANNELS: tuple[Channel, ...] = (
    Channel("altitude_m", "m", "geodetic altitude", "altitude"),
    Channel("speed_mps", "m/s", "Earth-relative speed", "speed"),
    Channel("flight_path_angle_deg", "deg", "flight path angle", "gamma"),
    Channel("heading_deg", "deg", "heading of the velocity, clockwise from north", "heading_deg"),
    Channel("angle_of_attack_deg", "deg", "angle of attack to the air", "angle_of_attack"),
    Channel("sideslip_deg", "deg", "sideslip to the air", "sideslip"),
    Channel("bank_deg", "deg", "bank about the velocity", "bank"),
    Channel("roll_rate_dps", "deg/s", "inertial roll rate", "roll_rate"),
    Channel("pitch_rate_dps", "deg/s", "inertial pitch rate", "pitch_rate"),
    Channel("yaw_rate_dps", "deg/s", "inertial yaw rate", "yaw_rate"),
    Channel("aileron_deg", "deg", "aileron deflection", "aileron"),
    Channel("rudder_deg", "deg", "rudder deflection", "rudder"),
    Channel("elevator_deg", "deg", "elevator deflection", "elevator"),
    Channel("equivalence_ratio", "-", "fuel equivalence ratio", "equivalence_ratio"),
    Channel("north_m", "m", "integral of the north ground speed at altitude", "north"),
    Channel("east_m", "m", "integral of the east ground speed at altitude", "east"),
    Channel("latitude_deg", "deg", "geodetic latitude", "latitude"),
    Channel("longitude_deg", "deg", "longitude", "longitude"),
    Channel("mass_kg", "kg", "mass", "mass"),
    Channel("dynamic_pressure_pa", "Pa", "dynamic pressure of the air", "q_bar"),
    Channel("flight_path_angle_command_deg", "deg", "flight path angle asked for by the altitude loop", "gamma_cmd"),
    Channel("angle_of_attack_command_deg", "deg", "angle of attack asked for by the guidance", "alpha_cmd"),
    Channel("bank_command_deg", "deg", "bank asked for by the guidance", "bank_cmd"),
    Channel("aileron_command_deg", "deg", "aileron command", "cmd_aileron"),
    Channel("rudder_command_deg", "deg", "rudder command", "cmd_rudder"),
    Channel("elevator_command_deg", "deg", "elevator command", "cmd_elevator"),
    Channel("equivalence_ratio_command", "-", "equivalence ratio command", "cmd_eta"),
)
STANDARD_CHANNELS = tuple(channel.name for channel in CHANNELS)  # what envelopes cover unless told otherwise
CHANNELS += (
    Channel("mach", "-", "Mach number of the air", "mach"),
    Channel("load_factor_g", "g", "magnitude of the specific force", "load_factor_g"),
    Channel("thrust_n", "N", "thrust", "thrust"),
    Channel("stagnation_heat_flux_w_m2", "W/m2", "heat flux at the stagnation point", "stagnation_heat_flux_w_m2"),
    Channel("altitude_error_m", "m", "altitude minus reference", "altitude_error_m"),
    Channel("speed_error_mps", "m/s", "speed minus reference", "speed_error_mps"),
    Channel("heading_error_deg", "deg", "heading minus reference", "heading_error_deg"),
    Channel("cross_track_m", "m", "distance to the left of the reference", "cross_track_m"),
    Channel("angle_of_attack_error_deg", "deg", "angle of attack minus its command", "angle_of_attack_error_deg"),
    Channel("bank_error_deg", "deg", "bank minus its command", "bank_error_deg"),
    Channel("altitude_measured_m", "m", "altitude as measured", "m_altitude"),
    Channel("speed_measured_mps", "m/s", "speed as measured", "m_speed"),
    Channel("flight_path_angle_measured_deg", "deg", "flight path angle as measured", "m_gamma"),
    Channel("heading_measured_deg", "deg", "heading as measured, between -180 and 180", "m_chi"),
    Channel("angle_of_attack_measured_deg", "deg", "angle of attack as measured", "m_alpha"),
    Channel("sideslip_measured_deg", "deg", "sideslip as measured", "m_beta"),
    Channel("bank_measured_deg", "deg", "bank as measured", "m_bank"),
    Channel("roll_rate_measured_dps", "deg/s", "roll rate as measured", "m_p"),
    Channel("pitch_rate_measured_dps", "deg/s", "pitch rate as measured", "m_q"),
    Channel("yaw_rate_measured_dps", "deg/s", "yaw rate as measured", "m_r"),
    Channel("gust_forward_mps", "m/s", "gust and turbulence, body axes, forward", "gust_u"),
    Channel("gust_right_mps", "m/s", "gust and turbulence, body axes, to the right", "gust_v"),
    Channel("gust_down_mps", "m/s", "gust and turbulence, body axes, down", "gust_w"),
)

# The mission's reference, the same for every flight of a campaign.
REFERENCE_CHANNELS: tuple[Signal, ...] = (
    Signal("altitude_reference_m", "m", "reference altitude"),
    Signal("speed_reference_mps", "m/s", "reference speed"),
    Signal("flight_path_angle_reference_deg", "deg", "reference flight path angle"),
    Signal("heading_reference_deg", "deg", "reference heading"),
    Signal("angle_of_attack_reference_deg", "deg", "nominal angle of attack of the reference"),
    Signal("bank_reference_deg", "deg", "nominal bank of the reference"),
    Signal("equivalence_ratio_reference", "-", "nominal equivalence ratio of the reference"),
    Signal("north_reference_m", "m", "reference north displacement"),
    Signal("east_reference_m", "m", "reference east displacement"),
)


_SETTLED = "the same, largest, leaving out 5 s after each step of the reference"


def _error(name: str, unit: str, words: str, symbol: str, source: str) -> tuple[Metric, ...]:
    return (
        Metric(f"{name}_rms_{symbol}", unit, f"{words}, rms over the control ticks", Statistic.RMS, source),
        Metric(f"{name}_max_{symbol}", unit, f"{words}, largest absolute value", Statistic.MAX_ABS, source),
    )


def _surface(name: str) -> tuple[Metric, ...]:
    return (
        Metric(
            f"{name}_rms_deg",
            "deg",
            f"{name} deflection minus its initial trim, rms",
            Statistic.RMS,
            f"{name}_from_trim_deg",
        ),
        Metric(f"{name}_max_deg", "deg", f"largest absolute {name} deflection", Statistic.MAX_ABS, name),
        Metric(
            f"{name}_travel_deg",
            "deg",
            f"sum of the absolute changes of the {name} deflection",
            Statistic.SUM,
            f"{name}_moved_deg",
        ),
    )


METRICS: tuple[Metric, ...] = (
    *_error("altitude_error", "m", "altitude error", "m", "altitude_error_m"),
    *_error("speed_error", "m/s", "speed error", "mps", "speed_error_mps"),
    *_error("heading_error", "deg", "heading error", "deg", "heading_error_deg"),
    *_error("cross_track_error", "m", "cross-track error", "m", "cross_track_m"),
    Metric(
        "cross_track_error_final_m",
        "m",
        "cross-track error at the end, actual minus reference",
        Statistic.FINAL,
        "cross_track_m",
    ),
    *_error(
        "angle_of_attack_error",
        "deg",
        "angle of attack minus its command, error",
        "deg",
        "angle_of_attack_error_deg",
    ),
    Metric(
        "angle_of_attack_error_settled_max_deg",
        "deg",
        _SETTLED,
        Statistic.MAX_ABS_SETTLED,
        "angle_of_attack_error_deg",
    ),
    *_error("bank_error", "deg", "bank minus its command, error", "deg", "bank_error_deg"),
    Metric("bank_error_settled_max_deg", "deg", _SETTLED, Statistic.MAX_ABS_SETTLED, "bank_error_deg"),
    Metric("sideslip_rms_deg", "deg", "sideslip, rms", Statistic.RMS, "sideslip"),
    Metric("sideslip_max_deg", "deg", "sideslip, largest absolute value", Statistic.MAX_ABS, "sideslip"),
    Metric("angle_of_attack_min_deg", "deg", "smallest angle of attack", Statistic.MIN, "angle_of_attack"),
    Metric("angle_of_attack_max_deg", "deg", "largest angle of attack", Statistic.MAX, "angle_of_attack"),
    *_surface("aileron"),
    *_surface("elevator"),
    *_surface("rudder"),
    Metric("equivalence_ratio_min", "-", "smallest equivalence ratio", Statistic.MIN, "equivalence_ratio"),
    Metric("equivalence_ratio_max", "-", "largest equivalence ratio", Statistic.MAX, "equivalence_ratio"),
    Metric("fuel_used_kg", "kg", "fuel burnt", Statistic.FINAL, "fuel_used_kg"),
    Metric("dynamic_pressure_max_pa", "Pa", "largest dynamic pressure", Statistic.MAX, "q_bar", 0.0),
    Metric("load_factor_max_g", "g", "largest magnitude of the specific force", Statistic.MAX, "load_factor_g", 0.0),
    Metric(
        "surface_saturation_s",
        "s",
        "time with a surface at its deflection limit",
        Statistic.DURATION,
        "surface_saturated",
    ),
    *(
        Metric(
            f"{name}_ripple_deg",
            "deg",
            f"largest swing of the {words} in settled stretches that an opposite one of at least half its size follows",
            Statistic.MAX,
            f"{name}_ripple_deg",
            0.0,
        )
        for name, words in (
            ("bank", "bank error"),
            ("angle_of_attack", "angle-of-attack error"),
            ("sideslip", "sideslip"),
        )
    ),
    Metric("engine_failed_s", "s", "time with a failed or unstarted engine", Statistic.DURATION, "engine_failed"),
    Metric("outside_tables_s", "s", "time outside the tables (clamped)", Statistic.DURATION, "outside"),
)

CHANNEL_INDEX: dict[str, int] = {signal.name: i for i, signal in enumerate(CHANNELS)}
METRIC_INDEX: dict[str, int] = {signal.name: i for i, signal in enumerate(METRICS)}
