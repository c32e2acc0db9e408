"""Ten atmospheric check-cases of NASA/TM-2015-218675, with differences of simulators."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from abhv_mc_vehicle.kernel.world.earth import Earth

FOOT = 0.3048  # length of a foot in m
_DEG = math.pi / 180.0

# Ellipsoid of the report; GM from the published gravity (32.1988102141 ft/s2 at 0 ft, equator).
ELLIPSOID = Earth(6378137.0, 1.0 / 298.257223563, 3.986004418e14, 0.00108262982, 7.292115e-5)
ROUND = Earth(20_902_255.199 * FOOT, 0.0, 1.407644311e16 * FOOT**3, 0.0, 7.292115e-5)

_DROP = 30_000.0 * FOOT
_TUMBLING = (10.0 * _DEG, 20.0 * _DEG, 30.0 * _DEG)
_AT_REST = (0.0, 0.0, 0.0)
_LOCAL = 0.004178073 * _DEG  # rotation rate of the Earth in rad/s


@dataclass(frozen=True)
class CheckCase:
    """Check-case that starts level at latitude and longitude 0; SI units and radians."""

    title: str
    earth: Earth = ELLIPSOID
    vehicle: str = "sphere"  # name of a file in configs/vehicle/nesc
    rates: tuple[float, float, float] = _AT_REST  # inertial body rates, rad/s
    altitude: float = _DROP
    velocity_ned: tuple[float, float, float] = _AT_REST
    heading: float = 0.0
    parameters: Mapping[str, float] = field(
        default_factory=dict
    )  # dispersions that define the case


_UNDAMPED = {"aero.rolling_moment": 0.0, "aero.pitching_moment": 0.0, "aero.yawing_moment": 0.0}
_SHEAR = {"wind.east": -20.0 * FOOT, "wind.shear_east": 90.0 / 30_000.0}

CASES: dict[int, CheckCase] = {
    1: CheckCase("dropped sphere, no drag", parameters={"aero.drag": 0.0}),
    2: CheckCase("tumbling brick", vehicle="brick", rates=_TUMBLING, parameters=_UNDAMPED),
    3: CheckCase("damped tumbling brick", vehicle="brick", rates=_TUMBLING),
    4: CheckCase(
        "sphere, spherical non-rotating Earth",
        earth=ROUND._replace(rotation_rate=0.0),
        rates=_TUMBLING,
    ),
    5: CheckCase("sphere, spherical rotating Earth", earth=ROUND, rates=_TUMBLING),
    6: CheckCase("sphere, ellipsoid"),
    7: CheckCase("sphere, steady wind", parameters={"wind.east": 20.0 * FOOT}),
    8: CheckCase("sphere, wind shear", parameters=_SHEAR),
    9: CheckCase(
        "eastward cannonball",
        altitude=0.0,
        velocity_ned=(0.0, 1000.0 * FOOT, -1000.0 * FOOT),
        heading=90.0 * _DEG,
        rates=(0.0, -_LOCAL, 0.0),
    ),
    10: CheckCase(
        "northward cannonball",
        altitude=0.0,
        velocity_ned=(1000.0 * FOOT, 0.0, -1000.0 * FOOT),
        rates=(_LOCAL, 0.0, 0.0),
    ),
}


def tolerances(case: int) -> tuple[float, ...]:
    """Return the tolerances of a case: differences between the published simulators.

    Units are ft for altitude, ft/s for velocity, deg for angles and deg/s for rates.
    """
    cannonball = case >= 9
    altitude = 2.0 if cannonball else 0.02 if case >= 4 else 0.01
    velocity = 0.1 if cannonball else 0.01 if case == 8 else 2e-3
    position = 2e-5 if cannonball else 1e-8
    return altitude, velocity, position, position, 0.15 if case == 3 else 0.02, 0.01
