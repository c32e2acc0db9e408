"""Sensor models: bias, white noise and delay on the true motion. The control laws see nothing else."""

from typing import NamedTuple

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.laws.user import N_ROWS as N_LAW_ROWS
from abhv_mc.kernel.numerics.random_numbers import N_STREAM_ROWS
from abhv_mc.kernel.plant.disturbance import any_lane, draw_normals, seed_stream
from abhv_mc.kernel.plant.state import LAW, MEASURED, N_MEASURED, N_SEEN, parameter_row

MAX_DELAY_TICKS = 25

# Rows of the lane memory, behind the control law's.
NOISE = LAW + N_LAW_ROWS  # random numbers
DELAY = NOISE + N_STREAM_ROWS  # the last measurements, a ring buffer
END_ROW = DELAY + (MAX_DELAY_TICKS + 1) * N_SEEN

# Ten rows each, in the order of the measured rows.
_BIAS = parameter_row("sensor.altitude_bias")
_SIGMA = parameter_row("sensor.altitude_noise")
_SEED = parameter_row("sensor.noise_seed")
_DELAY = parameter_row("sensor.delay")


class SensorErrors(NamedTuple):
    """Sensor errors active in any lane; the others are never computed."""

    noisy: bool
    delayed: bool


@lanes
def active_sensor_errors(Z, width):
    """From the parameters, which are constant over a flight."""
    return SensorErrors(any_lane(Z, width, _SIGMA, N_MEASURED, 0.0), any_lane(Z, width, _DELAY, 1, 0.0))


@lanes
def add_biases(Z, width):
    """To the true values in the measured rows."""
    for i in range(N_MEASURED):
        for lane in range(width):
            Z[MEASURED + i, lane] += Z[_BIAS + i, lane]


@lanes
def sense(Z, width, active, dt, tick):
    """Add noise to the values in the measured rows, then replace them by delayed ones."""
    if active.noisy:
        if tick == 0:
            seed_stream(Z, width, NOISE, _SEED)
        for i in range(0, N_MEASURED, 2):
            for lane in range(width):
                n0, n1 = draw_normals(Z, lane, NOISE)
                Z[MEASURED + i, lane] += Z[_SIGMA + i, lane] * n0
                Z[MEASURED + i + 1, lane] += Z[_SIGMA + i + 1, lane] * n1
    if active.delayed:
        delay(Z, width, dt, tick)


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
