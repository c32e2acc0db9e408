"""What the compiled flight takes and fills: the plan and the results, named tuples of numbers and arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints
from abhv_mc.kernel.flight.counting import Counted
from abhv_mc.kernel.plant.slopes import Effectiveness
from abhv_mc.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc.kernel.world.earth import Earth

LANES = 32  # flights of a group: batched lanes

# Which law flies: the integers that the kernel compares.
TLC, LQR, RECORDED, PYTHON = range(4)


class Timing(NamedTuple):
    """The clock of a flight. Control ticks are 0..ticks; a tick holds ``steps_per_tick`` RK4 steps."""

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
    """The tables of limits and channels as numbers; rows of the lane memory."""

    limit_row: Ints  # [limit]
    limit_outcome: Floats  # [limit]
    limit_low: Floats  # [limit]
    limit_high: Floats  # [limit]
    channel_row: Ints  # [channel]
    channel_factor: Floats  # [channel]


class UserCode(NamedTuple):
    """A law of the user's own, as the kernel calls it."""

    address: int  # of its machine code, 0 for none
    onboard: int  # 1 where it wants the nominal vehicle
    channels: int  # address of the user's own channels, 0 for none
    more: int  # 1 where it may ask for more than the ten measured values, 2 also for accelerations
    context: int = 0  # address of what the law's machine code works on, 0 for none
    aerodynamics: int = 0  # addresses of the vehicle's own functions, 0 for tables
    propulsion: int = 0
    dynamics: int = 0


class KernelPlan(NamedTuple):
    """What is flown, only read."""

    law: int
    vehicle: Vehicle
    trim_tables: Tables
    effectiveness: Effectiveness
    earth: Earth
    timing: Timing
    record_every: int  # control ticks between samples, 0 for no history
    observed: Observed
    unit_factors: Ints  # [term] the parameter that is 1, for the nominal vehicle
    initial_state: Floats  # [state] custom ones behind the vehicle's
    reference: Floats  # [tick, column]
    gains: Floats  # [tick, gain]
    settings: Floats  # [setting]
    profile: Floats  # [knot, column] nominal air, see abhv_mc.kernel.plant.air_data; no knots: still standard air
    parameters: Floats  # [flight, parameter] settings of functions and starts of states behind them
    counted: Counted
    first_tick: int  # at which the flights start
    start: Floats  # [flight, row] their memories then, see abhv_mc.flight.fly; no flights: the mission's start
    user_code: UserCode = UserCode(0, 0, 0, 0)


class KernelResults(NamedTuple):
    """What the compiled flight fills."""

    metrics: Floats  # [flight, metric]
    outcome: NDArray[np.int64]  # [flight]
    end_tick: NDArray[np.int64]  # [flight]
    history: NDArray[np.float32]  # [flight, sample, channel]
    states: Floats  # [flight, sample, state]; no samples where not asked for
    low: Floats  # [sample, channel] least and greatest values of all flights, from the sample to the tick before the
    high: (
        Floats  # next, the first above the second where nobody flew; no samples where not asked for
    )
    kept: Floats  # [flight, row] memories before the last tick; no rows where not asked for
    samples: Floats  # [quantile, flight, tick] of metrics that are quantiles, in their order; not-a-number where none
