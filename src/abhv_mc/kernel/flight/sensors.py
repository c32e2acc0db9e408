"""Sensor models on the true motion: lag, scale, bias, white noise, sampling, delay, one after another in this order.

The control laws see nothing else. A flight without them gets exact ones and zeros, which leave its bits unchanged.
"""

from typing import NamedTuple

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.laws.user import N_ROWS as N_LAW_ROWS
from abhv_mc.kernel.numerics.angles import wrap
from abhv_mc.kernel.numerics.lane_math import exp
from abhv_mc.kernel.numerics.random_numbers import N_STREAM_ROWS
from abhv_mc.kernel.plant.disturbance import any_lane, draw_normals, seed_stream
from abhv_mc.kernel.plant.parameter_names import (
    ACCELERATIONS,
    ALL_SENSORS,
    MORE_SENSORS,
    SCALED_SENSORS,
)
from abhv_mc.kernel.plant.state import LAW, MEASURED, N_MEASURED, N_SEEN, parameter_row

MAX_DELAY_TICKS = 25

# Rows of the lane memory, behind the control law's.
NOISE = LAW + N_LAW_ROWS  # random numbers
DELAY = NOISE + N_STREAM_ROWS  # the last measurements, a ring buffer
MORE_NOISE = (
    DELAY + (MAX_DELAY_TICKS + 1) * N_SEEN
)  # random numbers of what user laws may measure besides
ACCELERATION_NOISE = MORE_NOISE + N_STREAM_ROWS  # random numbers of the accelerations
TRUE = ACCELERATION_NOISE + N_STREAM_ROWS  # at the last tick
LATE = TRUE + N_SEEN  # what sensors with a lag gave then
HELD = LATE + N_SEEN  # what is held until the next sample
END_ROW = HELD + N_SEEN

# Ten rows each, in the order of the measured rows.
_BIAS = parameter_row("sensor.altitude_bias")
_SIGMA = parameter_row("sensor.altitude_noise")
_SEED = parameter_row("sensor.noise_seed")
_DELAY = parameter_row("sensor.delay")
# Of the other twelve.
_MORE_BIAS = parameter_row(f"sensor.{MORE_SENSORS[0]}_bias")
_MORE_SIGMA = parameter_row(f"sensor.{MORE_SENSORS[0]}_noise")
# Of the accelerations, three rows each: bias, noise, lag, interval, scale.
_ACCELERATION_BIAS = parameter_row(f"sensor.{ACCELERATIONS[0]}_bias")
_ACCELERATION_SIGMA = parameter_row(f"sensor.{ACCELERATIONS[0]}_noise")
_ACCELERATION_SCALE = parameter_row(f"sensor.{ACCELERATIONS[0]}_scale")
_N_EARLIER = N_SEEN - len(ACCELERATIONS)  # lags and intervals of the others stand together
_SCALE = parameter_row("sensor.altitude_scale")
_N_SCALED = len(SCALED_SENSORS) - len(ACCELERATIONS)
# Of all; the accelerations' rows are other than those that follow.
_LAG, _INTERVAL = parameter_row("sensor.altitude_lag"), parameter_row("sensor.altitude_interval")
_LATER_LAG = parameter_row(f"sensor.{ACCELERATIONS[0]}_lag") - _N_EARLIER
_LATER_INTERVAL = parameter_row(f"sensor.{ACCELERATIONS[0]}_interval") - _N_EARLIER
_LATER_SCALE = _ACCELERATION_SCALE - _N_SCALED
_SCALED = tuple(ALL_SENSORS.index(name) for name in SCALED_SENSORS)
_TURNS = tuple(
    name in ("heading", "bank", "roll", "yaw", "longitude") for name in ALL_SENSORS
)  # by way of 180 deg
_LONGEST = 1e9  # ticks


class SensorErrors(NamedTuple):
    """Sensor errors active in any lane; the others are never computed."""

    noisy: bool
    delayed: bool
    changed: bool  # by lag, scale or interval, or what user laws may ask for by bias or noise
    accelerations: bool  # have errors; without them only a delay concerns them


@lanes
def active_sensor_errors(Z, width):
    """From the parameters, which are constant over a flight."""
    accelerations = any_lane(Z, width, _ACCELERATION_BIAS, 4 * len(ACCELERATIONS), 0.0) or any_lane(
        Z, width, _ACCELERATION_SCALE, len(ACCELERATIONS), 1.0
    )
    return SensorErrors(
        any_lane(Z, width, _SIGMA, N_MEASURED, 0.0),
        any_lane(Z, width, _DELAY, 1, 0.0),
        any_lane(Z, width, _MORE_BIAS, 2 * len(MORE_SENSORS) + 2 * _N_EARLIER, 0.0)
        or any_lane(Z, width, _SCALE, _N_SCALED, 1.0)
        or accelerations,
        accelerations,
    )


