"""Once a tick, at the state of the tick: metrics, the end of a flight, and the recorded channels."""

import math

from abhv_mc.control import columns as ref
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.signals import METRIC_INDEX
from abhv_mc.jit import lanes
from abhv_mc.numerics.angles import larger, smaller, wrap
from abhv_mc.plant import state as s
from abhv_mc.plant.state import X, parameter_row, variable_row

_ALPHA = variable_row("angle_of_attack")
_BETA = variable_row("sideslip")
_LIMIT = parameter_row("actuator.deflection_limit")
_DEG = 180.0 / math.pi
_G0 = 9.80665  # m/s2

_ALTITUDE_LIMIT = float(Outcome.ALTITUDE_LIMIT)
_ANGLE_OF_ATTACK_LIMIT = float(Outcome.ANGLE_OF_ATTACK_LIMIT)
_SIDESLIP_LIMIT = float(Outcome.SIDESLIP_LIMIT)
_NOT_FINITE = float(Outcome.NOT_FINITE)

N_METRICS = len(METRIC_INDEX)
M_ALTITUDE_RMS, M_ALTITUDE_MAX = METRIC_INDEX["altitude_error_rms_m"], METRIC_INDEX["altitude_error_max_m"]
M_SPEED_RMS, M_SPEED_MAX = METRIC_INDEX["speed_error_rms_mps"], METRIC_INDEX["speed_error_max_mps"]
M_HEADING_RMS, M_HEADING_MAX = METRIC_INDEX["heading_error_rms_deg"], METRIC_INDEX["heading_error_max_deg"]
M_CROSS_RMS, M_CROSS_MAX = METRIC_INDEX["cross_track_error_rms_m"], METRIC_INDEX["cross_track_error_max_m"]
M_CROSS_FINAL = METRIC_INDEX["cross_track_error_final_m"]
M_ALPHA_RMS = METRIC_INDEX["angle_of_attack_error_rms_deg"]
M_ALPHA_ERR_MAX = METRIC_INDEX["angle_of_attack_error_max_deg"]
M_ALPHA_SETTLED = METRIC_INDEX["angle_of_attack_error_settled_max_deg"]
M_BANK_RMS, M_BANK_MAX = METRIC_INDEX["bank_error_rms_deg"], METRIC_INDEX["bank_error_max_deg"]
M_BANK_SETTLED = METRIC_INDEX["bank_error_settled_max_deg"]
M_BETA_RMS, M_BETA_MAX = METRIC_INDEX["sideslip_rms_deg"], METRIC_INDEX["sideslip_max_deg"]
M_ALPHA_MIN, M_ALPHA_MAX = METRIC_INDEX["angle_of_attack_min_deg"], METRIC_INDEX["angle_of_attack_max_deg"]
M_AILERON, M_ELEVATOR, M_RUDDER = (METRIC_INDEX[f"{n}_rms_deg"] for n in ("aileron", "elevator", "rudder"))
M_ETA_MIN, M_ETA_MAX = METRIC_INDEX["equivalence_ratio_min"], METRIC_INDEX["equivalence_ratio_max"]
M_FUEL, M_Q_BAR = METRIC_INDEX["fuel_used_kg"], METRIC_INDEX["dynamic_pressure_max_pa"]
M_LOAD, M_SATURATION = METRIC_INDEX["load_factor_max_g"], METRIC_INDEX["surface_saturation_s"]
M_OUTSIDE = METRIC_INDEX["outside_tables_s"]

# Rows behind the metrics in the lane memory of the observer.
FIRST_SURFACE = N_METRICS  # deflections at the start: aileron, rudder, elevator
LAST_SURFACE = FIRST_SURFACE + 3  # deflections at the last tick
FIRST_MASS = LAST_SURFACE + 3
ALIVE = FIRST_MASS + 1
OUTCOME = ALIVE + 1
END = OUTCOME + 1  # tick of the last sample that counted
SAMPLES = END + 1
N_ROWS = SAMPLES + 1


