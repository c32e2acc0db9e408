"""Custom dynamics: states of a custom function, integrated with the vehicle's motion.

The function is called once per stage, after all other forces have been computed, and receives the
acceleration that they cause. The force and moment that it returns are added to the derivatives,
which are linear in both.
"""

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.jit_pointer import call_address
from abhv_mc_vehicle.kernel.numerics.lane_math import reciprocals
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.rigid_body import add_force, add_moment
from abhv_mc_vehicle.kernel.plant.state import N_PARAMETERS, N_STATES, XS
from abhv_mc_vehicle.kernel.plant.thrust import DISPERSED

_N_MOTION = s.MASS - s.U + 1  # number of rows of velocity, attitude, rates and mass


@lanes
def start_states(Z, width, states, settings, initial_state):
    """Set the custom states to their initial values plus their initial dispersions.

    The rows of the dispersions follow the rows of the settings.
    """
    for i in range(states):
        for lane in range(width):
            start = initial_state[N_STATES + i] + Z[s.SETTING + settings + i, lane]
            Z[s.CUSTOM_STATE + i, lane], Z[s.CUSTOM_STAGE + i, lane] = start, start


@lanes
def load_settings(Z, width, parameters, flights, n):
    """Load each flight's settings and initial dispersions from columns after the parameters."""
    for lane in range(width):
        flight = flights[min(lane, n - 1)]
        for i in range(parameters.shape[1] - N_PARAMETERS):
            Z[s.SETTING + i, lane] = parameters[flight, N_PARAMETERS + i]


@lanes
def keep_motion(Z, width):
    """Copy the motion at the stage, before the equations of motion overwrite it."""
    for i in range(_N_MOTION):
        for lane in range(width):
            Z[s.MOTION + i, lane] = Z[XS + s.U + i, lane]


@lanes
def run_dynamics(Z, width, vehicle, user_code, stage):
    """Call the custom function; add its force, moment and rates to the integrator's sums."""
    for i in range(3):
        for lane in range(width):
            Z[s.MOTION_ACCELERATION + i, lane] = Z[s.SPECIFIC_X + i, lane] + Z[s.GRAVITY + i, lane]
    settings = vehicle.foreign.settings
    call_address(user_code.dynamics, 0, Z, settings, settings, settings, DISPERSED, 0.0)
    for lane in range(width):
        per_mass, _ = reciprocals(Z[s.MOTION + _N_MOTION - 1, lane], 1.0)
        add_force(
            Z,
            lane,
            stage,
            per_mass,
            Z[s.CUSTOM_FORCE, lane],
            Z[s.CUSTOM_FORCE + 1, lane],
            Z[s.CUSTOM_FORCE + 2, lane],
        )
        add_moment(
            Z,
            lane,
            stage,
            Z[s.CUSTOM_MOMENT, lane],
            Z[s.CUSTOM_MOMENT + 1, lane],
            Z[s.CUSTOM_MOMENT + 2, lane],
        )
    for i in range(vehicle.foreign.states):
        for lane in range(width):
            rate = Z[s.CUSTOM_RATE + i, lane]
            Z[s.CUSTOM_SUM + i, lane] += stage.weight * rate
            Z[s.CUSTOM_STAGE + i, lane] = Z[s.CUSTOM_STATE + i, lane] + stage.ahead * rate


@lanes
def finish_states(Z, width, states, step, alive):
    """Compute custom states after the step; ended flights (``alive`` 0) keep their states."""
    sixth = step / 6.0
    for i in range(states):
        for lane in range(width):
            before = Z[s.CUSTOM_STATE + i, lane]
            after = before + sixth * Z[s.CUSTOM_SUM + i, lane]
            value = after if alive[lane] > 0.0 else before
            Z[s.CUSTOM_SUM + i, lane] = 0.0
            Z[s.CUSTOM_STATE + i, lane], Z[s.CUSTOM_STAGE + i, lane] = value, value


@lanes
def add_sensed(Z, width, measured):
    """Add the custom function's sensor effects to the first ``measured`` measurements."""
    for i in range(measured):
        for lane in range(width):
            Z[s.MEASURED + i, lane] += Z[s.SENSED + i, lane]
