"""F-16 Subsonic Aerodynamics Model (a la Garza).

F-16 aero data file. Based on Morelli's adaptation of Stevens and Lewis' F-16 example [1] described in Garza &
Morelli's TM [2]. Obtained from E. A. Morelli in the form of Matlab scripts [3] & [4].

Imported from F16_aero.dml (Mod P, 2013-10-21), SHA-256
82796577b989b5f3becb7d13430ff6c619b3ecd2e642a6427b743658fb177e51.
"""

from typing import NamedTuple
from abhv_mc.extend import Coefficients, larger, table

DEGREE = 3.141592653589793 / 180.0  # rad
cbar = 11.32  # referenceWingChord, ft: Length of aerodynamic chord, ft
bspan = 30.0  # referenceWingSpan, ft: Length of aerodynamic span, ft
sref = 300.0  # referenceWingArea, ft2: Reference area of aerodynamic model, ft2
GRID_DE1 = (-24.0, -12.0, 0.0, 12.0, 24.0)
GRID_ALPHA1 = (-10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0)

# Basic CX: Basic coefficient of X-force table as a function of angle of attack and elevator
CX_table = table(
    GRID_DE1, GRID_ALPHA1,
    ((-0.099, -0.081, -0.081, -0.063, -0.025, 0.044, 0.097, 0.113, 0.145, 0.167, 0.174, 0.166),
    (-0.048, -0.038, -0.04, -0.021, 0.016, 0.083, 0.127, 0.137, 0.162, 0.177, 0.179, 0.167),
    (-0.022, -0.02, -0.021, -0.004, 0.032, 0.094, 0.128, 0.13, 0.154, 0.161, 0.155, 0.138),
    (-0.04, -0.038, -0.039, -0.025, 0.006, 0.062, 0.087, 0.085, 0.1, 0.11, 0.104, 0.091),
    (-0.083, -0.073, -0.076, -0.072, -0.046, 0.012, 0.024, 0.025, 0.043, 0.053, 0.047, 0.04))
)

# Basic CZ: Basic coefficient of Z-force table as a function of angle of attack
CZ0_table = table(
    GRID_ALPHA1,
    (0.77, 0.241, -0.1, -0.416, -0.731, -1.053, -1.366, -1.646, -1.917, -2.12, -2.248, -2.229)
)
GRID_BETA1 = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0)

# Basic Cl: Basic coefficient of rolling moment as a function of angle of attack and sideslip angle
Cl0_table = table(
    GRID_BETA1, GRID_ALPHA1,
    ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (-0.001, -0.004, -0.008, -0.012, -0.016, -0.022, -0.022, -0.021, -0.015, -0.008, -0.013, -0.015),
    (-0.003, -0.009, -0.017, -0.024, -0.03, -0.041, -0.045, -0.04, -0.016, -0.002, -0.01, -0.019),
    (-0.001, -0.01, -0.02, -0.03, -0.039, -0.054, -0.057, -0.054, -0.023, -0.006, -0.014, -0.027),
    (0.0, -0.01, -0.022, -0.034, -0.047, -0.06, -0.069, -0.067, -0.033, -0.036, -0.035, -0.035),
    (0.007, -0.01, -0.023, -0.034, -0.049, -0.063, -0.081, -0.079, -0.06, -0.058, -0.062, -0.059),
    (0.009, -0.011, -0.023, -0.037, -0.05, -0.068, -0.089, -0.088, -0.091, -0.076, -0.077, -0.076))
)

# Basic Cn: Basic coefficient of yawing moment as a function of angle of attack and sideslip angle
Cn0_table = table(
    GRID_BETA1, GRID_ALPHA1,
    ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.018, 0.019, 0.018, 0.019, 0.019, 0.018, 0.013, 0.007, 0.004, -0.014, -0.017, -0.033),
    (0.038, 0.042, 0.042, 0.042, 0.043, 0.039, 0.03, 0.017, 0.004, -0.035, -0.047, -0.057),
    (0.056, 0.057, 0.059, 0.058, 0.058, 0.053, 0.032, 0.012, 0.002, -0.046, -0.071, -0.073),
    (0.064, 0.077, 0.076, 0.074, 0.073, 0.057, 0.029, 0.007, 0.012, -0.034, -0.065, -0.041),
    (0.074, 0.086, 0.093, 0.089, 0.08, 0.062, 0.049, 0.022, 0.028, -0.012, -0.002, -0.013),
    (0.079, 0.09, 0.106, 0.106, 0.096, 0.08, 0.068, 0.03, 0.064, 0.015, 0.011, -0.001))
)

