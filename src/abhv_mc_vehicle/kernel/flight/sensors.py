"""Sensor models: lag, scale, bias, white noise, sampling and delay, in this order.

Control laws receive only the resulting measurement. Without sensor errors, all factors are 1 and
all offsets are 0, so the measured values equal the true values bit for bit.
"""

from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.laws.user import N_ROWS as N_LAW_ROWS
from abhv_mc_vehicle.kernel.numerics.lane_math import exp, wrap
from abhv_mc_vehicle.kernel.numerics.random_numbers import N_STREAM_ROWS
from abhv_mc_vehicle.kernel.plant.disturbance import any_lane, draw_normals, seed_stream
from abhv_mc_vehicle.kernel.plant.state import LAW, MEASURED, N_MEASURED, N_SEEN, parameter_row
from abhv_mc_vehicle.kernel.plant.vehicle import (
    ACCELERATIONS,
    ALL_SENSORS,
    MORE_SENSORS,
    SCALED_SENSORS,
)

MAX_DELAY_TICKS = 25

# These rows of the lane memory follow the rows of the control law.
NOISE = LAW + N_LAW_ROWS  # states of the random streams
DELAY = NOISE + N_STREAM_ROWS  # ring buffer of the last measurements
# states of the random streams for additional measurements and accelerations
MORE_NOISE = DELAY + (MAX_DELAY_TICKS + 1) * N_SEEN
ACCELERATION_NOISE = MORE_NOISE + N_STREAM_ROWS
TRUE = ACCELERATION_NOISE + N_STREAM_ROWS  # true values at the previous tick
LATE = TRUE + N_SEEN  # outputs of sensors with lag at the previous tick
HELD = LATE + N_SEEN  # values held until the next sample
END_ROW = HELD + N_SEEN

# Each kind of error has ten rows, in the order of the measured quantities.
_BIAS = parameter_row("sensor.altitude_bias")
_SIGMA = parameter_row("sensor.altitude_noise")
_SEED = parameter_row("sensor.noise_seed")
DELAY_TIME = parameter_row("sensor.delay")
# Each kind of error has twelve rows for the additional measurements.
_MORE_BIAS = parameter_row(f"sensor.{MORE_SENSORS[0]}_bias")
_MORE_SIGMA = parameter_row(f"sensor.{MORE_SENSORS[0]}_noise")
# Each kind of error has three rows for the accelerations.
_ACCELERATION_BIAS = parameter_row(f"sensor.{ACCELERATIONS[0]}_bias")
_ACCELERATION_SIGMA = parameter_row(f"sensor.{ACCELERATIONS[0]}_noise")
_ACCELERATION_SCALE = parameter_row(f"sensor.{ACCELERATIONS[0]}_scale")
_N_EARLIER = N_SEEN - len(ACCELERATIONS)  # number of sensors other than accelerometers
_SCALE = parameter_row("sensor.altitude_scale")
_N_SCALED = len(SCALED_SENSORS) - len(ACCELERATIONS)
# The rows for accelerations are not contiguous with the rows for other measurements.
_LAG = parameter_row("sensor.altitude_lag")
_INTERVAL = parameter_row("sensor.altitude_interval")
_LATER_LAG = parameter_row(f"sensor.{ACCELERATIONS[0]}_lag") - _N_EARLIER
_LATER_INTERVAL = parameter_row(f"sensor.{ACCELERATIONS[0]}_interval") - _N_EARLIER
_LATER_SCALE = _ACCELERATION_SCALE - _N_SCALED
_SCALED = tuple(ALL_SENSORS.index(name) for name in SCALED_SENSORS)
_TURNS = tuple(
    name in ("heading", "bank", "roll", "yaw", "longitude") for name in ALL_SENSORS
)  # angles that wrap at 180 deg
_LONGEST = 1e9  # longest sampling interval, ticks


class SensorErrors(NamedTuple):
    """Sensor errors that are active in any lane; inactive errors are not computed."""

    noisy: bool
    delayed: bool
    changed: bool  # lag, scale error or sampling, or bias or noise of additional measurements
    # whether accelerations have errors; without errors, only a delay changes them
    accelerations: bool