@lanes
def lag_and_scale(Z, width, active, dt, tick):
    """Lag and scale of the true values in the measured rows: exact for what changes at a constant rate in a tick."""
    for i in range(N_SEEN if active.accelerations else _N_EARLIER):
        row = i + (_LAG if i < _N_EARLIER else _LATER_LAG)
        for lane in range(width):
            true, lag = Z[MEASURED + i, lane], Z[row, lane]
            ratio = lag / dt
            gone = 1.0 - exp(-1.0 / ratio) if lag > 0.0 else 1.0
            behind, step = Z[TRUE + i, lane] - Z[LATE + i, lane], true - Z[TRUE + i, lane]
            if _TURNS[i]:
                behind, step = wrap(behind), wrap(step)
            late = Z[LATE + i, lane] + gone * behind + (1.0 - gone * ratio) * step
            if _TURNS[i]:
                late = wrap(late)
            late = late if lag > 0.0 and tick > 0 else true
            Z[TRUE + i, lane], Z[LATE + i, lane], Z[MEASURED + i, lane] = true, late, late
    for i in range(len(_SCALED) if active.accelerations else _N_SCALED):
        row = i + (_SCALE if i < _N_SCALED else _LATER_SCALE)
        for lane in range(width):
            Z[MEASURED + _SCALED[i], lane] *= Z[row, lane]


@lanes
def add_biases(Z, width):
    """To the true values in the measured rows."""
    for i in range(N_MEASURED):
        for lane in range(width):
            Z[MEASURED + i, lane] += Z[_BIAS + i, lane]


@lanes
def sense(Z, width, active, dt, tick):
    """Add noise to the values in the measured rows, hold them, then replace them by delayed ones."""
    if active.noisy:
        if tick == 0:
            seed_stream(Z, width, NOISE, _SEED, 0)
        for i in range(0, N_MEASURED, 2):
            for lane in range(width):
                n0, n1 = draw_normals(Z, lane, NOISE)
                Z[MEASURED + i, lane] += Z[_SIGMA + i, lane] * n0
                Z[MEASURED + i + 1, lane] += Z[_SIGMA + i + 1, lane] * n1
    if active.changed:
        disturb_more(Z, width, tick)
        if active.accelerations:
            disturb_accelerations(Z, width, tick)
        hold(Z, width, active, dt, tick)
    if active.delayed:
        delay(Z, width, dt, tick)


@lanes
def disturb_more(Z, width, tick):
    """Bias and noise of the twelve besides, from random numbers of their own."""
    if tick == 0:
        seed_stream(Z, width, MORE_NOISE, _SEED, 1)
    for i in range(0, len(MORE_SENSORS), 2):
        for lane in range(width):
            n0, n1 = draw_normals(Z, lane, MORE_NOISE)
            row = MEASURED + N_MEASURED + i
            Z[row, lane] += Z[_MORE_BIAS + i, lane] + Z[_MORE_SIGMA + i, lane] * n0
            Z[row + 1, lane] += Z[_MORE_BIAS + i + 1, lane] + Z[_MORE_SIGMA + i + 1, lane] * n1


@lanes
def disturb_accelerations(Z, width, tick):
    """Bias and noise of the accelerations, from random numbers of their own."""
    if tick == 0:
        seed_stream(Z, width, ACCELERATION_NOISE, _SEED, 2)
    for lane in range(width):
        n0, n1 = draw_normals(Z, lane, ACCELERATION_NOISE)
        n2, _ = draw_normals(Z, lane, ACCELERATION_NOISE)
        row = MEASURED + _N_EARLIER
        bias, sigma = _ACCELERATION_BIAS, _ACCELERATION_SIGMA
        Z[row, lane] += Z[bias, lane] + Z[sigma, lane] * n0
        Z[row + 1, lane] += Z[bias + 1, lane] + Z[sigma + 1, lane] * n1
        Z[row + 2, lane] += Z[bias + 2, lane] + Z[sigma + 2, lane] * n2


@lanes
def hold(Z, width, active, dt, tick):
    """What is sampled at intervals stays what it was between them."""
    for i in range(N_SEEN if active.accelerations else _N_EARLIER):
        row = i + (_INTERVAL if i < _N_EARLIER else _LATER_INTERVAL)
        for lane in range(width):
            ticks = max(int(min(Z[row, lane] / dt, _LONGEST) + 0.5), 1)
            held = Z[MEASURED + i, lane] if tick % ticks == 0 else Z[HELD + i, lane]
            Z[HELD + i, lane], Z[MEASURED + i, lane] = held, held


@lanes
def delay(Z, width, dt, tick):
    """Store the measurement and return the one ``sensor.delay`` old; at the start, the first one."""
    slot = DELAY + (tick % (MAX_DELAY_TICKS + 1)) * N_SEEN
    for i in range(N_SEEN):
        for lane in range(width):
            Z[slot + i, lane] = Z[MEASURED + i, lane]
    for lane in range(width):
        age = min(int(Z[_DELAY, lane] / dt + 0.5), MAX_DELAY_TICKS, tick)
        old = DELAY + ((tick - age) % (MAX_DELAY_TICKS + 1)) * N_SEEN
        for i in range(N_SEEN):
            Z[MEASURED + i, lane] = Z[old + i, lane]
