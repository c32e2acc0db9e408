"""Equilibrium of custom dynamics at the start of a mission, computed with the trim."""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.mission import Mission
from abhv_mc_vehicle.kernel.numerics.quaternion import rotate_meridional
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import aligned_zeros, variable_row
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.kernel.world.earth import gravity_ned
from abhv_mc_vehicle.plant.trim import GRAVITY, TrimPoint
from abhv_mc_vehicle.user_code.law_interface import Measured
from abhv_mc_vehicle.user_code.vehicle_functions import (
    WIDTH,
    call_loop,
    compile_functions,
    find_code,
    function_line,
)
from abhv_mc_vehicle.vehicle.vehicle_code import (
    VehicleCode,
    evaluate_fixed,
    evaluate_tables,
    make_variables,
)

MakeState = Callable[[TrimPoint], Floats]
FindTrim = Callable[[tuple[float, float, float]], TrimPoint]

_ITERATIONS = 30
_STEP = 1e-4  # relative step of numerical derivatives
_SMALLEST = 1e-6  # lower limit of a state's magnitude when its step is computed
_CONVERGED = 1e-10  # relative tolerance of the last Newton step
_SINGULAR = 1e-12  # smallest accepted ratio of the smallest to the largest singular value
_NOTED, _REJECTED = 0.4, 2.0  # |eigenvalue| * step above which a warning or an error is issued


def start_custom(
    mission: Mission,
    vehicle: Vehicle,
    make_state: MakeState,
    find_trim: FindTrim,
    step_length: float,
) -> tuple[TrimPoint, Floats, list[str]]:
    """Return the trim with custom dynamics, the initial custom states, and warnings.

    ``find_trim`` returns the trim for the force and moment of custom dynamics (``push`` of
    :class:`FlightPoint`); ``make_state`` converts a trim to a state. Raise InputError if there is
    no equilibrium or the integration step is too long.
    """
    code = find_code(vehicle)
    if code is None or code.dynamics is None:
        return find_trim((0.0, 0.0, 0.0)), np.zeros(0), []
    point = _StartPoint(mission, vehicle, code, make_state, functools.cache(find_trim))
    push = np.zeros(3)
    states = np.array([state.start or 0.0 for state in code.states])
    weight = vehicle.constants.mass_start * GRAVITY
    scale = weight * np.array([1.0, 1.0, vehicle.constants.chord])

    def residual(push: Floats) -> Floats:
        states[:] = _solve_states(point, states, push)
        return np.asarray(point.evaluate(states, push)[1] - push)

    # Broyden's method needs few trims, because the force hardly depends on the trim.
    value = residual(push)
    J = -np.eye(3)
    for _ in range(_ITERATIONS):
        if (np.abs(value) <= _CONVERGED * scale).all():
            break
        step = -np.linalg.solve(J, value)
        push = push + step
        next_value = residual(push)
        scaled_step = step / scale
        J += np.outer(next_value - value - J @ step, scaled_step / scale) / (
            scaled_step @ scaled_step
        )
        value = next_value
    else:
        raise _refuse(code, "the custom states and the trim have no common equilibrium")
    return point.trim(push), states, _check_step(point, states, push, step_length)


def _solve_states(point: "_StartPoint", states: Floats, push: Floats) -> Floats:
    """Return the custom states whose rates are zero in the trim with the load ``push``.

    The iteration starts at ``states``. Raise InputError if it does not converge.
    """
    code = point.code
    free = np.array([state.start is None for state in code.states])
    x = states.copy()
    if not free.any():
        _check_finite(point, x, push)
        return x

    def rates(x: Floats) -> Floats:
        return point.evaluate(x, push)[0][free]

    for _ in range(_ITERATIONS):
        _check_finite(point, x, push)
        steps = _STEP * np.maximum(np.abs(x[free]), _SMALLEST)
        J = _slopes(rates, x, free, steps)
        _check_equilibrium(code, J, np.flatnonzero(free))
        change = np.linalg.solve(J, rates(x))
        x[free] -= change
        if (np.abs(change) <= _CONVERGED * np.maximum(np.abs(x[free]), _SMALLEST)).all():
            return x
    raise _refuse(code, "the custom states have no equilibrium at the mission's start")


def _refuse(
    code: VehicleCode,
    problem: str,
    expected: str = "'start:' in the vehicle file for states without equilibrium",
) -> InputError:
    """Return an InputError at the function of the custom dynamics."""
    file = code.dynamics.file if code.dynamics else ""
    return InputError(file, problem, expected, function_line(code.dynamics))


def _slopes(
    function: Callable[[Floats], Floats], x: Floats, unknown: Mask, steps: Floats
) -> Floats:
    """Return the Jacobian [value, unknown], computed by central differences."""
    columns = []
    for i, step in zip(np.flatnonzero(unknown), steps, strict=True):
        ends = [x.copy(), x.copy()]
        ends[0][i] += step
        ends[1][i] -= step
        columns.append((function(ends[0]) - function(ends[1])) / (2.0 * step))
    return np.stack(columns, axis=1)


def _check_equilibrium(code: VehicleCode, J: Floats, free_states: Ints) -> None:
    """Raise InputError with the name of a state if the Jacobian is singular."""
    sizes = np.abs(J).max(axis=1, keepdims=True)
    scaled = J / np.where(sizes > 0.0, sizes, 1.0)
    _, singular, rows = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=0).clip(1e-300))
    if singular[-1] > _SINGULAR * singular[0]:
        return
    state = code.states[int(free_states[np.abs(rows[-1]).argmax()])]
    raise _refuse(
        code,
        f"the state '{state.name}' has no equilibrium at the start of the mission",
        f"{state.name}: {{unit: {state.unit}, start: ...}} in the vehicle file",
    )


