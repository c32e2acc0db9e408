"""What the sensors make of the truth: bias, white noise and delay. The control laws see nothing else."""

from typing import NamedTuple

from abhv_mc.jit import lanes
from abhv_mc.plant.disturbance import any_lane, draw_normals, seed_stream
from abhv_mc.plant.state import DELAY, MAX_DELAY_TICKS, MEASURED, N_MEASURED, NOISE, parameter_row

# Ten rows each, in the order of the measured rows.
_BIAS = parameter_row("sensor.altitude_bias")
_SIGMA = parameter_row("sensor.altitude_noise")
_SEED = parameter_row("sensor.noise_seed")
_DELAY = parameter_row("sensor.delay")


class Faults(NamedTuple):
    """What the sensors of any of the flights abreast have."""

    noisy: bool
    late: bool


@lanes
def find_faults(Z, width):
    """From the parameters, which stay over a flight."""
    return Faults(any_lane(Z, width, _SIGMA, N_MEASURED, 0.0), any_lane(Z, width, _DELAY, 1, 0.0))


@lanes
def sense(Z, width, faults, dt, tick):
    """Measured rows from the truth in them: add bias and noise, then replace them by older ones."""
    for i in range(N_MEASURED):
        for lane in range(width):
            Z[MEASURED + i, lane] += Z[_BIAS + i, lane]
    if faults.noisy:
        if tick == 0:
            seed_stream(Z, width, NOISE, _SEED)
        for i in range(0, N_MEASURED, 2):
            for lane in range(width):
                n0, n1 = draw_normals(Z, lane, NOISE)
                Z[MEASURED + i, lane] += Z[_SIGMA + i, lane] * n0
                Z[MEASURED + i + 1, lane] += Z[_SIGMA + i + 1, lane] * n1
    if faults.late:
        delay(Z, width, dt, tick)


@lanes
def delay(Z, width, dt, tick):
    """Remember the measurement and hand out the one of ``sensor.delay`` ago; before the start there is the first."""
    slot = DELAY + (tick % (MAX_DELAY_TICKS + 1)) * N_MEASURED
    for i in range(N_MEASURED):
        for lane in range(width):
            Z[slot + i, lane] = Z[MEASURED + i, lane]
    for lane in range(width):
        age = min(int(Z[_DELAY, lane] / dt + 0.5), MAX_DELAY_TICKS, tick)
        old = DELAY + ((tick - age) % (MAX_DELAY_TICKS + 1)) * N_MEASURED
        for i in range(N_MEASURED):
            Z[MEASURED + i, lane] = Z[old + i, lane]
