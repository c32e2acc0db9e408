"""F-16 propulsion model (a la Stevens & Lewis).

A simple propulsion model for the F-16 Fighting Falcon, as described in Stevens & Lewis [01].

Imported from F16_prop.dml (Initial version), SHA-256
e5fd7772e5c05cdac666c94febbe4cb50139418b26045affd92dbd198f2215c6.
"""

from typing import NamedTuple
from abhv_mc.extend import Thrust, table

MIL_PWR = 50.0  # milPwr, nd (+INCR): Power lever angle for military power - above this, we get afterburners

# thrustBodyForce_Y, lbf (+RT): Net steady-state thrust of the engine for given flight conditions, power lever
# angle, in the body Y axis
FEY = 0.0

# thrustBodyForce_Z, lbf (+DWN): Net steady-state thrust of the engine for given flight conditions, power lever
# angle, in the body Z axis
FEZ = 0.0

# thrustBodyMoment_Roll, ftlbf (+RWD): Net steady-state moment of the engine for given flight conditions, power
# lever angle, about the body X axis
TEL = 0.0

# thrustBodyMoment_Pitch, ftlbf (+ANU): Net steady-state moment of the engine for given flight conditions, power
# lever angle, about the body Y axis
TEM = 0.0

# thrustBodyMoment_Yaw, ftlbf (+ANR): Net steady-state moment of the engine for given flight conditions, power lever
# angle, about the body Z axis
TEN = 0.0
GRID_MACH_PTS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
GRID_ALT_PTS = (0.0, 10000.0, 20000.0, 30000.0, 40000.0, 50000.0)

# T_IDLE_fn: Idle thrust table lookup function
T_IDLE_table = table(
    GRID_MACH_PTS, GRID_ALT_PTS,
    ((1060.0, 670.0, 880.0, 1140.0, 1500.0, 1860.0),
    (635.0, 425.0, 690.0, 1010.0, 1330.0, 1700.0),
    (60.0, 25.0, 345.0, 755.0, 1130.0, 1525.0),
    (-1020.0, -710.0, -300.0, 350.0, 910.0, 1360.0),
    (-2700.0, -1900.0, -1300.0, -247.0, 600.0, 1100.0),
    (-3600.0, -1400.0, -595.0, -342.0, -200.0, 700.0))
)

# T_MIL_fn: Military thrust table lookup function
T_MIL_table = table(
    GRID_MACH_PTS, GRID_ALT_PTS,
    ((12680.0, 9150.0, 6200.0, 3950.0, 2450.0, 1400.0),
    (12680.0, 9150.0, 6313.0, 4040.0, 2470.0, 1400.0),
    (12610.0, 9312.0, 6610.0, 4290.0, 2600.0, 1560.0),
    (12640.0, 9839.0, 7090.0, 4660.0, 2840.0, 1660.0),
    (12390.0, 10176.0, 7750.0, 5320.0, 3250.0, 1930.0),
    (11680.0, 9848.0, 8050.0, 6100.0, 3800.0, 2310.0))
)

# T_MAX_fn: Maximum thrust table lookup function
T_MAX_table = table(
    GRID_MACH_PTS, GRID_ALT_PTS,
    ((20000.0, 15000.0, 10800.0, 7000.0, 4000.0, 2500.0),
    (21420.0, 15700.0, 11225.0, 7323.0, 4435.0, 2600.0),
    (22700.0, 16860.0, 12250.0, 8154.0, 5000.0, 2835.0),
    (24240.0, 18910.0, 13760.0, 9285.0, 5700.0, 3215.3),
    (28070.0, 21075.0, 15975.0, 11115.0, 6860.0, 3950.0),
    (28885.0, 23319.0, 18300.0, 13484.0, 8642.0, 5057.0))
)


class Outputs(NamedTuple):
    """What the model gives."""
    FEX: float  # thrustBodyForce_X, lbf
    FEY: float  # thrustBodyForce_Y, lbf
    FEZ: float  # thrustBodyForce_Z, lbf
    TEL: float  # thrustBodyMoment_Roll, ftlbf
    TEM: float  # thrustBodyMoment_Pitch, ftlbf
    TEN: float  # thrustBodyMoment_Yaw, ftlbf


def model(PWR=0.0, ALT=0.0, RMACH=0.0):
    """The outputs, in the units of the file.

    PWR: powerLeverAngle, pct (+INCR) - Throttle (power lever angle), 0 - 100. 50 is MIL (max dry) thrust; 100 is
        MAX (burner)
    ALT: altitudeMSL, ft (+INCR) - Altitude above sea level
    RMACH: mach, nd (+INCR) - Flight Mach number
    """
    # idleThrust, lb (+INCR): Idle thrust at current flight conditions with power at 0. Output of function table.
    T_IDLE = T_IDLE_table(RMACH, ALT)
    # militaryThrust, lb (+INCR): Max dry thrust at current flight conditions with power at 50. Output of function
    # table.
    T_MIL = T_MIL_table(RMACH, ALT)
    # maxThrust, lb (+INCR): Max augmented thrust at current flight conditions with power at 100. Output of function
    # table.
    T_MAX = T_MAX_table(RMACH, ALT)
    # thrustBodyForce_X, lbf (FWD): Net steady-state thrust of the engine for given flight conditions, power lever
    # angle, in the body X axis. If PWR below MIL_PWR, interpolate between T_IDLE and T_MIL. If PWR is above
    # MIL_PWR, interpolate between T_MAX and T_MIL.
    FEX = (
        T_IDLE + PWR * (T_MIL - T_IDLE) / MIL_PWR if PWR < MIL_PWR else T_MIL + (PWR - MIL_PWR) * (T_MAX - T_MIL) /
        (100.0 - MIL_PWR)
    )
    return Outputs(FEX, FEY, FEZ, TEL, TEM, TEN)


def thrust(air, throttle, settings):
    """Thrust in body axes at the moment reference."""
    out = model(PWR=throttle / 0.01, ALT=air.altitude / 0.3048, RMACH=air.mach)
    return Thrust(force_x=out.FEX * 4.4482216152605)
