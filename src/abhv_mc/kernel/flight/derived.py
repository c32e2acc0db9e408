"""Observed quantities that the lane memory does not hold, once a control tick: one function each, named as its source.

Each takes the lane memory, a lane, what it sees of the plan and the tick, and returns the unit that its name ends with.
"""

import math
from typing import NamedTuple

from abhv_mc.array_types import Floats
from abhv_mc.kernel.flight.interface import Timing
from abhv_mc.kernel.flight.ripple import (
    FREQUENCY,
    LARGEST,
    N_RIPPLE_ROWS,
    begin_stretch,
    change_side,
    keep_cycle,
    watch_sides,
)
from abhv_mc.kernel.flight.sensors import END_ROW
from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.laws import columns as ref
from abhv_mc.kernel.numerics.angles import larger, wrap
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.heating import heat_flux
from abhv_mc.kernel.plant.state import X
from abhv_mc.kernel.plant.vehicle import Constants

_DEG = 180.0 / math.pi
_G0 = 9.80665  # m/s2

# Rows of the lane memory: what is remembered of the flight so far.
FIRST_SURFACE = END_ROW  # deflections at the start: aileron, rudder, elevator
LAST_SURFACE = FIRST_SURFACE + 3  # deflections at the last tick
FIRST_MASS = LAST_SURFACE + 3
RIPPLES = FIRST_MASS + 1  # of bank, angle of attack and sideslip
FIRST_DERIVED = RIPPLES + 3 * N_RIPPLE_ROWS  # the quantities themselves
_EACH = tuple(RIPPLES + i * N_RIPPLE_ROWS for i in range(3))
BANK_RIPPLE_DEG, ANGLE_OF_ATTACK_RIPPLE_DEG, SIDESLIP_RIPPLE_DEG = (row + LARGEST for row in _EACH)
BANK_CYCLE_HZ, ANGLE_OF_ATTACK_CYCLE_HZ, SIDESLIP_CYCLE_HZ = (row + FREQUENCY for row in _EACH)


class Observing(NamedTuple):
    """What of a plan these functions see: the whole of it is hundreds of arguments of each, and slow to compile."""

    reference: Floats  # [tick, column]
    timing: Timing
    constants: Constants


@lanes
def remember_start(Z, width):
    """Deflections and mass at the start, to which some quantities refer; no side has been seen."""
    for lane in range(width):
        for i in range(3):
            Z[FIRST_SURFACE + i, lane] = Z[X + s.AILERON + i, lane]
            Z[LAST_SURFACE + i, lane] = Z[X + s.AILERON + i, lane]
        Z[FIRST_MASS, lane] = Z[X + s.MASS, lane]
    for i in range(3):
        begin_stretch(Z, width, RIPPLES + i * N_RIPPLE_ROWS)


@lanes
def altitude_error_m(Z, lane, plan, tick):
    """Altitude minus reference."""
    return Z[X + s.ALTITUDE, lane] - plan.reference[tick, ref.ALTITUDE]


@lanes
def speed_error_mps(Z, lane, plan, tick):
    """Earth-relative speed minus reference."""
    return Z[s.SPEED, lane] - plan.reference[tick, ref.SPEED]


@lanes
def heading_deg(Z, lane, plan, tick):
    """Heading of the velocity in 0..360 deg."""
    chi = Z[s.CHI, lane]
    return (chi if chi >= 0.0 else chi + 2.0 * math.pi) * _DEG


@lanes
def heading_error_deg(Z, lane, plan, tick):
    """Heading minus reference."""
    return wrap(Z[s.CHI, lane] - plan.reference[tick, ref.HEADING]) * _DEG


@lanes
def cross_track_m(Z, lane, plan, tick):
    """Distance to the left of the reference."""
    north = Z[s.NORTH, lane] - plan.reference[tick, ref.NORTH]
    east = Z[s.EAST, lane] - plan.reference[tick, ref.EAST]
    return north * plan.reference[0, ref.TRACK_NORTH] + east * plan.reference[0, ref.TRACK_EAST]


@lanes
def angle_of_attack_error_deg(Z, lane, plan, tick):
    """Angle of attack minus its command."""
    return Z[s.V_ALPHA, lane] * _DEG - Z[s.ALPHA_CMD, lane] * _DEG


@lanes
def bank_error_deg(Z, lane, plan, tick):
    """Bank minus its command."""
    return wrap(Z[s.BANK, lane] - Z[s.BANK_CMD, lane]) * _DEG


@lanes
def load_factor_g(Z, lane, plan, tick):
    """Magnitude of the specific force."""
    x, y, z = Z[s.SPECIFIC_X, lane], Z[s.SPECIFIC_Y, lane], Z[s.SPECIFIC_Z, lane]
    return math.sqrt(x * x + y * y + z * z) / _G0