@lanes
def start_observing(Z, O, width):
    """Clear the metrics and remember the start."""
    for lane in range(width):
        for i in range(N_ROWS):
            O[i, lane] = 0.0
        O[M_ALPHA_MIN, lane] = math.inf
        O[M_ALPHA_MAX, lane] = -math.inf
        O[M_ETA_MIN, lane] = math.inf
        O[M_ETA_MAX, lane] = -math.inf
        for i in range(3):
            O[FIRST_SURFACE + i, lane] = Z[X + s.AILERON + i, lane]
            O[LAST_SURFACE + i, lane] = Z[X + s.AILERON + i, lane]
        O[FIRST_MASS, lane] = Z[X + s.MASS, lane]
        O[ALIVE, lane] = 1.0


@lanes
def judge(Z, O, width, limits, tick_number):
    """End the flights that left their limits or are no longer finite; metrics keep what was counted."""
    for lane in range(width):
        alive = O[ALIVE, lane]
        total = 0.0
        for i in range(s.N_STATES):
            total += Z[X + i, lane]
        finite = total - total == 0.0
        altitude = Z[X + s.ALTITUDE, lane]
        alpha = Z[_ALPHA, lane]
        beta = Z[_BETA, lane]
        verdict = 0.0
        verdict = _SIDESLIP_LIMIT if abs(beta) > limits.sideslip_max else verdict
        outside_alpha = alpha < limits.angle_of_attack_min or alpha > limits.angle_of_attack_max
        verdict = _ANGLE_OF_ATTACK_LIMIT if outside_alpha else verdict
        outside_altitude = altitude < limits.altitude_min or altitude > limits.altitude_max
        verdict = _ALTITUDE_LIMIT if outside_altitude else verdict
        verdict = verdict if finite else _NOT_FINITE
        ends = alive > 0.0 and verdict > 0.0
        O[OUTCOME, lane] = verdict if ends else O[OUTCOME, lane]
        # A last finite sample still counts; a broken one does not.
        counts = alive if finite else 0.0
        O[END, lane] = float(tick_number) if alive > 0.0 else O[END, lane]
        O[SAMPLES, lane] += counts
        O[ALIVE, lane] = 0.0 if ends else alive
        Z[s.COUNTED, lane] = counts


