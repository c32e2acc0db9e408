"""Custom functions of a vehicle in the plant, and its thrust with misalignment.

Thrust is from tables or a custom engine function.

The coefficient function is called once for all lanes. Custom dynamics are states of a custom
function, integrated with the vehicle's motion.

Dispersions have the same effect as with tables. The factor on a coefficient's dependence on a
variable multiplies ``f(x) - f(x with the variable 0)``; for an axis, the second term omits the
axis's contribution to all deflections. Each dispersed variable requires an additional evaluation.

The function is called once per stage, after all other forces have been computed, and receives the
acceleration that they cause. The force and moment that it returns are added to the derivatives,
which are linear in both.
"""

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.jit_pointer import call_address
from abhv_mc_vehicle.kernel.numerics.lane_math import reciprocals, sincos
from abhv_mc_vehicle.kernel.numerics.quaternion import vector_at
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.aerodynamics import N_INPUTS
from abhv_mc_vehicle.kernel.plant.disturbance import any_lane
from abhv_mc_vehicle.kernel.plant.effectors import place_effectors, set_effectors
from abhv_mc_vehicle.kernel.plant.rigid_body import add_derivative, add_force, add_moment
from abhv_mc_vehicle.kernel.plant.state import (
    N_COEFFICIENTS,
    N_PARAMETERS,
    N_STATES,
    XS,
    parameter_row,
    parameter_rows,
)

# An engine function receives the settings of the vehicle file or of each flight (``SETTING``).
NOMINAL, DISPERSED = range(2)
_INCLINATION, _AZIMUTH = parameter_rows("thrust.inclination", 2)


@lanes
def thrust(Z, lane, constants, eta, rho, airspeed, q_bar):
    """Return the thrust from tables, N.

    The thrust is proportional to captured air flow, equivalence ratio and specific impulse, or is
    the product of dynamic pressure and a thrust area.
    """
    captured = constants.capture_thrust * eta * rho * airspeed * Z[s.CAPTURE, lane] * Z[s.ISP, lane]
    return captured + q_bar * Z[s.THRUST_AREA, lane]


@lanes
def nominal_thrust(Z, width, vehicle, user_code, density_row, speed_row):
    """Store the nominal engine's thrust, moment and fuel flow, starting at row ``F_THRUST``."""
    call_propulsion(Z, width, vehicle, user_code, density_row, speed_row, NOMINAL)


@lanes
def call_propulsion(Z, width, vehicle, user_code, density_row, speed_row, settings):
    """Compute thrust, moment and fuel flow with the engine function.

    The results are stored in the rows starting at ``F_THRUST``. The moment is about the aerodynamic
    moment reference.
    """
    for lane in range(width):
        Z[s.F_DENSITY, lane], Z[s.F_AIRSPEED, lane] = Z[density_row, lane], Z[speed_row, lane]
    file_settings = vehicle.foreign.settings
    call_address(
        user_code.propulsion, 0, Z, file_settings, file_settings, file_settings, settings, 0.0
    )
    x = vehicle.foreign.engine_x
    z = vehicle.foreign.engine_z
    if x != 0.0 or z != 0.0:
        for lane in range(width):
            fx, fy, fz = vector_at(Z, s.F_THRUST, lane)
            Z[s.F_MOMENT, lane] -= z * fy
            Z[s.F_MOMENT + 1, lane] += z * fx - x * fz
            Z[s.F_MOMENT + 2, lane] += x * fy


@lanes
def foreign_thrust(Z, width, vehicle, user_code):
    """Compute the dispersed thrust with the engine function at the stage's state.

    The results are stored in the rows starting at ``F_THRUST``. The moment is about the centre of
    gravity and includes the asymmetry caused by failed engines.
    """
    call_propulsion(Z, width, vehicle, user_code, s.RHO, s.AIRSPEED, DISPERSED)
    constants = vehicle.constants
    for lane in range(width):
        mass = Z[XS + s.MASS, lane]
        # A vehicle file without an empty mass means that the engine always has fuel.
        has_fuel = mass > constants.mass_empty * Z[s.K_MASS, lane] or constants.burns_fuel == 0.0
        runs = Z[s.ENGINE_THRUST, lane] if has_fuel else 0.0
        factor = Z[s.K_THRUST, lane] * runs
        tx = factor * Z[s.F_THRUST, lane]
        ty = factor * Z[s.F_THRUST + 1, lane]
        tz = factor * Z[s.F_THRUST + 2, lane]
        arm_x = Z[s.ENGINE_ARM, lane] - Z[s.CG_X, lane] - Z[s.K_CG_X, lane]
        arm_y = Z[s.ENGINE_ARM + 1, lane] - Z[s.K_CG_Y, lane]
        arm_z = Z[s.ENGINE_ARM + 2, lane] - Z[s.CG_Z, lane] - Z[s.K_CG_Z, lane]
        Z[s.F_MOMENT, lane] = factor * Z[s.F_MOMENT, lane] + arm_y * tz - arm_z * ty
        Z[s.F_MOMENT + 1, lane] = factor * Z[s.F_MOMENT + 1, lane] + arm_z * tx - arm_x * tz
        Z[s.F_MOMENT + 2, lane] = factor * Z[s.F_MOMENT + 2, lane] + arm_x * ty - arm_y * tx
        per_mass, per_isp = reciprocals(mass, Z[s.K_ISP, lane])
        Z[s.F_THRUST, lane] = tx
        Z[s.F_THRUST + 1, lane] = ty
        Z[s.F_THRUST + 2, lane] = tz
        Z[s.F_FUEL_FLOW, lane] = (
            runs * Z[s.F_FUEL_FLOW, lane] * per_isp if constants.burns_fuel > 0.0 else 0.0
        )
        Z[s.F_MASS, lane] = per_mass


