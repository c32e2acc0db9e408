"""Inputs and results of the simulation kernel, as named tuples of numbers and arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints
from abhv_mc.flights.timing import Timing
from abhv_mc_vehicle.kernel.flight.counting import Counted
from abhv_mc_vehicle.kernel.plant.slopes import Effectiveness
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth

LANES = 32  # number of flights in a group

# kinds of control laws
TLC, LQR, RECORDED, PYTHON = range(4)


class Observed(NamedTuple):
    """Limits and recorded channels, which refer to rows of the lane memory."""

    limit_row: Ints  # [limit] row of the lane memory
    limit_outcome: Floats  # [limit] outcome if the row's value is outside the limits
    limit_low: Floats  # [limit] lower limit
    limit_high: Floats  # [limit] upper limit
    channel_row: Ints  # [channel] row of the lane memory
    channel_factor: Floats  # [channel] factor applied to the row's value


class UserCode(NamedTuple):
    """Addresses of compiled custom code, and options for its calls."""

    address: int  # address of the control law's machine code, 0 for none
    onboard: int  # 1 if the control law needs the nominal vehicle
    channels: int  # address of the code that computes custom channels, 0 for none
    # 1 if the control law may read more than ten measurements, 2 if these include accelerations
    more: int
    context: int = 0  # address of data used by the control law's machine code, 0 for none
    aerodynamics: int = 0  # addresses of the vehicle's custom functions, 0 for tables
    propulsion: int = 0
    dynamics: int = 0


class KernelPlan(NamedTuple):
    """Input data for a set of flights; read-only for the kernel."""

    law: int
    vehicle: Vehicle
    trim_tables: Tables
    effectiveness: Effectiveness
    earth: Earth
    timing: Timing
    record_every: int  # control ticks between samples, 0 for no history
    observed: Observed
    unit_factors: Ints  # [term] index of a factor that is 1, for terms of the nominal vehicle
    initial_state: Floats  # [state] initial state of the vehicle, followed by custom states
    reference: Floats  # reference [tick, column]
    gains: Floats  # gains [tick, gain]
    settings: Floats  # settings of the control law
    # [knot, column] nominal air (abhv_mc_vehicle.kernel.plant.air_data); empty for calm standard
    # air
    profile: Floats
    # [flight, parameter] parameters, followed by settings of custom functions and custom states
    parameters: Floats
    counted: Counted
    first_tick: int  # tick at which the flights start
    # [flight, row] lane memory at first_tick; empty if flights start at the mission's start
    start: Floats
    user_code: UserCode = UserCode(0, 0, 0, 0)


class KernelResults(NamedTuple):
    """Results of flights, filled by the kernel."""

    metrics: Floats  # metrics [flight, metric]
    outcome: NDArray[np.int64]  # outcome code [flight]
    end_tick: NDArray[np.int64]  # tick at the end of the flight [flight]
    history: NDArray[np.float32]  # recorded channels [flight, sample, channel]
    states: Floats  # [flight, sample, state] recorded states; empty unless requested
    # [sample, channel] extremes over all flights, from each sample to the tick before the next
    # sample. ``low`` exceeds ``high`` if no flight was simulated in this period. The arrays are
    # empty unless they are requested.
    low: Floats
    high: Floats
    saved: Floats  # [flight, row] lane memory before the last tick; empty unless requested
    samples: Floats  # [quantile, flight, tick] values of quantile metrics; NaN if not counted
