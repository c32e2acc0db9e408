"""Quantities derived from state, measurement and commands at each control tick.

Each quantity has a row in the lane memory, whose name ends with the unit.
"""

import math

from abhv_mc_vehicle.kernel.flight.ripple import (
    FREQUENCY,
    LARGEST,
    N_RIPPLE_ROWS,
    begin_stretch,
    change_side,
    keep_cycle,
    watch_sides,
)
from abhv_mc_vehicle.kernel.flight.sensors import END_ROW
from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.numerics.lane_math import wrap
from abhv_mc_vehicle.kernel.numerics.quaternion import vector_at
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import HIGH
from abhv_mc_vehicle.kernel.plant.state import X

_DEG = 180.0 / math.pi
_G0 = 9.80665  # standard gravity, m/s2
_SUTTON_GRAVES = 1.7415e-4  # Sutton-Graves constant, kg^0.5/m

# The following rows of the lane memory keep their values from tick to tick.
FIRST_SURFACE = END_ROW  # initial deflections: aileron, rudder, elevator
LAST_SURFACE = FIRST_SURFACE + 3  # deflections at the previous tick
FIRST_MASS = LAST_SURFACE + 3
RIPPLES = FIRST_MASS + 1  # ripples of bank, angle of attack and sideslip
FIRST_DERIVED = RIPPLES + 3 * N_RIPPLE_ROWS  # first row of the derived quantities
_EACH = tuple(RIPPLES + i * N_RIPPLE_ROWS for i in range(3))
BANK_RIPPLE_DEG, ANGLE_OF_ATTACK_RIPPLE_DEG, SIDESLIP_RIPPLE_DEG = (row + LARGEST for row in _EACH)
BANK_CYCLE_HZ, ANGLE_OF_ATTACK_CYCLE_HZ, SIDESLIP_CYCLE_HZ = (row + FREQUENCY for row in _EACH)
FUEL_LEFT_KG, STAGNATION_HEAT_FLUX_W_M2, LOAD_FACTOR_G, HEADING_DEG = range(
    FIRST_DERIVED, FIRST_DERIVED + 4
)
_ERRORS = FIRST_DERIVED + 4
_SURFACES = FIRST_DERIVED + 10
ALTITUDE_ERROR_M, SPEED_ERROR_MPS, HEADING_ERROR_DEG, CROSS_TRACK_M = range(_ERRORS, _ERRORS + 4)
ANGLE_OF_ATTACK_ERROR_DEG, BANK_ERROR_DEG = range(_ERRORS + 4, _SURFACES)
AILERON_FROM_TRIM_DEG, RUDDER_FROM_TRIM_DEG, ELEVATOR_FROM_TRIM_DEG = range(
    _SURFACES, _SURFACES + 3
)
AILERON_MOVED_DEG, RUDDER_MOVED_DEG, ELEVATOR_MOVED_DEG = range(_SURFACES + 3, _SURFACES + 6)
FUEL_USED_KG, SURFACE_SATURATED = range(_SURFACES + 6, _SURFACES + 8)
VERDICT = SURFACE_SATURATED + 1  # outcome code of the limit checks at this tick, 0 if none fails
_ANGLE_ERRORS = (BANK_ERROR_DEG, ANGLE_OF_ATTACK_ERROR_DEG, s.V_BETA)


@scalar
def heat_flux(density, airspeed, nose_radius):
    """Return the stagnation-point cold-wall heat flux, W/m2, or NaN if the radius (m) is 0.

    The formula for air, k sqrt(density / radius) V^3, is from Sutton and Graves, NASA TR R-376
    (1971).
    """
    cubed = airspeed * airspeed * airspeed
    has_radius = nose_radius > 0.0
    return (
        _SUTTON_GRAVES * math.sqrt(density / (nose_radius if has_radius else 1.0)) * cubed
        if has_radius
        else math.nan
    )


@lanes
def remember_start(Z, width):
    """Store the initial deflections and mass, and initialize the ripple rows."""
    for lane in range(width):
        for i in range(3):
            Z[FIRST_SURFACE + i, lane] = Z[X + s.AILERON + i, lane]
            Z[LAST_SURFACE + i, lane] = Z[X + s.AILERON + i, lane]
        Z[FIRST_MASS, lane] = Z[X + s.MASS, lane]
    for i in range(3):
        begin_stretch(Z, width, RIPPLES + i * N_RIPPLE_ROWS)