# Basic Cm: Basic coefficient of pitching-moment as a function of angle of attack and elevator
Cm0_table = table(
    GRID_DE1, GRID_ALPHA1,
    ((0.205, 0.168, 0.186, 0.196, 0.213, 0.251, 0.245, 0.238, 0.252, 0.231, 0.198, 0.192),
    (0.081, 0.077, 0.107, 0.11, 0.11, 0.141, 0.127, 0.119, 0.133, 0.108, 0.081, 0.093),
    (-0.046, -0.02, -0.009, -0.005, -0.006, 0.01, 0.006, -0.001, 0.014, 0.0, -0.013, 0.032),
    (-0.174, -0.145, -0.121, -0.127, -0.129, -0.102, -0.097, -0.113, -0.087, -0.084, -0.069, -0.006),
    (-0.259, -0.202, -0.184, -0.193, -0.199, -0.15, -0.16, -0.167, -0.104, -0.076, -0.041, -0.005))
)

# CXq: Damping derivative: axial force due to pitch rate as a function of angle-of-attack
CXq_table = table(GRID_ALPHA1, (-0.267, -0.11, 0.308, 1.34, 2.08, 2.91, 2.76, 2.05, 1.5, 1.49, 1.83, 1.21))

# CYr: Damping derivative: lateral force due to yaw rate as a function of angle-of-attack
CYr_table = table(GRID_ALPHA1, (0.882, 0.852, 0.876, 0.958, 0.962, 0.974, 0.819, 0.483, 0.59, 1.21, -0.493, -1.04))

# CYp: Damping derivative: lateral force due to roll rate as a function of angle-of-attack
CYp_table = table(
    GRID_ALPHA1,
    (-0.108, -0.108, -0.188, 0.11, 0.258, 0.226, 0.344, 0.362, 0.611, 0.529, 0.298, -0.227)
)

# CZq: Damping derivative: normal force due to pitch rate as a function of angle-of-attack
CZq_table = table(GRID_ALPHA1, (-8.8, -25.8, -28.9, -31.4, -31.2, -30.7, -27.7, -28.2, -29.0, -29.8, -38.3, -35.3))

# Clr: Damping derivative: rolling moment due to yaw rate as a function of angle-of-attack
Clr_table = table(GRID_ALPHA1, (-0.126, -0.026, 0.063, 0.113, 0.208, 0.23, 0.319, 0.437, 0.68, 0.1, 0.447, -0.33))

# Clp: Damping derivative: rolling moment due to roll rate as a function of angle-of-attack
Clp_table = table(
    GRID_ALPHA1,
    (-0.36, -0.359, -0.443, -0.42, -0.383, -0.375, -0.329, -0.294, -0.23, -0.21, -0.12, -0.1)
)

# Cmq: Damping derivative: pitching moment due to pitch rate as a function of angle-of-attack
Cmq_table = table(GRID_ALPHA1, (-7.21, -5.4, -5.23, -5.26, -6.11, -6.64, -5.69, -6.0, -6.2, -6.4, -6.6, -6.0))

# Cnr: Damping derivative: yawing moment due to yaw rate as a function of angle-of-attack
Cnr_table = table(
    GRID_ALPHA1,
    (-0.38, -0.363, -0.378, -0.386, -0.37, -0.453, -0.55, -0.582, -0.595, -0.637, -1.02, -0.84)
)

# Cnp: Damping derivative: yawing moment due to roll rate as a function of angle-of-attack
Cnp_table = table(GRID_ALPHA1, (0.061, 0.052, 0.052, -0.012, -0.013, -0.024, 0.05, 0.15, 0.13, 0.158, 0.24, 0.15))
GRID_BETA2 = (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0)

