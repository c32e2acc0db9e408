"""Custom functions of a vehicle in flight, each called once for all lanes.

Dispersions act as with tables. The factor on a coefficient's dependence on a variable multiplies
``f(x) - f(x with that variable 0)``, or for an axis the difference without the axis' contribution to
all deflections, by an additional evaluation for each dispersed variable.
"""

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.jit_pointer import call_address
from abhv_mc.kernel.numerics.lane_math import reciprocals
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.disturbance import any_lane
from abhv_mc.kernel.plant.effectors import place_effectors, set_effectors
from abhv_mc.kernel.plant.slopes import N_INPUTS
from abhv_mc.kernel.plant.state import N_COEFFICIENTS, XS, parameter_row

STEP = 1e-5  # rad: slopes by central differences
# Settings of a call: those of the vehicle file, or those of each flight in the rows from ``SETTING``.
NOMINAL, DISPERSED = range(2)
_K_PART = parameter_row(
    "aero.lift.sideslip"
)  # and so on for each coefficient, in the order of the variables
N_PARTS = s.V_DELTA_E - s.V_BETA + 1  # sideslip, rates and deflections


@lanes
def find_dispersed(Z, width):
    """Determine whether a flight disperses coefficients by variable."""
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
    """Compute the dispersed coefficients of the stage at its deflections."""
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
    """Add the effect of one variable's dispersions to ``F_COEF``; keep ``Z[COEF]``."""
    row = s.V_BETA + variable
    for lane in range(width):
        Z[s.F_MASS, lane] = Z[row, lane]
        Z[row, lane] = 0.0
    if variable >= 4:
        place_effectors(Z, A, width, vehicle, failing, variable - 4)
    base = s.F_BASE  # of the coefficients, undispersed
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
    """Compute the coefficients of the nominal vehicle at the variables, a density and a speed."""
    for lane in range(width):
        Z[s.F_DENSITY, lane], Z[s.F_AIRSPEED, lane] = Z[density_row, lane], Z[speed_row, lane]
    call_aerodynamics(Z, vehicle.foreign, user_code, NOMINAL)


@lanes
def nominal_slopes(Z, width, vehicle, user_code, first_row):
    """Compute slopes with aileron, rudder, elevator and sideslip.

    They are in the rows ``first_row + coefficient * N_INPUTS + input``. ``Z[COEF]`` and the variables are
    unchanged.
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


@lanes
def nominal_thrust(Z, width, vehicle, user_code, density_row, speed_row):
    """Compute thrust, moment and fuel flow of the nominal engine, rows from ``F_THRUST``."""
    call_propulsion(Z, width, vehicle, user_code, density_row, speed_row, NOMINAL)


@lanes
def call_propulsion(Z, width, vehicle, user_code, density_row, speed_row, settings):
    """Compute thrust, moment and fuel flow of the engine function, rows from ``F_THRUST``.

    The moment is about the point of the aerodynamic moments.
    """
    for lane in range(width):
        Z[s.F_DENSITY, lane], Z[s.F_AIRSPEED, lane] = Z[density_row, lane], Z[speed_row, lane]
    values = vehicle.foreign.settings
    call_address(user_code.propulsion, 0, Z, values, values, values, settings, 0.0)
    x, z = vehicle.foreign.engine_x, vehicle.foreign.engine_z
    if x != 0.0 or z != 0.0:
        for lane in range(width):
            fx, fy, fz = Z[s.F_THRUST, lane], Z[s.F_THRUST + 1, lane], Z[s.F_THRUST + 2, lane]
            Z[s.F_MOMENT, lane] -= z * fy
            Z[s.F_MOMENT + 1, lane] += z * fx - x * fz
            Z[s.F_MOMENT + 2, lane] += x * fy


@lanes
def foreign_thrust(Z, width, vehicle, user_code):
    """Compute the dispersed thrust of the engine function, in rows from ``F_THRUST``.

    The moment is about the centre of gravity and includes that of failed engines.
    """
    call_propulsion(Z, width, vehicle, user_code, s.RHO, s.AIRSPEED, DISPERSED)
    constants = vehicle.constants
    for lane in range(width):
        mass = Z[XS + s.MASS, lane]
        # The engine of a vehicle without an empty mass always has fuel.
        has_fuel = mass > constants.mass_empty * Z[s.K_MASS, lane] or constants.burns_fuel == 0.0
        runs = Z[s.ENGINE_THRUST, lane] if has_fuel else 0.0
        factor = Z[s.K_THRUST, lane] * runs
        tx, ty, tz = (
            factor * Z[s.F_THRUST, lane],
            factor * Z[s.F_THRUST + 1, lane],
            factor * Z[s.F_THRUST + 2, lane],
        )
        arm_x = Z[s.ENGINE_ARM, lane] - Z[s.CG_X, lane] - Z[s.K_CG_X, lane]
        arm_y = Z[s.ENGINE_ARM + 1, lane] - Z[s.K_CG_Y, lane]
        arm_z = Z[s.ENGINE_ARM + 2, lane] - Z[s.CG_Z, lane] - Z[s.K_CG_Z, lane]
        Z[s.F_MOMENT, lane] = factor * Z[s.F_MOMENT, lane] + arm_y * tz - arm_z * ty
        Z[s.F_MOMENT + 1, lane] = factor * Z[s.F_MOMENT + 1, lane] + arm_z * tx - arm_x * tz
        Z[s.F_MOMENT + 2, lane] = factor * Z[s.F_MOMENT + 2, lane] + arm_x * ty - arm_y * tx
        per_mass, per_isp = reciprocals(mass, Z[s.K_ISP, lane])
        Z[s.F_THRUST, lane], Z[s.F_THRUST + 1, lane], Z[s.F_THRUST + 2, lane] = tx, ty, tz
        Z[s.F_FUEL_FLOW, lane] = (
            runs * Z[s.F_FUEL_FLOW, lane] * per_isp if constants.burns_fuel > 0.0 else 0.0
        )
        Z[s.F_MASS, lane] = per_mass


@lanes
def add_thrust(Z, width, stage):
    """Add the thrust of the engine function to the derivatives, which are linear in it."""
    for lane in range(width):
        Z[s.THRUST, lane] = Z[s.F_THRUST, lane]
        for i in range(3):
            specific = Z[s.F_THRUST + i, lane] * Z[s.F_MASS, lane]
            Z[s.SPECIFIC_X + i, lane] += specific
            add_derivative(Z, lane, s.U + i, specific, stage)
        add_derivative(Z, lane, s.MASS, -Z[s.F_FUEL_FLOW, lane], stage)


@lanes
def add_derivative(Z, lane, i, derivative, stage):
    """Add a derivative after :func:`abhv_mc.kernel.plant.equations.accumulate`."""
    Z[s.SUM + i, lane] += stage.weight * derivative
    Z[XS + i, lane] += stage.ahead * derivative
