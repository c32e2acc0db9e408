"""Custom control law for one control tick in all lanes: inputs, call and commands.

The code is compiled separately (:mod:`abhv_mc_vehicle.user_code`) and called once per tick for all
lanes. The plan contains its address, so all custom control laws share one compiled kernel.
"""

import math

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.jit_pointer import call_address
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.laws.allocation import moment_slope, nominal_moment
from abhv_mc_vehicle.kernel.laws.tlc import N_ROWS as N_TLC_ROWS
from abhv_mc_vehicle.kernel.laws.tlc import (
    RHO_NOM,
    SLOPES,
    nominal_forces,
    nominal_variables,
    nominal_vehicle,
)
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.effectors import count_driven, leave_effectors, share_commands
from abhv_mc_vehicle.kernel.plant.foreign import thrust
from abhv_mc_vehicle.kernel.plant.state import LAW

MAX_MEMORY = 256  # maximum number of values in a control law's memory

# These rows follow the rows of TLC, because custom laws also use TLC's nominal vehicle.
FAULT = LAW + N_TLC_ROWS  # outcome code if the control law ends the flight, else 0
MEMORY = FAULT + 1
ONBOARD = (
    MEMORY + MAX_MEMORY
)  # rows in the order of abhv_mc_vehicle.user_code.law_interface.Onboard
_MOMENT = ONBOARD + 3
_LIFT = ONBOARD + 15
_SLOPES = ONBOARD + 18
_INERTIA = ONBOARD + 24
N_ONBOARD = 28
CHANNEL = ONBOARD + N_ONBOARD  # custom channels
MAX_CHANNELS = 16
N_ROWS = CHANNEL + MAX_CHANNELS - LAW

NOT_FINITE = 4.0  # outcome code, see abhv_mc_vehicle.flight.plan

# Step of finite differences, in rad and in equivalence ratio. Its size is uncritical, because
# tables are linear within a cell.
_STEP = 1e-6


@lanes
def call_user(plan, memory, tick):
    """Call custom code at a control tick: a control law, or a filter of the measurement."""
    code = plan.user_code
    dt = plan.timing.step * plan.timing.steps_per_tick
    reference = plan.reference
    gains = plan.gains
    settings = plan.settings
    call_address(code.address, code.context, memory.Z, reference, gains, settings, tick, dt)


@lanes
def user_tick(plan, memory, width, tick):
    """Compute the commands from the measurement at a control tick."""
    Z = memory.Z
    user_code = plan.user_code
    if user_code.onboard > 0:
        nominal_onboard(plan, memory, width, tick)
    leave_effectors(Z, width, plan.vehicle)
    if user_code.address != 0:
        call_user(plan, memory, tick)
    finish_commands(
        Z, width, plan.vehicle.constants, count_driven(plan.vehicle), plan.reference, tick
    )
    share_commands(Z, width, plan.vehicle)


@lanes
def finish_commands(Z, width, constants, effectors, reference, tick):
    """Limit the commands to the vehicle's range; a command that is not finite ends the flight."""
    limit = constants.surface_limit
    for lane in range(width):
        path = Z[s.GAMMA_CMD, lane]
        alpha = Z[s.ALPHA_CMD, lane]
        bank = Z[s.BANK_CMD, lane]
        path = reference[tick, ref.FLIGHT_PATH_ANGLE] if path == math.inf else path
        alpha = reference[tick, ref.ANGLE_OF_ATTACK] if alpha == math.inf else alpha
        bank = reference[tick, ref.BANK] if bank == math.inf else bank
        aileron = clamp(Z[s.CMD_AILERON, lane], -limit, limit)
        rudder = clamp(Z[s.CMD_RUDDER, lane], -limit, limit)
        elevator = clamp(Z[s.CMD_ELEVATOR, lane], -limit, limit)
        eta = Z[s.CMD_ETA, lane]
        eta = constants.equivalence_ratio_min if eta == math.inf else eta
        eta = clamp(eta, constants.equivalence_ratio_min, constants.equivalence_ratio_max)
        total = aileron + rudder + elevator + eta + path + alpha + bank
        for i in range(effectors):
            command = Z[s.EFFECTOR_COMMAND + i, lane]
            total += 0.0 if command == math.inf else command
        finite = total - total == 0.0
        fault = Z[FAULT, lane]
        Z[FAULT, lane] = NOT_FINITE if fault == 0.0 and not finite else fault
        Z[s.GAMMA_CMD, lane] = path
        Z[s.ALPHA_CMD, lane] = alpha
        Z[s.BANK_CMD, lane] = bank
        Z[s.CMD_AILERON, lane] = aileron
        Z[s.CMD_RUDDER, lane] = rudder
        Z[s.CMD_ELEVATOR, lane] = elevator
        Z[s.CMD_ETA, lane] = eta


