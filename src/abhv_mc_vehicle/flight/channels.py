"""Table of sources: quantities that channels record and metrics evaluate.

Arrays of channels have the order of this table.

Each source is a row of the lane memory. States of :mod:`abhv_mc_vehicle.kernel.plant.state`,
variables of the tables and other named rows are in SI units and radians, and are converted to
degrees if the source's unit is degrees. Rows of :mod:`abhv_mc_vehicle.kernel.flight.derived` are in
the source's unit. Only channels are recorded; expressions of metrics may use every source. A new
source needs an entry in this table, and a derived row if the lane memory does not contain the
quantity.
"""

from collections.abc import Sequence

from abhv_mc.flights.metrics import name_end, unit_of
from abhv_mc.flights.signals import Channel, Signal, Source
from abhv_mc_vehicle.kernel.plant.vehicle import MAX_EFFECTORS


def _channel(name: str, doc: str, source: str = "", nonnegative: bool = False) -> Channel:
    """Return a channel, whose unit and default source follow from its name."""
    unit = unit_of(name)
    source = source or name.removesuffix(f"_{name_end(unit)}")
    circular = name.startswith(("bank", "heading", "longitude"))
    return Channel(name, unit, doc, source, nonnegative, circular=circular)


CHANNELS: tuple[Channel, ...] = (
    _channel("altitude_m", "geodetic altitude"),
    _channel("speed_mps", "Earth-relative speed"),
    _channel("flight_path_angle_deg", "flight path angle", "gamma"),
    _channel("heading_deg", "heading of the velocity, clockwise from north", "heading_deg"),
    _channel("angle_of_attack_deg", "angle of attack relative to the air"),
    _channel("sideslip_deg", "sideslip relative to the air"),
    _channel("bank_deg", "bank angle about the velocity vector"),
    _channel("roll_rate_dps", "inertial roll rate"),
    _channel("pitch_rate_dps", "inertial pitch rate"),
    _channel("yaw_rate_dps", "inertial yaw rate"),
    _channel("aileron_deg", "aileron deflection"),
    _channel("rudder_deg", "rudder deflection"),
    _channel("elevator_deg", "elevator deflection"),
    _channel("equivalence_ratio", "throttle, or fuel equivalence ratio of a scramjet"),
    _channel("north_m", "integral of the northward Earth-relative velocity"),
    _channel("east_m", "integral of the eastward Earth-relative velocity"),
    _channel("latitude_deg", "geodetic latitude"),
    _channel("longitude_deg", "longitude"),
    _channel("mass_kg", "mass of the vehicle", nonnegative=True),
    _channel("dynamic_pressure_pa", "dynamic pressure", "q_bar", nonnegative=True),
    _channel(
        "flight_path_angle_command_deg",
        "flight path angle commanded by the altitude loop",
        "gamma_cmd",
    ),
    _channel(
        "angle_of_attack_command_deg", "angle of attack commanded by the guidance", "alpha_cmd"
    ),
    _channel("bank_command_deg", "bank angle commanded by the guidance", "bank_cmd"),
    _channel("aileron_command_deg", "aileron command", "cmd_aileron"),
    _channel("rudder_command_deg", "rudder command", "cmd_rudder"),
    _channel("elevator_command_deg", "elevator command", "cmd_elevator"),
    _channel("equivalence_ratio_command", "throttle command", "cmd_eta"),
)
# Default channels of the envelopes.
STANDARD_CHANNELS = tuple(channel.name for channel in CHANNELS)
CHANNELS += (
    _channel("mach", "Mach number", nonnegative=True),
    _channel("load_factor_g", "magnitude of the specific force", "load_factor_g", nonnegative=True),
    _channel("thrust_n", "thrust"),
    _channel(
        "stagnation_heat_flux_w_m2",
        "heat flux at the stagnation point",
        "stagnation_heat_flux_w_m2",
    ),
    _channel("altitude_error_m", "altitude minus reference altitude", "altitude_error_m"),
    _channel("speed_error_mps", "speed minus reference speed", "speed_error_mps"),
    _channel("heading_error_deg", "heading minus reference heading", "heading_error_deg"),
    _channel("cross_track_m", "lateral deviation to the left of the reference", "cross_track_m"),
    _channel(
        "angle_of_attack_error_deg",
        "angle of attack minus the controller's command",
        "angle_of_attack_error_deg",
    ),
    _channel("bank_error_deg", "bank angle minus the controller's command", "bank_error_deg"),
    _channel("altitude_measured_m", "measured altitude", "m_altitude"),
    _channel("speed_measured_mps", "measured speed", "m_speed"),
    _channel("flight_path_angle_measured_deg", "measured flight path angle", "m_gamma"),
    _channel("heading_measured_deg", "measured heading, between -180 and 180", "m_chi"),
    _channel("angle_of_attack_measured_deg", "measured angle of attack", "m_alpha"),
    _channel("sideslip_measured_deg", "measured sideslip", "m_beta"),
    _channel("bank_measured_deg", "measured bank angle", "m_bank"),
    _channel("roll_rate_measured_dps", "measured roll rate", "m_p"),
    _channel("pitch_rate_measured_dps", "measured pitch rate", "m_q"),
    _channel("yaw_rate_measured_dps", "measured yaw rate", "m_r"),
    _channel("gust_forward_mps", "forward component of gust and turbulence, body axes", "gust_u"),
    _channel("gust_right_mps", "rightward component of gust and turbulence, body axes", "gust_v"),
    _channel("gust_down_mps", "downward component of gust and turbulence, body axes", "gust_w"),
)

