"""Effectors: surfaces mixed from the axis deflections, or with separate actuators.

If effectors have actuators, the axes have none: axis commands are mixed before the actuators, and
the axis deflections are those that all effectors produce together. The actuators of effectors use
the memory ``A[row, lane]``.
"""

import math

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp
from abhv_mc_vehicle.kernel.numerics.tables import natural
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import FIRST_EFFECTOR
from abhv_mc_vehicle.kernel.plant.actuators import (
    AHEAD,
    COMMAND,
    MOVES,
    N_EFFECTOR_ROWS,
    NEXT,
    NEXT_RATE,
    POSITION,
    SLOWED,
    STAGE,
    command_ideal,
    limits_of,
    prepare_actuators,
    run_actuators,
)
from abhv_mc_vehicle.kernel.plant.disturbance import any_lane
from abhv_mc_vehicle.kernel.plant.state import VAR, XS, X
from abhv_mc_vehicle.kernel.plant.vehicle import MAX_ACTUATORS

A_ROWS = MAX_ACTUATORS * N_EFFECTOR_ROWS


@lanes
def count_driven(vehicle):
    """Return the number of effectors with actuators: either all of the effectors, or 0."""
    return vehicle.effectors.mix.shape[0] if vehicle.constants.driven > 0.0 else 0


@lanes
def mix_axes(Z, lane, mix, e, row):
    """Return an effector's mix of the three axis values in the rows starting at ``row``."""
    mixed = 0.0
    for i in range(3):
        mixed += mix[e, i] * Z[row + i, lane]
    return mixed


@lanes
def set_effectors(Z, width, mix):
    """Set the deflections of effectors that follow the three (effective) axis deflections."""
    for e in range(mix.shape[0]):
        aileron = mix[e, 0]
        rudder = mix[e, 1]
        elevator = mix[e, 2]
        for lane in range(width):
            Z[s.V_EFFECTOR + e, lane] = (
                aileron * Z[s.V_DELTA_A, lane]
                + rudder * Z[s.V_DELTA_A + 1, lane]
                + elevator * Z[s.V_DELTA_A + 2, lane]
            )


@lanes
def place_effectors(Z, A, width, vehicle, failing, without):
    """Set effector deflections at the stage, from axis deflections or from actuators.

    ``failing`` is true if an effector fails in any flight, see
    :mod:`abhv_mc_vehicle.kernel.plant.failures`. ``without`` is an axis whose contribution is
    omitted (-1 for none); its deflection among the variables is then 0.
    """
    driven = count_driven(vehicle)
    for e in range(driven):
        row = natural(VAR + vehicle.effectors.variable[e])
        stage = e * N_EFFECTOR_ROWS + STAGE
        for lane in range(width):
            Z[row, lane] = A[stage, lane]
        for i in range(3):
            if i == without or any_lane(Z, width, s.EFFECT + i, 1, 1.0):
                weaken_effector(Z, A, width, vehicle, e, i, without)
        if failing:
            fail_effector(Z, width, row, e)
    if driven == 0:
        set_effectors(Z, width, vehicle.effector_mix)
        if failing:
            for e in range(vehicle.effector_mix.shape[0]):
                fail_effector(Z, width, s.V_EFFECTOR + e, e)


@lanes
def fail_effector(Z, width, row, e):
    """Apply a failure to the deflection of an effector."""
    for lane in range(width):
        Z[row, lane] = Z[s.EFFECTOR_GAIN + e, lane] * Z[row, lane] + Z[s.EFFECTOR_OFFSET + e, lane]


@lanes
def weaken_effector(Z, A, width, vehicle, e, i, without):
    """Reduce the contribution of axis ``i`` to effector ``e`` by the axis's effectiveness."""
    share = vehicle.effectors.share
    row = natural(VAR + vehicle.effectors.variable[e])
    for f in range(share.shape[1]):
        if share[i, e, f] != 0.0:
            for lane in range(width):
                factor = 0.0 if i == without else Z[s.EFFECT + i, lane]
                Z[row, lane] += (factor - 1.0) * (
                    share[i, e, f] * A[f * N_EFFECTOR_ROWS + STAGE, lane]
                )


@lanes
def leave_effectors(Z, width, vehicle):
    """Reset the direct commands to the effectors."""
    for e in range(count_driven(vehicle)):
        for lane in range(width):
            Z[s.EFFECTOR_COMMAND + e, lane] = math.inf


@lanes
def share_commands(Z, width, vehicle):
    """Complete the commands of a control law that commands effectors directly.

    Other effectors follow the mix of the axes; the axis commands become those produced by all
    effectors together.
    """
    mix = vehicle.effectors.mix
    axes = vehicle.effectors.axes
    count = count_driven(vehicle)
    for lane in range(width):
        is_commanded = False
        for e in range(count):
            is_commanded |= Z[s.EFFECTOR_COMMAND + e, lane] != math.inf
        if is_commanded:
            aileron = 0.0
            rudder = 0.0
            elevator = 0.0
            for e in range(count):
                mixed = mix[e, 0] * Z[s.CMD_AILERON, lane]
                mixed += mix[e, 1] * Z[s.CMD_RUDDER, lane] + mix[e, 2] * Z[s.CMD_ELEVATOR, lane]
                command = Z[s.EFFECTOR_COMMAND + e, lane]
                command = mixed if command == math.inf else command
                Z[s.EFFECTOR_COMMAND + e, lane] = command
                aileron += axes[0, e] * command
                rudder += axes[1, e] * command
                elevator += axes[2, e] * command
            Z[s.CMD_AILERON, lane] = aileron
            Z[s.CMD_RUDDER, lane] = rudder
            Z[s.CMD_ELEVATOR, lane] = elevator