@lanes
def derive(Z, width, reference, vehicle, tick):
    """Compute the derived quantities at a tick; ``reference`` has the shape [tick, column]."""
    constants = vehicle.constants
    for lane in range(width):
        fuel_left = Z[X + s.MASS, lane] - constants.mass_empty * Z[s.K_MASS, lane]
        Z[FUEL_LEFT_KG, lane] = fuel_left if constants.burns_fuel > 0.0 else math.inf
        Z[FUEL_USED_KG, lane] = Z[FIRST_MASS, lane] - Z[X + s.MASS, lane]
        Z[STAGNATION_HEAT_FLUX_W_M2, lane] = heat_flux(
            Z[s.RHO, lane], Z[s.AIRSPEED, lane], constants.nose_radius
        )
        x, y, z = vector_at(Z, s.SPECIFIC_X, lane)
        Z[LOAD_FACTOR_G, lane] = math.sqrt(x * x + y * y + z * z) / _G0
        chi = Z[s.CHI, lane]
        Z[HEADING_DEG, lane] = (chi if chi >= 0.0 else chi + 2.0 * math.pi) * _DEG
        Z[HEADING_ERROR_DEG, lane] = wrap(chi - reference[tick, ref.HEADING]) * _DEG
        Z[ALTITUDE_ERROR_M, lane] = Z[X + s.ALTITUDE, lane] - reference[tick, ref.ALTITUDE]
        Z[SPEED_ERROR_MPS, lane] = Z[s.SPEED, lane] - reference[tick, ref.SPEED]
        north = Z[s.NORTH, lane] - reference[tick, ref.NORTH]
        east = Z[s.EAST, lane] - reference[tick, ref.EAST]
        Z[CROSS_TRACK_M, lane] = (
            north * reference[0, ref.TRACK_NORTH] + east * reference[0, ref.TRACK_EAST]
        )
        Z[ANGLE_OF_ATTACK_ERROR_DEG, lane] = Z[s.V_ALPHA, lane] * _DEG - Z[s.ALPHA_CMD, lane] * _DEG
        Z[BANK_ERROR_DEG, lane] = wrap(Z[s.BANK, lane] - Z[s.BANK_CMD, lane]) * _DEG
        # A surface whose command is at the limit counts as saturated, because its deflection
        # approaches the limit asymptotically.
        saturated = False
        for i in range(3):
            deflection = Z[X + s.AILERON + i, lane]
            limit = vehicle.actuators[i, HIGH]
            saturated |= limit > 0.0 and (
                abs(deflection) >= limit * Z[s.K_LIMIT, lane] or abs(Z[s.CMD + i, lane]) >= limit
            )
            Z[AILERON_FROM_TRIM_DEG + i, lane] = (deflection - Z[FIRST_SURFACE + i, lane]) * _DEG
            Z[AILERON_MOVED_DEG + i, lane] = abs(deflection - Z[LAST_SURFACE + i, lane]) * _DEG
            Z[LAST_SURFACE + i, lane] = deflection
        Z[SURFACE_SATURATED, lane] = (
            Z[s.ANY_SATURATED, lane] if constants.driven > 0.0 else 1.0 if saturated else 0.0
        )


@lanes
def follow_ripples(Z, width, settled, tick, length):
    """Update the ripple cycles of bank, angle of attack and sideslip.

    ``settled`` is the number of the tick in its settled interval, starting at 1, or 0 outside
    settled intervals.
    """
    for i in range(3):
        row = RIPPLES + i * N_RIPPLE_ROWS
        factor = _DEG if i == 2 else 1.0
        if settled == 1.0:
            for lane in range(width):
                keep_cycle(Z, lane, row, length)
            begin_stretch(Z, width, row)
        if (
            settled > 0.0
            and watch_sides(Z, width, row, _ANGLE_ERRORS[i], factor, 1.0 / settled, float(tick))
            > 0.0
        ):
            for lane in range(width):
                change_side(Z, lane, row, Z[_ANGLE_ERRORS[i], lane] * factor, float(tick), length)


@lanes
def end_ripples(Z, lane, length):
    """Complete the ripple cycles at a flight's end; ``length`` is the control period, s."""
    for i in range(3):
        keep_cycle(Z, lane, RIPPLES + i * N_RIPPLE_ROWS, length)