@lanes
def nominal_onboard(plan, memory, width, tick):
    """Store nominal vehicle data for the measured state in rows starting at ``ONBOARD``."""
    Z = memory.Z
    vehicle = plan.vehicle
    constants = vehicle.constants
    nominal_variables(Z, width, vehicle, plan.reference, tick)
    # The model is evaluated at the measured point, at a shifted angle of attack, and at a shifted
    # equivalence ratio.
    for probe in range(3):
        for lane in range(width):
            eta = Z[s.CMD_ETA, lane]
            eta_step = _STEP if eta + _STEP < constants.equivalence_ratio_max else -_STEP
            Z[s.V_ALPHA, lane] = Z[s.M_ALPHA, lane] + (_STEP if probe == 1 else 0.0)
            Z[s.V_ETA, lane] = eta + (eta_step if probe == 2 else 0.0)
        if probe == 0:
            nominal_vehicle(plan, memory, width, plan.user_code)
        else:
            nominal_forces(plan, memory, width, plan.user_code)
        for lane in range(width):
            speed = Z[s.M_SPEED, lane]
            density = Z[RHO_NOM, lane]
            q_bar = 0.5 * density * speed * speed
            lift = q_bar * constants.area * Z[s.COEF, lane]
            drag = q_bar * constants.area * Z[s.COEF + 1, lane]
            force = thrust(Z, lane, constants, Z[s.V_ETA, lane], density, speed, q_bar)
            force += Z[s.F_THRUST, lane]  # force of an engine function
            if probe == 0:
                Z[ONBOARD, lane] = Z[s.V_MACH, lane]
                Z[ONBOARD + 1, lane] = density
                Z[ONBOARD + 2, lane] = q_bar
                m_x, m_y, m_z = nominal_moment(Z, lane, constants, density, q_bar, speed)
                Z[_MOMENT, lane] = m_x
                Z[_MOMENT + 1, lane] = m_y
                Z[_MOMENT + 2, lane] = m_z
                for i in range(3):
                    m_x, m_y, m_z = moment_slope(Z, lane, constants, q_bar, SLOPES, i)
                    row = _MOMENT + 3 + 3 * i
                    Z[row, lane] = m_x
                    Z[row + 1, lane] = m_y
                    Z[row + 2, lane] = m_z
                Z[_LIFT, lane] = lift
                Z[_LIFT + 1, lane] = drag
                Z[_LIFT + 2, lane] = force
                Z[_INERTIA, lane], Z[_INERTIA + 1, lane] = (
                    Z[s.INERTIA_XX, lane],
                    Z[s.INERTIA_YY, lane],
                )
                Z[_INERTIA + 2, lane], Z[_INERTIA + 3, lane] = (
                    Z[s.INERTIA_ZZ, lane],
                    Z[s.INERTIA_13, lane],
                )
            else:
                step = (
                    Z[s.V_ALPHA, lane] - Z[s.M_ALPHA, lane]
                    if probe == 1
                    else Z[s.V_ETA, lane] - Z[s.CMD_ETA, lane]
                )
                row = _SLOPES + 3 * (probe - 1)
                Z[row, lane] = (lift - Z[_LIFT, lane]) / step
                Z[row + 1, lane] = (drag - Z[_LIFT + 1, lane]) / step
                Z[row + 2, lane] = (force - Z[_LIFT + 2, lane]) / step