@lanes
def follow_ripples(Z, width, plan, tick, errors):
    """Cycles of bank, angle of attack and sideslip, from rows of their errors."""
    length, now = plan.timing.step * plan.timing.steps_per_tick, float(tick)
    settled = plan.reference[tick, ref.SETTLED]
    for i in range(3):
        row, factor = RIPPLES + i * N_RIPPLE_ROWS, _DEG if i == 2 else 1.0
        if settled == 1.0:
            for lane in range(width):
                keep_cycle(Z, lane, row, length)
            begin_stretch(Z, width, row)
        if settled > 0.0 and watch_sides(Z, width, row, errors[i], factor, 1.0 / settled, now) > 0.0:
            for lane in range(width):
                change_side(Z, lane, row, Z[errors[i], lane] * factor, now, length)


@lanes
def end_ripples(Z, lane, plan):
    """At the end of a flight the third side of a cycle counts as far as it has got."""
    for i in range(3):
        keep_cycle(Z, lane, RIPPLES + i * N_RIPPLE_ROWS, plan.timing.step * plan.timing.steps_per_tick)


@lanes
def fuel_left_kg(Z, lane, plan, tick):
    """Mass above the empty one; infinite for a vehicle that burns no fuel."""
    constants = plan.constants
    return Z[X + s.MASS, lane] - constants.mass_empty * Z[s.K_MASS, lane] if constants.burns_fuel > 0.0 else math.inf


@lanes
def stagnation_heat_flux_w_m2(Z, lane, plan, tick):
    """Heat flux at the stagnation point; not a number for a vehicle without a nose radius."""
    return heat_flux(Z[s.RHO, lane], Z[s.AIRSPEED, lane], plan.constants.nose_radius)


@lanes
def fuel_used_kg(Z, lane, plan, tick):
    """Mass at the start minus mass."""
    return Z[FIRST_MASS, lane] - Z[X + s.MASS, lane]


@lanes
def surface_saturated(Z, lane, plan, tick):
    """1 where a surface or its command is at the deflection limit.

    A command at the stop counts too: the surface creeps towards it and may never arrive.
    """
    if plan.constants.driven > 0.0:
        return Z[s.ANY_SATURATED, lane]
    nominal_limit = plan.constants.surface_limit
    limit = nominal_limit * Z[s.K_LIMIT, lane]
    largest = larger(abs(Z[X + s.AILERON, lane]), abs(Z[X + s.RUDDER, lane]))
    largest = larger(largest, abs(Z[X + s.ELEVATOR, lane]))
    command = larger(abs(Z[s.CMD_AILERON, lane]), abs(Z[s.CMD_RUDDER, lane]))
    command = larger(command, abs(Z[s.CMD_ELEVATOR, lane]))
    saturated = (largest >= limit or command >= nominal_limit) and limit > 0.0
    return 1.0 if saturated else 0.0


def _make_from_trim(i):
    """The function of surface ``i`` of aileron, rudder and elevator."""

    @lanes
    def from_trim_deg(Z, lane, plan, tick):
        """Deflection minus that at the start."""
        return (Z[X + s.AILERON + i, lane] - Z[FIRST_SURFACE + i, lane]) * _DEG

    return from_trim_deg


def _make_moved(i):
    @lanes
    def moved_deg(Z, lane, plan, tick):
        """Absolute change of the deflection since the last tick."""
        deflection = Z[X + s.AILERON + i, lane]
        moved = abs(deflection - Z[LAST_SURFACE + i, lane]) * _DEG
        Z[LAST_SURFACE + i, lane] = deflection
        return moved

    return moved_deg


aileron_from_trim_deg, rudder_from_trim_deg, elevator_from_trim_deg = map(_make_from_trim, range(3))
aileron_moved_deg, rudder_moved_deg, elevator_moved_deg = map(_make_moved, range(3))

# The functions above that a flight has a row for, in the order of the rows.
DERIVED = (
    "fuel_left_kg",
    "stagnation_heat_flux_w_m2",
    "load_factor_g",
    "heading_deg",
    "altitude_error_m",
    "speed_error_mps",
    "heading_error_deg",
    "cross_track_m",
    "angle_of_attack_error_deg",
    "bank_error_deg",
    "aileron_from_trim_deg",
    "elevator_from_trim_deg",
    "rudder_from_trim_deg",
    "aileron_moved_deg",
    "elevator_moved_deg",
    "rudder_moved_deg",
    "fuel_used_kg",
    "surface_saturated",
)