@lanes
def start_effectors(Z, A, width, vehicle, step):
    """Initialize the effectors from the mix of the axis deflections, at rest."""
    actuators = vehicle.actuators
    count = count_driven(vehicle)
    prepare_actuators(Z, A, width, actuators, FIRST_EFFECTOR, FIRST_EFFECTOR + count, step)
    for e in range(count):
        first = e * N_EFFECTOR_ROWS
        for lane in range(width):
            low, high = limits_of(Z, lane, actuators, FIRST_EFFECTOR + e)
            mixed = clamp(mix_axes(Z, lane, vehicle.effectors.mix, e, X + s.AILERON), low, high)
            A[first + POSITION, lane] = mixed
            A[first + STAGE, lane] = mixed
            A[first + MOVES, lane] = 0.0
            A[first + AHEAD, lane] = 0.0
    show_axes(Z, A, width, vehicle)


@lanes
def show_axes(Z, A, width, vehicle):
    """Set axis deflections and rates to the values that the effectors produce together."""
    axes = vehicle.effectors.axes
    count = count_driven(vehicle)
    if count > 0:
        for i in range(3):
            for lane in range(width):
                position = 0.0
                rate = 0.0
                for e in range(count):
                    position += axes[i, e] * A[e * N_EFFECTOR_ROWS + POSITION, lane]
                    rate += axes[i, e] * A[e * N_EFFECTOR_ROWS + MOVES, lane]
                Z[X + s.AILERON + i, lane] = position
                Z[XS + s.AILERON + i, lane] = position
                Z[X + s.AILERON_RATE + i, lane] = rate
                Z[XS + s.AILERON_RATE + i, lane] = rate


@lanes
def command_effectors(Z, A, width, vehicle):
    """Compute the effectors' limited commands, either direct or mixed from the axes."""
    for e in range(count_driven(vehicle)):
        first = e * N_EFFECTOR_ROWS
        for lane in range(width):
            mixed = mix_axes(Z, lane, vehicle.effectors.mix, e, s.ACTUATED)
            direct = Z[s.EFFECTOR_COMMAND + e, lane]
            command = mixed if direct == math.inf else direct
            low, high = limits_of(Z, lane, vehicle.actuators, FIRST_EFFECTOR + e)
            Z[s.EFFECTOR_ASKED + e, lane] = command
            A[first + COMMAND, lane] = clamp(command, low, high)
            A[first + SLOWED, lane] = 1.0


@lanes
def begin_effectors(Z, A, width, vehicle):
    """Set effectors without dynamics to their commands, and update all saturation flags."""
    for lane in range(width):
        Z[s.ANY_SATURATED, lane] = 0.0
    count = count_driven(vehicle)
    command_ideal(Z, A, width, vehicle.actuators, FIRST_EFFECTOR, FIRST_EFFECTOR + count)
    for e in range(count):
        first = e * N_EFFECTOR_ROWS
        for lane in range(width):
            low, high = limits_of(Z, lane, vehicle.actuators, FIRST_EFFECTOR + e)
            position = A[first + POSITION, lane]
            command = Z[s.EFFECTOR_ASKED + e, lane]
            saturated = high > low and (
                position <= low or position >= high or command <= low or command >= high
            )
            Z[s.EFFECTOR_AT + e, lane] = position
            Z[s.EFFECTOR_SATURATED + e, lane] = 1.0 if saturated else 0.0
            Z[s.ANY_SATURATED, lane] = 1.0 if saturated else Z[s.ANY_SATURATED, lane]
    show_axes(Z, A, width, vehicle)


@lanes
def run_effectors(Z, A, width, vehicle, step, active):
    """Compute the motion of effectors with actuators over a step, after its first stage."""
    last = FIRST_EFFECTOR + count_driven(vehicle)
    run_actuators(Z, A, width, vehicle.actuators, FIRST_EFFECTOR, last, step, False, active)


@lanes
def end_effectors(A, width, vehicle):
    """Set the effectors to their positions at the end of the step, for the last stage."""
    for e in range(count_driven(vehicle)):
        first = e * N_EFFECTOR_ROWS
        for lane in range(width):
            A[first + STAGE, lane] = A[first + NEXT, lane]


@lanes
def finish_effectors(Z, A, width, vehicle, alive):
    """Set the effectors' state after the step, except in ended flights (``alive`` 0)."""
    for e in range(count_driven(vehicle)):
        first = e * N_EFFECTOR_ROWS
        for lane in range(width):
            flies = alive[lane] > 0.0
            A[first + POSITION, lane] = (
                A[first + NEXT, lane] if flies else A[first + POSITION, lane]
            )
            A[first + MOVES, lane] = A[first + NEXT_RATE, lane] if flies else A[first + MOVES, lane]
            A[first + STAGE, lane] = A[first + POSITION, lane]
    show_axes(Z, A, width, vehicle)
