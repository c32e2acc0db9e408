"""F-16 inertia model (a la Stevens & Lewis).

A simple constant mass matrix for the F-16 Fighting Falcon, as described in Stevens & Lewis [01].

Imported from F16_inertia.dml (Initial version), SHA-256
e11d4eba5b158d24db7034bd85682ad0b896dd2f3172f007ca3d6d6d4e693c4a.
"""

from typing import NamedTuple

CBAR = 11.32  # referenceWingChord, ft: Mean aerodynamic chord, needed for center-of-mass calculations
XIXX = 9496.0  # bodyMomentOfInertia_Roll, slugft2: Rolling moment of inertia about the body X axis
XIYY = 55814.0  # bodyMomentOfInertia_Pitch, slugft2: Pitching moment of inertia about the body Y axis
XIZZ = 63100.0  # bodyMomentOfInertia_Yaw, slugft2: Yawing moment of inertia about the body Z axis
XIZX = 982.0  # bodyProductOfInertia_ZX, slugft2: Cross-product of inertia in the body X-Z plane
XIXY = 0.0  # bodyProductOfInertia_XY, slugft2: Cross-product of inertia in the body X-Y plane
XIYZ = 0.0  # bodyProductOfInertia_YZ, slugft2: Cross-product of inertia in the body Y-Z plane
XMASS = 637.1595  # totalMass, slug: Total mass of vehicle (20,500 lbm)

# bodyPositionOfCmWrtMrc_Y, ft (RT): Lateral location of the center of mass relative to the plane of symmetry (0
# BL), positive if the CM is right of the X-Z plane.
DYCG = 0.0

# bodyPositionOfCmWrtMrc_Z, ft (DOWN): Vertical location of the center of mass relative to the bottom of the flat
# part of the belly, positive if the CM is below the waterline of the vehicle.
DZCG = 0.0


class Outputs(NamedTuple):
    """What the model gives."""
    XIXX: float  # bodyMomentOfInertia_Roll, slugft2
    XIYY: float  # bodyMomentOfInertia_Pitch, slugft2
    XIZZ: float  # bodyMomentOfInertia_Yaw, slugft2
    XIZX: float  # bodyProductOfInertia_ZX, slugft2
    XIXY: float  # bodyProductOfInertia_XY, slugft2
    XIYZ: float  # bodyProductOfInertia_YZ, slugft2
    XMASS: float  # totalMass, slug
    DYCG: float  # bodyPositionOfCmWrtMrc_Y, ft
    DZCG: float  # bodyPositionOfCmWrtMrc_Z, ft
    DXCG: float  # bodyPositionOfCmWrtMrc_X, ft


def model(CG_PCT_MAC=35.0):
    """The outputs, in the units of the file.

    CG_PCT_MAC: vrsPositionOfCM, pct (+AFT) - Longitudinal location of the center of mass in percent of MAC.
        Reference location is 35%.
    """
    # bodyPositionOfCmWrtMrc_X, ft (FWD): Longitudinal location of the center of mass relative to the moment
    # reference center (35% MAC), positive if the CM is forward of the MRC. Calculated as (35 -
    # CG_PCT_MAC)*CBAR/100.
    DXCG = 0.01 * CBAR * (35.0 - CG_PCT_MAC)
    return Outputs(XIXX, XIYY, XIZZ, XIZX, XIXY, XIYZ, XMASS, DYCG, DZCG, DXCG)
