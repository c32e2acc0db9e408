"""Expressions for JSBSim properties in terms of the arguments of a vehicle function.

The arguments are in SI units and radians, the properties in the units of JSBSim.
"""

# conversion factors to m, m, kg and kg
FOOT, INCH, POUND, SLUG = 0.3048, 0.0254, 0.45359237, 14.593902937206364
SQUARE_FOOT = FOOT**2
CONSTANTS = {  # constants that a generated module defines if it uses them
    "DEGREE": (3.141592653589793 / 180.0, "rad"),
    "FOOT": (FOOT, "m"),
    "PSF": (47.88025898033584, "Pa"),
    "SLUG_FT3": (SLUG / FOOT**3, "kg/m3"),
}
DYNAMIC_PRESSURE = "aero/qbar-psf"
AREA = "metrics/Sw-sqft"
SPAN = "metrics/bw-ft"
CHORD = "metrics/cbarw-ft"
PRESSURE_AREA = "aero/qbar-area"  # product of DYNAMIC_PRESSURE and AREA
LIFT_SQUARED = "aero/cl-squared"
UNKNOWN_RATES = (
    "aero/alphadot-rad_sec",
    "aero/betadot-rad_sec",
)  # rates that are not available to functions
GROUND = ("aero/h_b-mac-ft", "aero/h_b-cg-ft")

_SPAN_TIME = "(0.5 * SPAN / larger(air.airspeed, 1e-3))"
_CHORD_TIME = "(0.5 * CHORD / larger(air.airspeed, 1e-3))"
_ROLL = "(rates.roll_rate * 2.0 * air.airspeed / SPAN)"
_PITCH = "(rates.pitch_rate * 2.0 * air.airspeed / CHORD)"
_YAW = "(rates.yaw_rate * 2.0 * air.airspeed / SPAN)"
_AHEAD = "(air.airspeed * cos(air.angle_of_attack) * cos(air.sideslip) / FOOT)"
_DOWN = "(air.airspeed * sin(air.angle_of_attack) * cos(air.sideslip) / FOOT)"
_RIGHT = "(air.airspeed * sin(air.sideslip) / FOOT)"


def _angle(stem: str, text: str) -> dict[str, str]:
    head, _, name = stem.rpartition("/")
    return {
        f"{stem}-rad": text,
        f"{stem}-deg": f"({text} / DEGREE)",
        f"{head}/mag-{name}-rad": f"abs({text})",
        f"{head}/mag-{name}-deg": f"(abs({text}) / DEGREE)",
    }


_DEFLECTIONS = {
    "fcs/left-aileron-pos": "controls.aileron",
    "fcs/aileron-pos": "controls.aileron",
    "fcs/right-aileron-pos": "(-controls.aileron)",
    "fcs/elevator-pos": "controls.elevator",
    "fcs/rudder-pos": "controls.rudder",
}
PROPERTIES = {
    **_angle("aero/alpha", "air.angle_of_attack"),
    **_angle("aero/beta", "air.sideslip"),
    DYNAMIC_PRESSURE: "(air.dynamic_pressure / PSF)",
    "aero/bi2vel": _SPAN_TIME,
    "aero/ci2vel": _CHORD_TIME,
    **dict.fromkeys(GROUND, "(air.altitude / SPAN)"),
    "velocities/mach": "air.mach",
    **dict.fromkeys(("velocities/vt-fps", "velocities/vtrue-fps"), "(air.airspeed / FOOT)"),
    "velocities/vtrue-kts": "(air.airspeed * 3600.0 / 1852.0)",
    **{
        f"velocities/{letter}{which}": text
        for which in ("-rad_sec", "-aero-rad_sec")
        for letter, text in (("p", _ROLL), ("q", _PITCH), ("r", _YAW))
    },
    **{
        f"velocities/{letter}{which}": text
        for which in ("-fps", "-aero-fps")
        for letter, text in (("u", _AHEAD), ("v", _RIGHT), ("w", _DOWN))
    },
    **dict.fromkeys(("position/h-sl-ft", "position/h-agl-ft"), "(air.altitude / FOOT)"),
    "position/h-sl-meters": "air.altitude",
    "atmosphere/rho-slugs_ft3": "(air.density / SLUG_FT3)",
    "atmosphere/P-psf": "(air.pressure / PSF)",
    "atmosphere/a-fps": "(air.sound_speed / FOOT)",
    **{
        name: text
        for stem, deflection in _DEFLECTIONS.items()
        for name, text in _angle(stem, deflection).items()
    },
}
NORMS = {  # deflections as fractions of full deflection
    f"{stem}-norm": (f"{stem}-rad", deflection) for stem, deflection in _DEFLECTIONS.items()
}
REDUCED = [  # pairs of factors whose product is a reduced rate
    ((time, f"velocities/{letter}{end}"), f"rates.{rate}")
    for time, letter, rate in (
        ("aero/bi2vel", "p", "roll_rate"),
        ("aero/ci2vel", "q", "pitch_rate"),
        ("aero/bi2vel", "r", "yaw_rate"),
    )
    for end in ("-aero-rad_sec", "-rad_sec")
]