# dlda: Rolling moment increment due to aileron deflection as a function of angles of attack and sideslip
dlda_table = table(
    GRID_BETA2, GRID_ALPHA1,
    ((-0.041, -0.052, -0.053, -0.056, -0.05, -0.056, -0.082, -0.059, -0.042, -0.038, -0.027, -0.017),
    (-0.041, -0.053, -0.053, -0.053, -0.05, -0.051, -0.066, -0.043, -0.038, -0.027, -0.023, -0.016),
    (-0.042, -0.053, -0.052, -0.051, -0.049, -0.049, -0.043, -0.035, -0.026, -0.016, -0.018, -0.014),
    (-0.04, -0.052, -0.051, -0.052, -0.048, -0.048, -0.042, -0.037, -0.031, -0.026, -0.017, -0.012),
    (-0.043, -0.049, -0.048, -0.049, -0.043, -0.042, -0.042, -0.036, -0.025, -0.021, -0.016, -0.011),
    (-0.044, -0.048, -0.048, -0.047, -0.042, -0.041, -0.02, -0.028, -0.013, -0.014, -0.011, -0.01),
    (-0.043, -0.049, -0.047, -0.045, -0.042, -0.037, -0.003, -0.013, -0.01, -0.003, -0.007, -0.008))
)

# dldr: Rolling moment increment due to rudder deflection as a function of angles of attack and sideslip
dldr_table = table(
    GRID_BETA2, GRID_ALPHA1,
    ((0.005, 0.017, 0.014, 0.01, -0.005, 0.009, 0.019, 0.005, 0.0, -0.005, -0.011, 0.008),
    (0.007, 0.016, 0.014, 0.014, 0.013, 0.009, 0.012, 0.005, 0.0, 0.004, 0.009, 0.007),
    (0.013, 0.013, 0.011, 0.012, 0.011, 0.009, 0.008, 0.005, 0.0, 0.005, 0.003, 0.005),
    (0.018, 0.015, 0.015, 0.014, 0.014, 0.014, 0.014, 0.015, 0.013, 0.011, 0.006, 0.001),
    (0.015, 0.014, 0.013, 0.013, 0.012, 0.011, 0.011, 0.01, 0.008, 0.008, 0.007, 0.003),
    (0.021, 0.011, 0.01, 0.011, 0.01, 0.009, 0.008, 0.01, 0.006, 0.005, 0.0, 0.001),
    (0.023, 0.01, 0.011, 0.011, 0.011, 0.01, 0.008, 0.01, 0.006, 0.014, 0.02, 0.0))
)

# dnda: Yawing moment increment due to aileron deflection as a function of angles of attack and sideslip
dnda_table = table(
    GRID_BETA2, GRID_ALPHA1,
    ((0.001, -0.027, -0.017, -0.013, -0.012, -0.016, 0.001, 0.017, 0.011, 0.017, 0.008, 0.016),
    (0.002, -0.014, -0.016, -0.016, -0.014, -0.019, -0.021, 0.002, 0.012, 0.016, 0.015, 0.011),
    (-0.006, -0.008, -0.006, -0.006, -0.005, -0.008, -0.005, 0.007, 0.004, 0.007, 0.006, 0.006),
    (-0.011, -0.011, -0.01, -0.009, -0.008, -0.006, 0.0, 0.004, 0.007, 0.01, 0.004, 0.01),
    (-0.015, -0.015, -0.014, -0.012, -0.011, -0.008, -0.002, 0.002, 0.006, 0.012, 0.011, 0.011),
    (-0.024, -0.01, -0.004, -0.002, -0.001, 0.003, 0.014, 0.006, -0.001, 0.004, 0.004, 0.006),
    (-0.022, 0.002, -0.003, -0.005, -0.003, -0.001, -0.009, -0.009, -0.001, 0.003, -0.002, 0.001))
)

# dndr: Yawing moment increment due to rudder deflection as a function of angles of attack and sideslip
dndr_table = table(
    GRID_BETA2, GRID_ALPHA1,
    ((-0.018, -0.052, -0.052, -0.052, -0.054, -0.049, -0.059, -0.051, -0.03, -0.037, -0.026, -0.013),
    (-0.028, -0.051, -0.043, -0.046, -0.045, -0.049, -0.057, -0.052, -0.03, -0.033, -0.03, -0.008),
    (-0.037, -0.041, -0.038, -0.04, -0.04, -0.038, -0.037, -0.03, -0.027, -0.024, -0.019, -0.013),
    (-0.048, -0.045, -0.045, -0.045, -0.044, -0.045, -0.047, -0.048, -0.049, -0.045, -0.033, -0.016),
    (-0.043, -0.044, -0.041, -0.041, -0.04, -0.038, -0.034, -0.035, -0.035, -0.029, -0.022, -0.009),
    (-0.052, -0.034, -0.036, -0.036, -0.035, -0.028, -0.024, -0.023, -0.02, -0.016, -0.01, -0.014),
    (-0.062, -0.034, -0.027, -0.028, -0.027, -0.027, -0.023, -0.023, -0.019, -0.009, -0.025, -0.01))
)


