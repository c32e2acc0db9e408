"""Names and order of the columns that compiled control laws read at each control tick."""

# Reference of the mission, and nominal values along the reference, in SI units and radians.
REFERENCE = (
    "time",
    "altitude",
    "altitude_rate",
    "speed",
    "speed_rate",
    "flight_path_angle",
    "heading",  # continuous heading, not wrapped
    "heading_rate",
    "angle_of_attack",  # nominal controls computed by guidance trim
    "bank",
    "equivalence_ratio",
    "elevator",  # trimmed elevator
    "mass",  # nominal mass, reduced by the fuel burnt along the reference
    "north",  # integral of the north speed at the reference altitude
    "east",
    "latitude",
    # 0 in ramps or steps of an S manoeuvre and for 5 s afterwards; otherwise the number of the tick
    # in the settled interval: 1, 2, ...
    "settled",
    # constant unit vector to the left of the initial heading, where cross-track error is positive
    "track_north",
    "track_east",
    "density",  # nominal air and gravity at the reference
    "sound_speed",
    "gravity",
    "radius",  # radius r in the terms V / r: meridian radius plus altitude
)
TIME, ALTITUDE, ALTITUDE_RATE, SPEED, SPEED_RATE, FLIGHT_PATH_ANGLE, HEADING, HEADING_RATE = range(
    8
)
ANGLE_OF_ATTACK, BANK, EQUIVALENCE_RATIO, ELEVATOR, MASS, NORTH, EAST, LATITUDE, SETTLED = range(
    8, 17
)
TRACK_NORTH, TRACK_EAST, DENSITY, SOUND_SPEED, GRAVITY, RADIUS = range(17, 23)

_GUIDANCE = ("path_integral", "path", "heading_integral", "heading", "speed_integral", "speed")

# Gains of TLC sub-loops 1 and 2, and spectra (a1, a2 of each channel) of sub-loops 3 and 4.
TLC_GAINS = (
    "altitude_integral",  # flight path angle per integral of the altitude error
    "altitude",
    *(f"angle_of_attack_by_{name}" for name in _GUIDANCE),
    *(f"bank_by_{name}" for name in _GUIDANCE),
    *(f"equivalence_ratio_by_{name}" for name in _GUIDANCE),
    *(
        f"{channel}_{a}"
        for channel in ("angle_of_attack", "sideslip", "bank")
        for a in ("a1", "a2")
    ),
    *(
        f"{channel}_{a}"
        for channel in ("roll_rate", "pitch_rate", "yaw_rate")
        for a in ("a1", "a2")
    ),
)
TLC_K1 = 0
TLC_K2 = 2
TLC_ATTITUDE = 20
TLC_RATE = 26
_LIMITS = (  # limits of the commands, rad; all effectors can follow the limited deflections
    *("angle_of_attack_min", "angle_of_attack_max", "bank_max"),
    *(f"{axis}_{end}" for axis in ("aileron", "rudder", "elevator") for end in ("min", "max")),
)
N_LIMITS = len(_LIMITS)  # number of limits, which are the last settings of TLC and LQR
# bandwidths in rad/s, followed by the limits
TLC_SETTINGS = ("attitude_differentiator", "rate_differentiator", *_LIMITS)

# Gains of LQR in SI units and radians (also for deflections): u = nominal - K (x - nominal).
LQR_GAINS = (
    *(
        f"{control}_by_{name}"
        for control in ("angle_of_attack", "bank", "equivalence_ratio")
        for name in ("altitude", "path", "heading", "speed")
    ),
    *(f"elevator_by_{name}" for name in ("angle_of_attack", "pitch_rate")),
    *(
        f"{surface}_by_{name}"
        for surface in ("aileron", "rudder")
        for name in ("bank", "sideslip", "roll_rate", "yaw_rate")
    ),
)
LQR_GUIDANCE = 0
LQR_ELEVATOR = 12
LQR_LATERAL = 14
LQR_SETTINGS = _LIMITS

# Gains of a replay: deflections and equivalence ratio, then their slopes until the next tick.
RECORDED_GAINS = (
    *("aileron", "rudder", "elevator", "equivalence_ratio"),
    *("aileron_rate", "rudder_rate", "elevator_rate", "equivalence_ratio_rate"),
)
