"""F-16 simple control system.

Control system for DAVE-ML example F-16 aircraft model. Includes LQR inner-loop and loop-closure outerloop autopilot
to follow altitude, courseline, and airspeed commands. The gains are set for a nominal flight condition of 10,013 ft
MSL at Mach 0.525 (565.7 ft/s true airspeed or 287.8 kt equivalent) which correspond with atmospheric scenarios 11,
13, 15 and 16 of reference 1. Inputs are pilot primary flight controls, autopilot settings, mode selection flags,
and feedback of various flight condition parameters. Outputs are control surface deflection commands for the F-16
described in reference 2.

Imported from F16_control.dml (Revision F, 2013-10-22), SHA-256
bca7789dde61b741de69f697ce8799ee666214d0e1fa203973523774fc3a969b.
"""

from typing import NamedTuple
from abhv_mc.extend import Command, clamp, controller

DEGREE = 3.141592653589793 / 180.0  # rad

# autopilotAltErrorFeedbackGain, deg_ft: Gain in altitude compensator to vary pitch angle from trimmed based on
# altitude error; positive altitude error (meaning above reference altitude) results in a reduction of commanded
# pitch angle.
thetaCmdAltErrGain = -0.05

# designEulerAngle_Pitch, deg (+ANU): Flight control system design pitch angle of vehicle relative to local level
# (deg), +nose up
trimmedTheta = 2.653813535191715

# autopilotLatOffsetErrorFeedbackGain, deg_ft: Gain in lateral autopilot to vary true heading angle from base course
# based on lateral offset error; positive lateral offset error (meaning right of courseline) results in a reduction
# of commanded heading angle.
chiCmdYErrGain = -0.01

# autopilotTrackErrorFeedbackGain, deg_deg: Gain in lateral autopilot to set commanded bank angle based on track
# angle error; positive track angle error (meaning heading more clockwise from desired track angle) results in a
# negative bank angle command.
phiCmdChiErrGain = -10.0
trimmedAlpha = 2.653813535191715  # designAngleOfAttack, deg: Flight control system design angle of attack (deg)

# designEquivalentAirspeed, nim_h: Flight control system design equivalent airspeed (kt)
trimmedKEAS = 287.8088596053291
longLQR11 = -0.063009074230494  # longLQR_gain_matrix_11, h_nmi: Change to stick with change in airspeed (per kt)

# longLQR_gain_matrix_12, _deg: Change to stick with change in angle of attack (per deg)
longLQR12 = 0.113230403179271
longLQR13 = 10.113432224566077  # longLQR_gain_matrix_13, s_r: Change to stick with change in pitch rate (per rad/s)
longLQR14 = 3.154983341632913  # longLQR_gain_matrix_14, _deg: Change to stick with change in pitch angle (per deg)
longLQR21 = 0.997260602961658  # longLQR_gain_matrix_21, h_nmi: Change to throttle fraction with change in airspeed

# longLQR_gain_matrix_22, _deg: Change to throttle fraction with change in angle of attack (per deg)
longLQR22 = -0.025467711176391

# longLQR_gain_matrix_23, s_r: Change to throttle fraction with change in pitch rate (per rad/s)
longLQR23 = 1.213308488207827

# longLQR_gain_matrix_24, _deg: Change to throttle fraction with change in pitch angle (per deg)
longLQR24 = 0.208744369535208

# latdLQR_gain_matrix_11, _deg: Change to lat stick with change in roll angle (per deg)
latdLQR11 = 3.07804394151577

# latdLQR_gain_matrix_12, _deg: Change to lat stick with change in sideslip angle (per deg)
latdLQR12 = 0.032365863044163

# latdLQR_gain_matrix_13, s_r: Change to lat stick with change in roll rate (per rad/s)
latdLQR13 = 4.557858908828332

# latdLQR_gain_matrix_14, s_r: Change to lat stick with change in yaw rate (per rad/s)
latdLQR14 = 0.589443156647647

# latdLQR_gain_matrix_21, _deg: Change to rudder pedal input with change in roll angle (per deg)
latdLQR21 = -0.70581745275452

# latdLQR_gain_matrix_22, _deg: Change to rudder pedal input with change in sideslip angle (per deg)
latdLQR22 = -0.256362860634868

# latdLQR_gain_matrix_23, s_r: Change to rudder pedal input with change in roll rate (per rad/s)
latdLQR23 = -1.073666149713151

# latdLQR_gain_matrix_24, s_r: Change to rudder pedal input with change in yaw rate (per rad/s)
latdLQR24 = 0.822114635953878