@lanes
def measure(Z, O, width, vehicle, reference, tick, dt):
    """Add the tick to the metrics of the flights that count."""
    altitude_ref = reference[tick, ref.ALTITUDE]
    speed_ref = reference[tick, ref.SPEED]
    heading_ref = reference[tick, ref.HEADING]
    north_ref = reference[tick, ref.NORTH]
    east_ref = reference[tick, ref.EAST]
    left_n = reference[0, ref.TRACK_NORTH]
    left_e = reference[0, ref.TRACK_EAST]
    settled = reference[tick, ref.SETTLED]
    for lane in range(width):
        counts = Z[s.COUNTED, lane] > 0.0
        altitude = Z[X + s.ALTITUDE, lane] - altitude_ref
        speed = Z[s.SPEED, lane] - speed_ref
        heading = wrap(Z[s.CHI, lane] - heading_ref) * _DEG
        cross = (Z[s.NORTH, lane] - north_ref) * left_n + (Z[s.EAST, lane] - east_ref) * left_e
        alpha = Z[_ALPHA, lane] * _DEG
        alpha_error = alpha - Z[s.ALPHA_CMD, lane] * _DEG
        bank_error = wrap(Z[s.BANK, lane] - Z[s.BANK_CMD, lane]) * _DEG
        beta = Z[_BETA, lane] * _DEG
        eta = Z[X + s.ETA, lane]

        add_error(O, lane, counts, M_ALTITUDE_RMS, M_ALTITUDE_MAX, altitude)
        add_error(O, lane, counts, M_SPEED_RMS, M_SPEED_MAX, speed)
        add_error(O, lane, counts, M_HEADING_RMS, M_HEADING_MAX, heading)
        add_error(O, lane, counts, M_CROSS_RMS, M_CROSS_MAX, cross)
        add_error(O, lane, counts, M_ALPHA_RMS, M_ALPHA_ERR_MAX, alpha_error)
        add_error(O, lane, counts, M_BANK_RMS, M_BANK_MAX, bank_error)
        add_error(O, lane, counts, M_BETA_RMS, M_BETA_MAX, beta)
        O[M_CROSS_FINAL, lane] = cross if counts else O[M_CROSS_FINAL, lane]
        settled_counts = counts and settled > 0.0
        O[M_ALPHA_SETTLED, lane] = (
            larger(O[M_ALPHA_SETTLED, lane], abs(alpha_error)) if settled_counts else O[M_ALPHA_SETTLED, lane]
        )
        O[M_BANK_SETTLED, lane] = (
            larger(O[M_BANK_SETTLED, lane], abs(bank_error)) if settled_counts else O[M_BANK_SETTLED, lane]
        )
        O[M_ALPHA_MIN, lane] = smaller(O[M_ALPHA_MIN, lane], alpha) if counts else O[M_ALPHA_MIN, lane]
        O[M_ALPHA_MAX, lane] = larger(O[M_ALPHA_MAX, lane], alpha) if counts else O[M_ALPHA_MAX, lane]
        O[M_ETA_MIN, lane] = smaller(O[M_ETA_MIN, lane], eta) if counts else O[M_ETA_MIN, lane]
        O[M_ETA_MAX, lane] = larger(O[M_ETA_MAX, lane], eta) if counts else O[M_ETA_MAX, lane]
        O[M_FUEL, lane] = O[FIRST_MASS, lane] - Z[X + s.MASS, lane] if counts else O[M_FUEL, lane]
        O[M_Q_BAR, lane] = larger(O[M_Q_BAR, lane], Z[s.Q_BAR, lane]) if counts else O[M_Q_BAR, lane]
        x, y, z = Z[s.SPECIFIC_X, lane], Z[s.SPECIFIC_Y, lane], Z[s.SPECIFIC_Z, lane]
        load = math.sqrt(x * x + y * y + z * z) / _G0
        O[M_LOAD, lane] = larger(O[M_LOAD, lane], load) if counts else O[M_LOAD, lane]
        O[M_OUTSIDE, lane] += dt if counts and Z[s.OUTSIDE, lane] > 0.0 else 0.0

        add_surface(Z, O, lane, counts, 0, M_AILERON)
        add_surface(Z, O, lane, counts, 1, M_RUDDER)
        add_surface(Z, O, lane, counts, 2, M_ELEVATOR)
        # A command at the stop counts too: the surface creeps towards it and may never arrive.
        limit = vehicle.constants.surface_limit * Z[_LIMIT, lane]
        largest = larger(abs(Z[X + s.AILERON, lane]), abs(Z[X + s.RUDDER, lane]))
        largest = larger(largest, abs(Z[X + s.ELEVATOR, lane]))
        command = larger(abs(Z[s.CMD_AILERON, lane]), abs(Z[s.CMD_RUDDER, lane]))
        command = larger(command, abs(Z[s.CMD_ELEVATOR, lane]))
        saturated = largest >= limit or command >= vehicle.constants.surface_limit
        O[M_SATURATION, lane] += dt if counts and saturated and limit > 0.0 else 0.0


@lanes
def add_error(O, lane, counts, rms, largest, error):
    """One sample of an error into its sum of squares and its largest absolute value."""
    O[rms, lane] += error * error if counts else 0.0
    O[largest, lane] = larger(O[largest, lane], abs(error)) if counts else O[largest, lane]