# Reference trajectory of the mission, which is the same for all flights of a campaign.
REFERENCE_CHANNELS = (
    Signal("altitude_reference_m", "m", "reference altitude"),
    Signal("speed_reference_mps", "m/s", "reference speed"),
    Signal("flight_path_angle_reference_deg", "deg", "reference flight path angle"),
    Signal("heading_reference_deg", "deg", "reference heading", circular=True),
    Signal("angle_of_attack_reference_deg", "deg", "nominal angle of attack on the reference"),
    Signal("bank_reference_deg", "deg", "nominal bank angle on the reference", circular=True),
    Signal("equivalence_ratio_reference", "-", "nominal throttle on the reference"),
    Signal("north_reference_m", "m", "reference north displacement"),
    Signal("east_reference_m", "m", "reference east displacement"),
)

CHANNEL_INDEX = {signal.name: i for i, signal in enumerate(CHANNELS)}

SURFACES = ("aileron", "elevator", "rudder")
# Quantities for which limit cycles are measured.
SWINGS = {
    "bank": "bank error",
    "angle_of_attack": "angle-of-attack error",
    "sideslip": "sideslip",
}
# Sources that are not recorded in histories.
_SOURCES = (
    *(
        Source(
            f"{name}_from_trim_deg",
            "deg",
            f"{name} deflection minus initial {name} deflection",
            f"{name}_from_trim_deg",
        )
        for name in SURFACES
    ),
    *(
        Source(
            f"{name}_moved_deg",
            "deg",
            f"absolute change of the {name} deflection since the previous tick",
            f"{name}_moved_deg",
            True,
        )
        for name in SURFACES
    ),
    *(
        Source(f"{name}{end}", unit, doc.format(phrase), f"{name}{end}", True)
        for end, unit, doc in (
            (
                "_ripple_deg",
                "deg",
                "largest peak-to-peak cycle of the {} so far, outside the transients",
            ),
            ("_cycle_hz", "Hz", "frequency of the largest cycle of the {}"),
        )
        for name, phrase in SWINGS.items()
    ),
    Source(
        "fuel_left_kg",
        "kg",
        "mass minus empty mass, infinite if no fuel is burnt",
        "fuel_left_kg",
    ),
    Source("fuel_used_kg", "kg", "initial mass minus mass", "fuel_used_kg"),
    Source(
        "surface_saturated",
        "-",
        "1 if a surface or its command is at a limit",
        "surface_saturated",
        True,
    ),
    *(
        Source(
            f"effector_{i}_deg", "deg", f"deflection of the vehicle's effector {i}", f"effector_{i}"
        )
        for i in range(MAX_EFFECTORS)
    ),
    Source("engine_failed", "-", "1 if an engine has failed or unstarted", "engine_failed", True),
    Source("outside_tables", "-", "positive if an input is outside the tables", "outside", True),
)
SOURCES = {source.name: source for source in (*CHANNELS, *_SOURCES)}


def effector_sources(names: Sequence[str]) -> tuple[Source, ...]:
    """Return the deflection, command and saturation sources of effectors with actuators."""
    return tuple(
        kind(f"{name}_{end}", unit, f"{phrase} {name}", f"{block}+{i}", kind is Source)
        for kind, end, unit, phrase, block in (
            (Channel, "deg", "deg", "deflection of effector", "effector_at"),
            (Channel, "command_deg", "deg", "command of effector", "effector_asked"),
            (
                Source,
                "saturated",
                "-",
                "1 if the deflection or the command is at a limit: effector",
                "effector_saturated",
            ),
        )
        for i, name in enumerate(name_effector_signals(names))
    )


def state_channels(states: Sequence[tuple[str, str, bool]]) -> tuple[Channel, ...]:
    """Return the channels of custom states (name, SI unit, circular); angles are in degrees."""
    display_units = {"rad": "deg", "rad/s": "deg/s"}
    return tuple(
        Channel(
            f"state.{name}",
            display_units.get(unit, unit),
            f"custom state {name}",
            f"custom_state+{i}",
            circular=circular,
        )
        for i, (name, unit, circular) in enumerate(states)
    )


def effector_channels(names: Sequence[str]) -> tuple[Channel, ...]:
    """Return the channels of effectors with actuators."""
    return tuple(source for source in effector_sources(names) if isinstance(source, Channel))


def all_channels(
    effectors: Sequence[str], states: Sequence[tuple[str, str, bool]]
) -> tuple[Channel, ...]:
    """Return the built-in channels, and those of effectors with actuators and custom states."""
    return (*CHANNELS, *effector_channels(effectors), *state_channels(states))


def name_effector_signals(names: Sequence[str]) -> list[str]:
    """Return the names that effectors have in channels and metrics.

    An effector with the name of an axis gets the suffix ``_effector``, because the name without
    suffix denotes the axis deflection.
    """
    return [f"{name}_effector" if f"{name}_deg" in SOURCES else name for name in names]