@lanes
def active_sensor_errors(Z, width):
    """Determine the active sensor errors from the flights' parameters."""
    accelerations = any_lane(Z, width, _ACCELERATION_BIAS, 4 * len(ACCELERATIONS), 0.0) or any_lane(
        Z, width, _ACCELERATION_SCALE, len(ACCELERATIONS), 1.0
    )
    return SensorErrors(
        any_lane(Z, width, _SIGMA, N_MEASURED, 0.0),
        any_lane(Z, width, DELAY_TIME, 1, 0.0),
        any_lane(Z, width, _MORE_BIAS, 2 * len(MORE_SENSORS) + 2 * _N_EARLIER, 0.0)
        or any_lane(Z, width, _SCALE, _N_SCALED, 1.0)
        or accelerations,
        accelerations,
    )


@lanes
def lag_and_scale(Z, width, active, dt, tick):
    """Apply lag and scale to the true values; exact if their rates are constant in a tick."""
    for i in range(N_SEEN if active.accelerations else _N_EARLIER):
        row = i + (_LAG if i < _N_EARLIER else _LATER_LAG)
        for lane in range(width):
            true = Z[MEASURED + i, lane]
            lag = Z[row, lane]
            ratio = lag / dt
            decayed = 1.0 - exp(-1.0 / ratio) if lag > 0.0 else 1.0
            lag_error = Z[TRUE + i, lane] - Z[LATE + i, lane]
            step = true - Z[TRUE + i, lane]
            if _TURNS[i]:
                lag_error = wrap(lag_error)
                step = wrap(step)
            late = Z[LATE + i, lane] + decayed * lag_error + (1.0 - decayed * ratio) * step
            if _TURNS[i]:
                late = wrap(late)
            late = late if lag > 0.0 and tick > 0 else true
            Z[TRUE + i, lane] = true
            Z[LATE + i, lane] = late
            Z[MEASURED + i, lane] = late
    for i in range(len(_SCALED) if active.accelerations else _N_SCALED):
        row = i + (_SCALE if i < _N_SCALED else _LATER_SCALE)
        for lane in range(width):
            Z[MEASURED + _SCALED[i], lane] *= Z[row, lane]


@lanes
def add_biases(Z, width):
    """Add biases to the measured values."""
    for i in range(N_MEASURED):
        for lane in range(width):
            Z[MEASURED + i, lane] += Z[_BIAS + i, lane]


@lanes
def sense(Z, width, active, dt, tick):
    """Add noise to the measurements, hold them between samples, and delay them."""
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
    """Add bias and noise (from a separate random stream) to the additional measurements."""
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
    """Add bias and noise (from a separate random stream) to the accelerations."""
    if tick == 0:
        seed_stream(Z, width, ACCELERATION_NOISE, _SEED, 2)
    for lane in range(width):
        n0, n1 = draw_normals(Z, lane, ACCELERATION_NOISE)
        n2, _ = draw_normals(Z, lane, ACCELERATION_NOISE)
        row = MEASURED + _N_EARLIER
        bias = _ACCELERATION_BIAS
        sigma = _ACCELERATION_SIGMA
        Z[row, lane] += Z[bias, lane] + Z[sigma, lane] * n0
        Z[row + 1, lane] += Z[bias + 1, lane] + Z[sigma + 1, lane] * n1
        Z[row + 2, lane] += Z[bias + 2, lane] + Z[sigma + 2, lane] * n2


@lanes
def hold(Z, width, active, dt, tick):
    """Hold sampled measurements until their next sample."""
    for i in range(N_SEEN if active.accelerations else _N_EARLIER):
        row = i + (_INTERVAL if i < _N_EARLIER else _LATER_INTERVAL)
        for lane in range(width):
            ticks = max(int(min(Z[row, lane] / dt, _LONGEST) + 0.5), 1)
            value = Z[MEASURED + i, lane] if tick % ticks == 0 else Z[HELD + i, lane]
            Z[HELD + i, lane] = value
            Z[MEASURED + i, lane] = value


@lanes
def delay(Z, width, dt, tick):
    """Replace the measurement with the one taken ``sensor.delay`` seconds earlier.

    Until the delay has elapsed, the first measurement is used.
    """
    slot = DELAY + (tick % (MAX_DELAY_TICKS + 1)) * N_SEEN
    for i in range(N_SEEN):
        for lane in range(width):
            Z[slot + i, lane] = Z[MEASURED + i, lane]
    for lane in range(width):
        age = min(int(Z[DELAY_TIME, lane] / dt + 0.5), MAX_DELAY_TICKS, tick)
        old = DELAY + ((tick - age) % (MAX_DELAY_TICKS + 1)) * N_SEEN
        for i in range(N_SEEN):
            Z[MEASURED + i, lane] = Z[old + i, lane]
