"""The one table of recorded channels and of metrics: name, unit, meaning. Order is array order."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Signal:
    """A channel of the histories or a metric of a flight."""

    name: str  # ends with its unit
    unit: str
    doc: str


CHANNELS: tuple[Signal, ...] = (
    Signal("altitude_m", "m", "geodetic altitude"),
    Signal("speed_mps", "m/s", "Earth-relative speed"),
    Signal("flight_path_angle_deg", "deg", "flight path angle"),
    Signal("heading_deg", "deg", "heading of the velocity, clockwise from north"),
    Signal("angle_of_attack_deg", "deg", "angle of attack to the air"),
    Signal("sideslip_deg", "deg", "sideslip to the air"),
    Signal("bank_deg", "deg", "bank about the velocity"),
    Signal("roll_rate_dps", "deg/s", "inertial roll rate"),
    Signal("pitch_rate_dps", "deg/s", "inertial pitch rate"),
    Signal("yaw_rate_dps", "deg/s", "inertial yaw rate"),
    Signal("aileron_deg", "deg", "aileron deflection"),
    Signal("rudder_deg", "deg", "rudder deflection"),
    Signal("elevator_deg", "deg", "elevator deflection"),
    Signal("equivalence_ratio", "-", "fuel equivalence ratio"),
    Signal("north_m", "m", "integral of the north ground speed at altitude"),
    Signal("east_m", "m", "integral of the east ground speed at altitude"),
    Signal("latitude_deg", "deg", "geodetic latitude"),
    Signal("longitude_deg", "deg", "longitude"),
    Signal("mass_kg", "kg", "mass"),
    Signal("dynamic_pressure_pa", "Pa", "dynamic pressure of the air"),
    Signal("flight_path_angle_command_deg", "deg", "flight path angle asked for by the altitude loop"),
    Signal("angle_of_attack_command_deg", "deg", "angle of attack asked for by the guidance"),
    Signal("bank_command_deg", "deg", "bank asked for by the guidance"),
    Signal("aileron_command_deg", "deg", "aileron command"),
    Signal("rudder_command_deg", "deg", "rudder command"),
    Signal("elevator_command_deg", "deg", "elevator command"),
    Signal("equivalence_ratio_command", "-", "equivalence ratio command"),
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


def _surface(name: str) -> tuple[Signal, ...]:
    return (
        Signal(f"{name}_rms_deg", "deg", f"{name} deflection minus its initial trim, rms"),
        Signal(f"{name}_max_deg", "deg", f"largest absolute {name} deflection"),
        Signal(f"{name}_travel_deg", "deg", f"sum of the absolute changes of the {name} deflection"),
    )


def _error(name: str, unit: str, words: str, symbol: str) -> tuple[Signal, ...]:
    return (
        Signal(f"{name}_error_rms_{symbol}", unit, f"{words} error, rms over the control ticks"),
        Signal(f"{name}_error_max_{symbol}", unit, f"{words} error, largest absolute value"),
    )


METRICS: tuple[Signal, ...] = (
    *_error("altitude", "m", "altitude", "m"),
    *_error("speed", "m/s", "speed", "mps"),
    *_error("heading", "deg", "heading", "deg"),
    *_error("cross_track", "m", "cross-track", "m"),
    Signal("cross_track_error_final_m", "m", "cross-track error at the end, actual minus reference"),
    *_error("angle_of_attack", "deg", "angle of attack minus its command,", "deg"),
    Signal(
        "angle_of_attack_error_settled_max_deg",
        "deg",
        "the same, largest, leaving out 5 s after each step of the reference",
    ),
    *_error("bank", "deg", "bank minus its command,", "deg"),
    Signal(
        "bank_error_settled_max_deg",
        "deg",
        "the same, largest, leaving out 5 s after each step of the reference",
    ),
    Signal("sideslip_rms_deg", "deg", "sideslip, rms"),
    Signal("sideslip_max_deg", "deg", "sideslip, largest absolute value"),
    Signal("angle_of_attack_min_deg", "deg", "smallest angle of attack"),
    Signal("angle_of_attack_max_deg", "deg", "largest angle of attack"),
    *_surface("aileron"),
    *_surface("elevator"),
    *_surface("rudder"),
    Signal("equivalence_ratio_min", "-", "smallest equivalence ratio"),
    Signal("equivalence_ratio_max", "-", "largest equivalence ratio"),
    Signal("fuel_used_kg", "kg", "fuel burnt"),
    Signal("dynamic_pressure_max_pa", "Pa", "largest dynamic pressure"),
    Signal("load_factor_max_g", "g", "largest magnitude of the specific force"),
    Signal("surface_saturation_s", "s", "time with a surface at its deflection limit"),
    Signal("outside_tables_s", "s", "time outside the tables (clamped)"),
)

CHANNEL_INDEX: dict[str, int] = {signal.name: i for i, signal in enumerate(CHANNELS)}
METRIC_INDEX: dict[str, int] = {signal.name: i for i, signal in enumerate(METRICS)}