class Outputs(NamedTuple):
    """What the model gives."""
    el: float  # elevatorDeflection, deg
    ail: float  # aileronDeflection, deg
    rdr: float  # rudderDeflection, deg
    PWR: float  # powerLeverAngle, pct


def model(
    throttle, longStk, latStk, pedal, sasOn, apOn, keasCmd, altCmd, latOffset, baseChiCmd, altMsl, Vequiv, alpha,
    beta, phi, theta, psi, pb, qb, rb, throttleTrim=0.1390191130965607, longStkTrim=0.1296382327486013
):
    """The outputs, in the units of the file.

    throttle: pilotControl_throttle, frac - Pilot throttle control position
    longStk: pilotControl_long, frac (+AFT) - Longitudinal (pitch) control position
    latStk: pilotControl_lat, frac (+RWD) - Lateral (roll) control position
    pedal: pilotControl_yaw, frac (+ANR) - Directional (yaw) control position
    sasOn: stabilityAugmentationOn_disc, nd - Stability augmentation engage flag (discrete); 1 = SAS engaged, 0 =
        SAS off
    apOn: autopilotOn_disc, nd - Autopilot engage flag (discrete); 1 = AP engaged, 0 = AP off (forces SAS on)
    keasCmd: equivalentAirspeedCommand, nmi_h - Equivalent airspeed command (kt) to autospeed logic
    altCmd: altitudeMslCommand, ft - Commanded altitude above sea level (ft) for autopilot
    latOffset: lateralDeviationError, ft (+RT) - Lateral deviation from desired courseline (ft, +right of course)
        for autopilot
    baseChiCmd: trueBaseCourseCommand, deg (+CCFN) - True heading of desired ground track (deg, +clockwise from
        north) for autopilot
    altMsl: altitudeMsl, ft - Geometric altitude above mean sea level (ft)
    Vequiv: equivalentAirspeed, nmi_h - Equivalent airspeed (kt)
    alpha: angleOfAttack, deg - Angle of attack (deg)
    beta: angleOfSideslip, deg (+RT) - Angle of sideslipe (deg), +wind in the pilot's right ear
    phi: eulerAngle_Roll, deg (+RWD) - Roll angle of vehicle relative to local level (deg), +right wing down
    theta: eulerAngle_Pitch, deg (+ANU) - Pitch angle of vehicle relative to local level (deg), +nose up
    psi: eulerAngle_Yaw, deg (+CWFN) - Yaw angle of vehicle relative to true North (deg), +clockwise
    pb: bodyAngularRate_Roll, rad_s (+RWD) - Vehicle body-axis roll rate (rad/s), +right wing down
    qb: bodyAngularRate_Pitch, rad_s (+ANU) - Vehicle body-axis pitch rate (rad/s), +aircraft nose up
    rb: bodyAngularRate_Yaw, rad_s (+ANR) - Vehicle body-axis yaw rate (rad/s) +aircraft nose right
    throttleTrim: trimmedPilotControl_throttle, frac - Trimmed position of throttle
    longStkTrim: trimmedPilotControl_long, frac (+AFT) - Trimmed position of pitch control
    """
    throttle = clamp(throttle, 0.0, 1.0)  # pilotControl_throttle, frac: Pilot throttle control position
    longStk = clamp(longStk, -1.0, 1.0)  # pilotControl_long, frac (+AFT): Longitudinal (pitch) control position
    latStk = clamp(latStk, -1.0, 1.0)  # pilotControl_lat, frac (+RWD): Lateral (roll) control position
    pedal = clamp(pedal, -1.0, 1.0)  # pilotControl_yaw, frac (+ANR): Directional (yaw) control position
    # forceStabAugOn_disc, nd: This flag is on ( > 0.5) if either stability augmentation or autopilot functions have
    # been selected on to ensure stability if autopilot has been requested; 1 = SAS engaged, 0 = SAS off
    fsasOn = sasOn + apOn
    # autopilotAltitudeError, ft (+HI): Error between commanded and actual altitude (ft). Positive if above
    # commanded altitude.
    altErr = altMsl - altCmd
    # autopilotDeltaPitchCmd, deg (+ANU): Calculates change in pitch attitude from trimmed value to correct an error
    # in altitude.
    deltaThetaCmd = clamp(altErr * thetaCmdAltErrGain, -5.0, 5.0)
    # autopilotPitchCmd, deg (+ANU): Captures and tracks commanded altitude by varying pitch attitude from trimmed
    # value based on altitude error.
    thetaCmd = deltaThetaCmd + trimmedTheta
    # trackAngleEst, deg (+CWFN): A quick-and-dirty estimate of vehicle track angle (course angle); reasonable for
    # small pitch and roll angles.
    chiEst = beta + psi
    # autopilotCourseCorrection, deg (+CW): Commanded track angle adjustment from base course to intercept and/or
    # track desired course; limited to a specified range.
    deltaChiCmd = clamp(chiCmdYErrGain * latOffset, -30.0, 30.0)
    # autopilotCourseCommand, deg (+CWFN): Commanded true track angle to intercept and/or track desired course.
    chiCmd = deltaChiCmd + baseChiCmd
    # autopilotTrackError, deg (+CW): The difference between commanded and actual true track angle; positive
    # indicates actual track is more clockwise (yawed right) than commanded. This value is not limited to +/- 180
    # deg.
    chiErrUnwrapped = chiEst - chiCmd
    # autopilotTrackErrorWrapped, deg: This is the track angle error resolved into a range of +/- 180 deg.
    chiErr = (
        (chiErrUnwrapped - 360.0 if chiErrUnwrapped > 0.0 else chiErrUnwrapped + 360.0) if abs(chiErrUnwrapped) >
        180.0 else chiErrUnwrapped
    )
    # autopilotCommandedBankAngle, deg (+RWD): Generate bank angle command to move back on-course
    phiCmd = clamp(phiCmdChiErrGain * chiErr, -30.0, 30.0)
    # switchedKEAScmd, nmi_h: Velocity reference used to calculate velocity disturbance to feed into LQR SAS. If the
    # autopilot select flag is on, use the commanded airspeed as the reference value; if not, use the trimmed
    # airspeed as the reference value.
    keasCmdSw = keasCmd if apOn > 0.5 else trimmedKEAS
    # switchedThetaCmd, deg: Pitch attitude reference used to calculate pitch angle disturbance to feed into LQR
    # SAS. If the autopilot select flag is on, use the commanded pitch attitude as the reference value; if not, use
    # the trimmed pitch attitude as the reference value.
    thetaCmdSw = thetaCmd if apOn > 0.5 else trimmedTheta
    # switchedPhiCmd, deg: Roll attitude reference used to calculate roll angle disturbance to feed into LQR SAS. If
    # the autopilot select flag is on, use the commanded roll attitude as the reference value; if not, use 0 as the
    # reference value.
    phiCmdSw = phiCmd if apOn > 0.5 else 0.0
    # disturbedEquivalentAirspeed, nmi_h: Disturbance away from commanded equivalent airspeed (kt)
    deltaVequiv = Vequiv - keasCmdSw
    # disturbedAngleOfAttack, deg: Disturbance away from design angle of attack (deg)
    deltaAlpha = alpha - trimmedAlpha
    deltaPhi = phi - phiCmdSw  # disturbedEulerAngle_roll, deg: Disturbance away from commanded bank angle (deg)
    # disturbedEulerAngle_pitch, deg: Disturbance away from commanded pitch angle (deg)
    deltaTheta = theta - thetaCmdSw
    # deltaLongLQR, frac: Longitudinal control output from LQR gain matrix; negated to stabilize plant
    longLQR = -(longLQR11 * deltaVequiv + longLQR12 * deltaAlpha + longLQR13 * qb + longLQR14 * deltaTheta)
    # deltaThrottleLQR, frac: Throttle fraction output from LQR gain matrix; negated to stabilize plant
    throttleLQR = -(longLQR21 * deltaVequiv + longLQR22 * deltaAlpha + longLQR23 * qb + longLQR24 * deltaTheta)
    # deltaLatLQR, frac: Lateral stick output from LQR control system
    latLQR = -(latdLQR11 * deltaPhi + latdLQR12 * beta + latdLQR13 * pb + latdLQR14 * rb)
    # deltaDirLQR, frac: Directional control output from LQR control system
    dirLQR = -(latdLQR21 * deltaPhi + latdLQR22 * beta + latdLQR23 * pb + latdLQR24 * rb)
    # switchedDeltaLongLQR, frac: Switched longitudinal output from LQR so SAS can be disabled
    longLQRsw = longLQR if fsasOn > 0.5 else 0.0
    # switchedDeltaThrottleLQR, frac: Switched throttle output from LQR so SAS can be disabled
    throttleLQRsw = throttleLQR if fsasOn > 0.5 else 0.0
    # switchedDeltaLatLQR, frac: Switched lateral command output from LQR so SAS can be disabled
    latLQRsw = latLQR if fsasOn > 0.5 else 0.0
    # switchedDeltaDirLQR, frac: Switched directional command output from LQR so SAS can be disabled
    dirLQRsw = dirLQR if fsasOn > 0.5 else 0.0
    # switchedPilotControl_long, frac: Ignore longitudinal input from pilot if autopilot selected
    longStkSw = longStk if apOn < 0.5 else 0.0
    # switchedPilotControl_throttle, frac: Ignore throttle input from pilot if autopilot selected
    throttleSw = throttle if apOn < 0.5 else 0.0
    # switchedPilotControl_lat, frac: Ignore lateral input from pilot if autopilot selected
    latStkSw = latStk if apOn < 0.5 else 0.0
    # switchedPilotControl_yaw, frac: Ignore directional input from pilot if autopilot selected
    pedalSw = pedal if apOn < 0.5 else 0.0
    # totalLongCmd, frac: Longitudinal input command to surface mixer. Combines trimmed position, pilot input (if AP
    # off), and stabization (and possibly autopilot) commands (if SAS on).
    totLongStk = clamp(longStkTrim + longStkSw + longLQRsw, -1.0, 1.0)
    # totalLatCmd, frac: Lateral input command to surface mixer. Combines pilot input (if AP off) with stabilization
    # (and possibly autopilot) commands (if SAS on).
    totLatStk = clamp(latStkSw + latLQRsw, -1.0, 1.0)
    # totalDirCmd, frac: Directional input command to surface mixer. Combines pilot input (if AP off) with
    # stabilization (and possibly autopilot) commands (if SAS on).
    totPedal = clamp(pedalSw + dirLQRsw, -1.0, 1.0)
    # totalThrottle, frac: Throttle command to power lever output. Combines trimmed throttle position, pilot input
    # (if AP off) with stabilization (and possibly autopilot) commands (if SAS on).
    totThrottle = clamp(throttleTrim + throttleSw + throttleLQRsw, 0.0, 1.0)
    # elevatorDeflection, deg (trailing edge down): Elevator deflection angle, in degrees (+TED)
    el = -25.0 * totLongStk
    ail = -21.5 * totLatStk  # aileronDeflection, deg (left roll): Aileron deflection angle, in degrees (+LWD)
    # rudderDeflection, deg (TEL): Rudder deflection angle, in degrees (+TEL); includes aileron-to-rudder gain
    rdr = -30.0 * totPedal + 0.008 * ail
    # powerLeverAngle, pct (+INCR): Throttle (power lever angle), 0 - 100. 50 is MIL (max dry) thrust; 100 is MAX
    # (burner)
    PWR = 100.0 * totThrottle
    return Outputs(el, ail, rdr, PWR)


