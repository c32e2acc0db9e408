"""Plan and results of the compiled flight, as named tuples of numbers and arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints
from abhv_mc.kernel.flight.counting import Counted
from abhv_mc.kernel.plant.slopes import Effectiveness
from abhv_mc.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc.kernel.world.earth import Earth

LANES = 32  # flights in a group

# Kinds of control laws.
TLC, LQR, RECORDED, PYTHON = range(4)


class Timing(NamedTuple):
    """Timing of a flight with control ticks 0..ticks and RK4 steps between them."""

    step: float  # s
    steps_per_tick: int
    ticks: int

    @property
    def tick(self) -> float:
        """Control period, s."""
        return self.step * self.steps_per_tick

    @property
    def duration(self) -> float:
        """Length of the flight, s."""
        return self.tick * self.ticks


class Observed(NamedTuple):
    """Limits and recorded channels as rows of the lane memory."""

    limit_row: Ints  # [limit]
    limit_outcome: Floats  # [limit]
    limit_low: Floats  # [limit]
    limit_high: Floats  # [limit]
    channel_row: Ints  # [channel]
    channel_factor: Floats  # [channel]


class UserCode(NamedTuple):
    """Addresses of custom code."""

    address: int  # of the law's machine code, 0 for none
    onboard: int  # 1 if the law needs the nominal vehicle
    channels: int  # address of the custom channels, 0 for none
    more: int  # 1 if the law may read more than the ten measured values, 2 also accelerations
    context: int = 0  # address of data that the law's machine code works on, 0 for none
    aerodynamics: int = 0  # addresses of custom functions of the vehicle, 0 for tables
    propulsion: int = 0
    dynamics: int = 0


class KernelPlan(NamedTuple):
    """Plan of flights, which the kernel only reads."""

    law: int
    vehicle: Vehicle
    trim_tables: Tables
    effectiveness: Effectiveness
    earth: Earth
    timing: Timing
    record_every: int  # control ticks between samples, 0 for no history
    observed: Observed
    unit_factors: Ints  # [term] index of the parameter that is 1, for the nominal vehicle
    initial_state: Floats  # [state] states of the vehicle, then custom states
    reference: Floats  # [tick, column]
    gains: Floats  # [tick, gain]
    settings: Floats  # [setting]
    # [knot, column] nominal air, see abhv_mc.kernel.plant.air_data; no knots: calm standard air
    profile: Floats
    parameters: Floats  # [flight, parameter] then settings of functions and initial custom states
    counted: Counted
    first_tick: int  # at which the flights start
    # [flight, row] memory at first_tick, see abhv_mc.flight.fly; no flights: the mission's start
    start: Floats
    user_code: UserCode = UserCode(0, 0, 0, 0)


class KernelResults(NamedTuple):
    """Results of flights, which the kernel fills."""

    metrics: Floats  # [flight, metric]
    outcome: NDArray[np.int64]  # [flight]
    end_tick: NDArray[np.int64]  # [flight]
    history: NDArray[np.float32]  # [flight, sample, channel]
    states: Floats  # [flight, sample, state]; no samples unless requested
    # [sample, channel] least and greatest value of all flights, from the sample to the tick before
    # the next; low above high if no flight was simulated then. No samples unless requested.
    low: Floats
    high: Floats
    saved: Floats  # [flight, row] memory before the last tick; no rows unless requested
    samples: Floats  # [quantile, flight, tick] values of quantile metrics; NaN if not counted