@lanes
def add_thrust(Z, width, stage):
    """Add the thrust of the engine function to accumulated derivatives.

    The derivatives are linear in the force; the state of the next stage is updated as well.
    """
    for lane in range(width):
        Z[s.THRUST, lane] = Z[s.F_THRUST, lane]
        fx, fy, fz = vector_at(Z, s.F_THRUST, lane)
        add_force(Z, lane, stage, Z[s.F_MASS, lane], fx, fy, fz)
        add_derivative(Z, lane, s.MASS, -Z[s.F_FUEL_FLOW, lane], stage)


@lanes
def is_misaligned(Z, width):
    """Return whether the thrust of any flight is misaligned; this never changes in flight."""
    return any_lane(Z, width, _INCLINATION, 2, 0.0)


@lanes
def turn_thrust(Z, width, vehicle, by_function, stage):
    """Turn the thrust about its point of application, first upward and then to the right.

    The changes of force and moment are added to accumulated derivatives, which are linear in both;
    the state of the next stage is updated as well. A moment that an engine function returns in
    addition to its force does not change.
    """
    constants = vehicle.constants
    foreign = vehicle.foreign
    for lane in range(width):
        fx, fy, fz = vector_at(Z, s.F_THRUST, lane)
        x = foreign.engine_x
        z = foreign.engine_z
        if not by_function:
            fx = Z[s.THRUST, lane] * constants.thrust_cos
            fy = 0.0
            fz = -Z[s.THRUST, lane] * constants.thrust_sin
            x = 0.0
            z = constants.thrust_offset_z
        sine, cosine = sincos(Z[_INCLINATION, lane])
        up_x = cosine * fx + sine * fz
        up_z = cosine * fz - sine * fx
        sine, cosine = sincos(Z[_AZIMUTH, lane])
        dx = cosine * up_x - sine * fy - fx
        dy = cosine * fy + sine * up_x - fy
        dz = up_z - fz
        arm_x = x + Z[s.ENGINE_ARM, lane] - Z[s.CG_X, lane] - Z[s.K_CG_X, lane]
        arm_y = Z[s.ENGINE_ARM + 1, lane] - Z[s.K_CG_Y, lane]
        arm_z = z + Z[s.ENGINE_ARM + 2, lane] - Z[s.CG_Z, lane] - Z[s.K_CG_Z, lane]
        # reciprocal of the mass at the stage
        per_mass, _ = reciprocals(Z[s.V_MASS, lane] * Z[s.K_MASS, lane], 1.0)
        add_force(Z, lane, stage, per_mass, dx, dy, dz)
        p_dot, q_dot, r_dot = add_moment(
            Z,
            lane,
            stage,
            arm_y * dz - arm_z * dy,
            arm_z * dx - arm_x * dz,
            arm_x * dy - arm_y * dx,
        )
        Z[s.ANGULAR_ACCELERATION, lane] += p_dot
        Z[s.ANGULAR_ACCELERATION + 1, lane] += q_dot
        Z[s.ANGULAR_ACCELERATION + 2, lane] += r_dot


STEP = 1e-5  # step of central differences, rad
_K_PART = parameter_row(
    "aero.lift.sideslip"
)  # The rows of the other variables and coefficients follow.
# number of dispersed variables: sideslip, rates and deflections
N_PARTS = s.V_DELTA_E - s.V_BETA + 1


@lanes
def find_dispersed(Z, width):
    """Determine in which flights a coefficient's dependence on a variable is dispersed."""
    for lane in range(width):
        Z[s.F_DISPERSED, lane] = 0.0
    for i in range(N_COEFFICIENTS * N_PARTS):
        for lane in range(width):
            Z[s.F_DISPERSED, lane] += 0.0 if Z[_K_PART + i, lane] == 1.0 else 1.0


@lanes
def call_aerodynamics(Z, foreign, user_code, settings):
    """Compute coefficients in stability axes; ``settings`` is NOMINAL or DISPERSED."""
    values = foreign.settings
    call_address(user_code.aerodynamics, 0, Z, values, values, values, settings, 0.0)


