"""Thrust from tables or a custom engine function, and its misalignment."""

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.jit_pointer import call_address
from abhv_mc_vehicle.kernel.numerics.lane_math import reciprocals, sincos
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.disturbance import any_lane
from abhv_mc_vehicle.kernel.plant.rigid_body import add_derivative, add_force, add_moment
from abhv_mc_vehicle.kernel.plant.state import XS, parameter_rows

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
    x, z = vehicle.foreign.engine_x, vehicle.foreign.engine_z
    if x != 0.0 or z != 0.0:
        for lane in range(width):
            fx = Z[s.F_THRUST, lane]
            fy = Z[s.F_THRUST + 1, lane]
            fz = Z[s.F_THRUST + 2, lane]
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
        fx = Z[s.F_THRUST, lane]
        fy = Z[s.F_THRUST + 1, lane]
        fz = Z[s.F_THRUST + 2, lane]
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
    constants, foreign = vehicle.constants, vehicle.foreign
    for lane in range(width):
        fx = Z[s.F_THRUST, lane]
        fy = Z[s.F_THRUST + 1, lane]
        fz = Z[s.F_THRUST + 2, lane]
        x, z = foreign.engine_x, foreign.engine_z
        if not by_function:
            fx, fy = Z[s.THRUST, lane] * constants.thrust_cos, 0.0
            fz = -Z[s.THRUST, lane] * constants.thrust_sin
            x, z = 0.0, constants.thrust_offset_z
        sine, cosine = sincos(Z[_INCLINATION, lane])
        up_x, up_z = cosine * fx + sine * fz, cosine * fz - sine * fx
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