class Commands(NamedTuple):
    """What the pilot and the autopilot are told, SI and radians."""
    throttle: float = 0.0  # pilotControl_throttle
    longStk: float = 0.0  # pilotControl_long
    latStk: float = 0.0  # pilotControl_lat
    pedal: float = 0.0  # pilotControl_yaw
    sasOn: float = 0.0  # stabilityAugmentationOn_disc
    apOn: float = 0.0  # autopilotOn_disc
    keasCmd: float = 0.0  # equivalentAirspeedCommand, m/s
    altCmd: float = 0.0  # altitudeMslCommand, m
    latOffset: float = 0.0  # lateralDeviationError, m
    latOffset_measured: float = 1.0  # 1: from the measured cross-track, 0: as commanded alone
    baseChiCmd: float = 0.0  # trueBaseCourseCommand, rad
    throttleTrim: float = 0.1390191130965607  # trimmedPilotControl_throttle
    longStkTrim: float = 0.1296382327486013  # trimmedPilotControl_long


@controller(units={'keasCmd': 'm/s', 'altCmd': 'm', 'latOffset': 'm', 'baseChiCmd': 'rad'})
def law(measured, commands):
    """Deflections and throttle from the measured motion."""
    out = model(
        throttle=commands.throttle, longStk=commands.longStk, latStk=commands.latStk, pedal=commands.pedal,
        sasOn=commands.sasOn, apOn=commands.apOn, keasCmd=commands.keasCmd / 0.5144444444444445,
        altCmd=commands.altCmd / 0.3048, latOffset=(commands.latOffset - commands.latOffset_measured *
        measured.cross_track) / 0.3048, baseChiCmd=commands.baseChiCmd / DEGREE, altMsl=measured.altitude / 0.3048,
        Vequiv=measured.equivalent_airspeed / 0.5144444444444445, alpha=measured.angle_of_attack / DEGREE,
        beta=measured.sideslip / DEGREE, phi=measured.roll / DEGREE, theta=measured.pitch / DEGREE, psi=measured.yaw
        / DEGREE, pb=measured.roll_rate, qb=measured.pitch_rate, rb=measured.yaw_rate,
        throttleTrim=commands.throttleTrim, longStkTrim=commands.longStkTrim
    )
    return Command(
        aileron=-out.ail * DEGREE, rudder=out.rdr * DEGREE, elevator=out.el * DEGREE, throttle=out.PWR * 0.01
    )