@lanes
def foreign_coefficients(Z, A, width, vehicle, user_code, failing):
    """Compute the dispersed coefficients at the stage's deflections."""
    for lane in range(width):
        Z[s.F_DENSITY, lane], Z[s.F_AIRSPEED, lane] = Z[s.RHO, lane], Z[s.AIRSPEED, lane]
    call_aerodynamics(Z, vehicle.foreign, user_code, DISPERSED)
    if not any_lane(Z, width, s.F_DISPERSED, 1, 0.0):
        return
    for c in range(N_COEFFICIENTS):
        for lane in range(width):
            Z[s.F_COEF + c, lane] = Z[s.COEF + c, lane]
    for variable in range(N_PARTS):
        used = False
        for c in range(N_COEFFICIENTS):
            used |= any_lane(Z, width, _K_PART + c * N_PARTS + variable, 1, 1.0)
        if used:
            add_dispersion(Z, A, width, vehicle, user_code, failing, variable)
    for c in range(N_COEFFICIENTS):
        for lane in range(width):
            Z[s.COEF + c, lane] = Z[s.F_COEF + c, lane]


@lanes
def add_dispersion(Z, A, width, vehicle, user_code, failing, variable):
    """Add the effect of one variable's dispersions to ``F_COEF``; ``Z[COEF]`` is unchanged."""
    row = s.V_BETA + variable
    for lane in range(width):
        Z[s.F_MASS, lane] = Z[row, lane]
        Z[row, lane] = 0.0
    if variable >= 4:
        place_effectors(Z, A, width, vehicle, failing, variable - 4)
    base = s.F_BASE  # rows of the undispersed coefficients
    for c in range(N_COEFFICIENTS):
        for lane in range(width):
            Z[base + c, lane] = Z[s.COEF + c, lane]
    call_aerodynamics(Z, vehicle.foreign, user_code, DISPERSED)
    for lane in range(width):
        Z[row, lane] = Z[s.F_MASS, lane]
    if variable >= 4:
        place_effectors(Z, A, width, vehicle, failing, -1)
    for c in range(N_COEFFICIENTS):
        for lane in range(width):
            factor = Z[_K_PART + c * N_PARTS + variable, lane] - 1.0
            total = Z[base + c, lane]
            Z[s.F_COEF + c, lane] += factor * (total - Z[s.COEF + c, lane])
            Z[s.COEF + c, lane] = total


@lanes
def nominal_coefficients(Z, width, vehicle, user_code, density_row, speed_row):
    """Compute nominal coefficients; the density and the speed are in the given rows."""
    for lane in range(width):
        Z[s.F_DENSITY, lane], Z[s.F_AIRSPEED, lane] = Z[density_row, lane], Z[speed_row, lane]
    call_aerodynamics(Z, vehicle.foreign, user_code, NOMINAL)


@lanes
def nominal_slopes(Z, width, vehicle, user_code, first_row):
    """Compute the derivatives with respect to aileron, rudder, elevator and sideslip.

    The results are in the rows ``first_row + coefficient * N_INPUTS + input``. ``Z[COEF]`` and the
    variables are unchanged.
    """
    for c in range(N_COEFFICIENTS):
        for lane in range(width):
            Z[s.F_COEF + c, lane] = Z[s.COEF + c, lane]
    for i in range(N_INPUTS):
        row = s.V_DELTA_A + i if i < 3 else s.V_BETA
        for lane in range(width):
            Z[s.F_MASS, lane] = Z[row, lane]
        for side in range(2):
            for lane in range(width):
                Z[row, lane] = Z[s.F_MASS, lane] + (STEP if side == 0 else -STEP)
            set_effectors(Z, width, vehicle.effector_mix)
            call_aerodynamics(Z, vehicle.foreign, user_code, NOMINAL)
            for c in range(N_COEFFICIENTS):
                slope = first_row + c * N_INPUTS + i
                for lane in range(width):
                    value = Z[s.COEF + c, lane]
                    Z[slope, lane] = value if side == 0 else (Z[slope, lane] - value) * (0.5 / STEP)
        for lane in range(width):
            Z[row, lane] = Z[s.F_MASS, lane]
    set_effectors(Z, width, vehicle.effector_mix)
    for c in range(N_COEFFICIENTS):
        for lane in range(width):
            Z[s.COEF + c, lane] = Z[s.F_COEF + c, lane]


_N_MOTION = s.MASS - s.U + 1  # number of rows of velocity, attitude, rates and mass


@lanes
def start_states(Z, width, states, settings, initial_state):
    """Set the custom states to their initial values plus their initial dispersions.

    The rows of the dispersions follow the rows of the settings.
    """
    for i in range(states):
        for lane in range(width):
            start = initial_state[N_STATES + i] + Z[s.SETTING + settings + i, lane]
            Z[s.CUSTOM_STATE + i, lane] = start
            Z[s.CUSTOM_STAGE + i, lane] = start


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
            Z[s.CUSTOM_STATE + i, lane] = value
            Z[s.CUSTOM_STAGE + i, lane] = value


@lanes
def add_sensed(Z, width, measured):
    """Add the custom function's sensor effects to the first ``measured`` measurements."""
    for i in range(measured):
        for lane in range(width):
            Z[s.MEASURED + i, lane] += Z[s.SENSED + i, lane]