class Outputs(NamedTuple):
    """What the model gives."""
    cbar: float  # referenceWingChord, ft
    bspan: float  # referenceWingSpan, ft
    sref: float  # referenceWingArea, ft2
    cx: float  # aeroBodyForceCoefficient_X, nd
    cy: float  # aeroBodyForceCoefficient_Y, nd
    cz: float  # aeroBodyForceCoefficient_Z, nd
    cl: float  # aeroBodyMomentCoefficient_Roll, nd
    cm: float  # aeroBodyMomentCoefficient_Pitch, nd
    cn: float  # aeroBodyMomentCoefficient_Yaw, nd


def model(vt, alpha, beta, p, q, r, el, ail, rdr):
    """The outputs, in the units of the file.

    vt: trueAirspeed, ft_s - True airspeed, ft/sec
    alpha: angleOfAttack, deg - Instantaneous true angle-of-attack, in degrees
    beta: angleOfSideslip, deg (wind in right ear) - Instantaneous true angle-of-sideslip, in degrees
    p: bodyAngularRate_Roll, rad_s (right wing down) - Body roll rate, rad/sec
    q: bodyAngularRate_Pitch, rad_s (aircraft nose up) - Body pitch rate, rad/sec
    r: bodyAngularRate_Yaw, rad_s (aircraft nose right) - Body yaw rate, rad/sec
    el: elevatorDeflection, deg (trailing edge down) - Elevator deflection angle, in degrees (+TED)
    ail: aileronDeflection, deg (left roll) - Aileron deflection angle, in degrees (+LWD)
    rdr: rudderDeflection, deg (TEL) - Rudder deflection angle, in degrees (+TEL)
    """
    vt = larger(vt, 0.1)  # trueAirspeed, ft_s: True airspeed, ft/sec
    rtd = 180.0 / 3.14159265  # rtd, deg_rad: Conversion constant from radians to degrees
    del_ = el / 25.0  # del, nd: Normalized elevator deflection (note range is beyond breakpoint range)
    dail = ail / 20.0  # dail, nd: Normalized aileron deflection.
    drdr = rdr / 30.0  # drdr, nd: Normalized rudder deflection.
    # CX0, nd (forward): Basic coefficient of force in the X-body direction (+FWD). Function table based on angle of
    # attack and elevator deflection.
    cxt = CX_table(el, alpha)
    # CY0, nd (right): Basic coefficient of force in the Y-body direction (+right). Function of sideslip angle,
    # aileron and rudder deflection.
    cy0 = -0.02 * beta + 0.021 * dail + 0.086 * drdr
    # CZ0, nd (down): Basic coefficient of force in the Z-body direction (+DWN). Function table based on angle of
    # attack and elevator deflection.
    czt = CZ0_table(alpha)
    # CZ1, nd (down): Coefficient of force in the Z-body direction, modified from basic CZ0 to include effects of
    # sideslip and elevator deflection.
    cz1 = czt * (1.0 + -(beta / rtd) ** 2) + -0.19 * del_
    tvt = 2.0 * vt  # tvt, ft_s: Twice velocity.
    b2v = bspan / tvt  # b2v, nd: Wing span over 2 times velocity. Used for coefficient normalization.
    # cq2v, nd: Chord times pitch rate over 2 times velocity. Used to normalize aero coefficients.
    cq2v = cbar * (q / tvt)
    absbeta = abs(beta)  # absbeta, deg: Absolute value of angle-of-sideslip, deg.
    absCl0 = Cl0_table(absbeta, alpha)  # absCl0, nd: Absolute value of rolling moment coefficient
    absCn0 = Cn0_table(absbeta, alpha)  # absCn0, nd: Absolute value of yawing moment coefficient
    # Cl0, nd (right wing down): Basic coefficient of moment around the X-body direction (roll) (+RWD)
    clt = -absCl0 if beta < 0.0 else absCl0
    # Cm0, nd (nose up): Basic coefficient of moment around the Y-body direction (pitch) (+ANU)
    cmt = Cm0_table(el, alpha)
    # Cn0, nd (nose right): Basic coefficient of moment around the Z-body direction (yaw) (+RWD)
    cnt = -absCn0 if beta < 0.0 else absCn0
    # CXq, _rad (fwd/+up): Damping derivative: axial force increment per radian/sec of pitch rate
    cxq = CXq_table(alpha)
    # CYr, _rad (right/+right): Damping derivative: lateral force increment per radian/sec of yaw rate
    cyr = CYr_table(alpha)
    # CYp, _rad (right/+right): Damping derivative: lateral force increment per radian/sec of roll rate
    cyp = CYp_table(alpha)
    # CZq, _rad (down/+up): Damping derivative: vertical force increment per radian/sec of pitch rate
    czq = CZq_table(alpha)
    # Clr, _rad (right/+right): Damping derivative: rolling moment increment per radian/sec of yaw rate
    clr = Clr_table(alpha)
    # Clp, s_rad (right/+right): Damping derivative: rolling moment increment per radian/sec of roll rate
    clp = Clp_table(alpha)
    # Cmq, s_rad (up/+up): Damping derivative: pitching moment increment per radian/sec of pitch rate
    cmq = Cmq_table(alpha)
    # Cnr, s_rad (right/+right): Damping derivative: yawing moment increment per radian/sec of yaw rate
    cnr = Cnr_table(alpha)
    # Cnp, s_rad (right/+right): Damping derivative: yawing moment increment per radian/sec of roll rate
    cnp = Cnp_table(alpha)
    # ClDA, _deg (right/+left): Control power derivative: rolling moment per deg of aileron deflection
    dclda = dlda_table(beta, alpha)
    # ClDR, _deg (right/+left): Control power derivative: rolling moment per deg of rudder deflection
    dcldr = dldr_table(beta, alpha)
    # CnDA, _deg (right/+left): Control power derivative: yawing moment per deg of aileron deflection
    dcnda = dnda_table(beta, alpha)
    # CnDR, _deg (right/+left): Control power derivative: yawing moment per deg of rudder deflection
    dcndr = dndr_table(beta, alpha)
    cl1 = clt + dclda * dail + dcldr * drdr  # Cl1, nd: Initial value of rolling moment, less damping terms
    # Cn, nd: Initial value of rolling moment coefficient without damping terms
    cn1 = cnt + dcnda * dail + dcndr * drdr
    # aeroBodyForceCoefficient_X, nd (FWD): Total coefficient of force along the body X-axis acting at the moment
    # reference center
    cx = cxt + cq2v * cxq
    # aeroBodyForceCoefficient_Y, nd (RIGHT): Total coefficient of force along the body Y-axis acting at the moment
    # reference center
    cy = cy0 + b2v * (cyp * p + cyr * r)
    # aeroBodyForceCoefficient_Z, nd (DOWN): Total coefficient of force along the body Z-axis acting at the moment
    # reference center
    cz = cz1 + cq2v * czq
    # aeroBodyMomentCoefficient_Roll, nd (RWD): Total coefficient of moment around the moment reference center in
    # the body X-axis (rolling moment)
    cl = cl1 + b2v * (clp * p + clr * r)
    # aeroBodyMomentCoefficient_Pitch, nd (ANU): Total coefficient of moment around the moment reference center in
    # the body Y-axis (pitching moment)
    cm = cmt + cq2v * cmq
    # aeroBodyMomentCoefficient_Yaw, nd (ANR): Total coefficient of moment around the moment reference center in the
    # body Z-axis (yawing moment)
    cn = cn1 + b2v * (cnp * p + cnr * r)
    return Outputs(cbar, bspan, sref, cx, cy, cz, cl, cm, cn)

SPAN = 9.144  # m, of the reduced rates
CHORD = 3.450336  # m, of the reduced rates


def coefficients(air, controls, rates, settings):
    """Coefficients in body axes about the moment reference of the file."""
    out = model(
        vt=air.airspeed / 0.3048, alpha=air.angle_of_attack / DEGREE, beta=air.sideslip / DEGREE, p=rates.roll_rate
        * 2.0 * air.airspeed / SPAN, q=rates.pitch_rate * 2.0 * air.airspeed / CHORD, r=rates.yaw_rate * 2.0 *
        air.airspeed / SPAN, el=controls.elevator / DEGREE, ail=-controls.aileron / DEGREE, rdr=controls.rudder /
        DEGREE
    )
    return Coefficients(CX=out.cx, CY=out.cy, CZ=out.cz, Cl=out.cl, Cm=out.cm, Cn=out.cn)