@lanes
def add_surface(Z, O, lane, counts, i, first_metric):
    """One sample of a surface: rms about the initial trim, largest, travel (three metrics in a row)."""
    deflection = Z[X + s.AILERON + i, lane]
    from_trim = (deflection - O[FIRST_SURFACE + i, lane]) * _DEG
    moved = abs(deflection - O[LAST_SURFACE + i, lane]) * _DEG
    O[first_metric, lane] += from_trim * from_trim if counts else 0.0
    O[first_metric + 1, lane] = (
        larger(O[first_metric + 1, lane], abs(deflection) * _DEG) if counts else O[first_metric + 1, lane]
    )
    O[first_metric + 2, lane] += moved if counts else 0.0
    O[LAST_SURFACE + i, lane] = deflection


@lanes
def finish_metrics(O, lane, out):
    """The metrics of one lane, ``out`` [metric], with means under the roots."""
    inverse = 1.0 / larger(1.0, O[SAMPLES, lane])
    for i in range(N_METRICS):
        out[i] = O[i, lane]
    for i in (
        M_ALTITUDE_RMS,
        M_SPEED_RMS,
        M_HEADING_RMS,
        M_CROSS_RMS,
        M_ALPHA_RMS,
        M_BANK_RMS,
        M_BETA_RMS,
        M_AILERON,
        M_ELEVATOR,
        M_RUDDER,
    ):
        out[i] = math.sqrt(O[i, lane] * inverse)


@lanes
def record(Z, history, flights, n, sample):
    """The channels at this tick, in the order of CHANNELS, of the lanes' ``flights`` that still fly."""
    for lane in range(n):
        if Z[s.COUNTED, lane] > 0.0:
            row = history[flights[lane], sample]
            row[0] = Z[X + s.ALTITUDE, lane]
            row[1] = Z[s.SPEED, lane]
            row[2] = Z[s.GAMMA, lane] * _DEG
            chi = Z[s.CHI, lane]
            row[3] = (chi if chi >= 0.0 else chi + 2.0 * math.pi) * _DEG
            row[4] = Z[_ALPHA, lane] * _DEG
            row[5] = Z[_BETA, lane] * _DEG
            row[6] = Z[s.BANK, lane] * _DEG
            row[7] = Z[X + s.ROLL_RATE, lane] * _DEG
            row[8] = Z[X + s.PITCH_RATE, lane] * _DEG
            row[9] = Z[X + s.YAW_RATE, lane] * _DEG
            row[10] = Z[X + s.AILERON, lane] * _DEG
            row[11] = Z[X + s.RUDDER, lane] * _DEG
            row[12] = Z[X + s.ELEVATOR, lane] * _DEG
            row[13] = Z[X + s.ETA, lane]
            row[14] = Z[s.NORTH, lane]
            row[15] = Z[s.EAST, lane]
            row[16] = Z[X + s.LATITUDE, lane] * _DEG
            row[17] = Z[X + s.LONGITUDE, lane] * _DEG
            row[18] = Z[X + s.MASS, lane]
            row[19] = Z[s.Q_BAR, lane]
            row[20] = Z[s.GAMMA_CMD, lane] * _DEG
            row[21] = Z[s.ALPHA_CMD, lane] * _DEG
            row[22] = Z[s.BANK_CMD, lane] * _DEG
            row[23] = Z[s.CMD_AILERON, lane] * _DEG
            row[24] = Z[s.CMD_RUDDER, lane] * _DEG
            row[25] = Z[s.CMD_ELEVATOR, lane] * _DEG
            row[26] = Z[s.CMD_ETA, lane]


@lanes
def record_states(Z, states, flights, n, sample):
    """The whole state at this tick, in the order of STATES and in double precision, for the flights that still fly."""
    for lane in range(n):
        if Z[s.COUNTED, lane] > 0.0:
            for i in range(s.N_STATES):
                states[flights[lane], sample, i] = Z[X + i, lane]