def _check_finite(point: "_StartPoint", states: Floats, push: Floats) -> None:
    """Raise InputError if custom dynamics return a non-finite number at the mission's start."""
    rates, _, effect = point.evaluate(states, push)
    names = [f"rate of '{state.name}'" for state in point.code.states]
    names += [f"{quantity} along {axis}" for quantity in ("force", "moment") for axis in "xyz"]
    names += [f"sensed {name}" for name in Measured._fields]
    bad = np.flatnonzero(~np.isfinite([*rates, *effect]))
    if bad.size:
        problem = f"the {names[bad[0]]} is not finite at the start of the mission"
        raise _refuse(point.code, problem, "finite numbers")


def _check_step(point: "_StartPoint", states: Floats, push: Floats, step: float) -> list[str]:
    """Return a warning if the integration step barely resolves the fastest mode.

    Raise InputError if the integration is unstable.
    """
    steps = _STEP * np.maximum(np.abs(states), _SMALLEST)
    free = np.ones(len(states), bool)
    J = _slopes(lambda x: point.evaluate(x, push)[0], states, free, steps)
    fastest = float(np.abs(np.linalg.eigvals(J)).max())
    phrase = f"an eigenvalue of {fastest:.3g} rad/s, but the step is {1e3 * step:g} ms"
    longest_step = f"{1e3 * _NOTED / fastest:.2g} ms" if fastest > 0.0 else ""
    if fastest * step > _REJECTED:
        raise _refuse(
            point.code,
            f"the custom dynamics have {phrase}",
            f"a 'step:' of at most {longest_step} in the mission file",
        )
    if fastest * step <= _NOTED:
        return []
    return [
        f"the custom dynamics have {phrase}, which adds numerical damping; use a step of at most "
        f"{longest_step}"
    ]


@dataclass(frozen=True)
class _StartPoint:
    """Custom dynamics at the start of a mission, as a function of states and push.

    ``push`` contains the forces along body x and z and the moment about body y that the custom
    states cause.
    """

    mission: Mission
    vehicle: Vehicle
    code: VehicleCode
    make_state: MakeState
    find_trim: FindTrim

    def trim(self, push: Floats) -> TrimPoint:
        """Return the trim of the vehicle with the additional force and moment ``push``."""
        x, z, moment = push.tolist()
        return self.find_trim((x, z, moment))

    def evaluate(self, states: Floats, push: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the rates of the states and the resulting load, in the trim with ``push``.

        The third array contains the force, the moment and the sensed quantities.
        """
        trim = self.trim(push)
        start = self.mission.start
        x = self.make_state(trim)
        alpha = trim.angle_of_attack
        mass = self.vehicle.constants.mass_start
        local_gravity = gravity_ned(
            self.mission.make_earth(),
            start.altitude,
            math.sin(start.latitude),
            math.cos(start.latitude),
        )
        q0, q1, q2, q3 = x[s.Q0 : s.Q3 + 1].tolist()
        gravity = rotate_meridional(q0, q1, q2, q3, local_gravity[0], local_gravity[1])
        # These are the forces that the trim requires in addition to the force in `push`.
        force_x = trim.forward * math.cos(alpha) + trim.upward * math.sin(alpha) - push[0]
        force_z = trim.forward * math.sin(alpha) - trim.upward * math.cos(alpha) - push[1]
        variables = make_variables(
            self.vehicle,
            mach=trim.mach,
            angle_of_attack=alpha,
            elevator=trim.elevator,
            equivalence_ratio=trim.equivalence_ratio,
            altitude=start.altitude,
            mass=mass,
        )
        fixed = evaluate_fixed(
            self.vehicle, variables, evaluate_tables(self.vehicle.tables, variables)
        )
        Z = aligned_zeros((s.LAW, WIDTH))
        Z[s.VAR : s.VAR + len(variables)] = variables[:, :1]
        Z[s.AIRSPEED] = start.speed
        Z[s.RHO] = 2.0 * trim.dynamic_pressure / start.speed**2
        Z[variable_row("mach")] = trim.mach
        Z[s.MOTION : s.MOTION_ACCELERATION] = x[s.U : s.MASS + 1, None]
        acceleration = np.array([force_x / mass, 0.0, force_z / mass]) + gravity
        Z[s.MOTION_ACCELERATION : s.ANGULAR_ACCELERATION] = acceleration[:, None]
        Z[s.ANGULAR_ACCELERATION + 1] = -push[2] / float(fixed["inertia_yy"][0])
        Z[s.GRAVITY : s.GRAVITY + 3] = np.array(gravity)[:, None]
        Z[s.CUSTOM_STAGE : s.CUSTOM_STAGE + states.size] = states[:, None]
        settings = self.vehicle.foreign.settings
        Z[s.SETTING : s.SETTING + settings.size] = settings[:, None]
        call_loop(compile_functions(self.code, WIDTH).dynamics, Z, settings)
        custom_wrench = Z[[s.CUSTOM_FORCE, s.CUSTOM_FORCE + 2, s.CUSTOM_MOMENT + 1], 0]
        return (
            Z[s.CUSTOM_RATE : s.CUSTOM_RATE + states.size, 0],
            custom_wrench,
            Z[s.CUSTOM_FORCE : s.SENSED + len(Measured._fields), 0],
        )
