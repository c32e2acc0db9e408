"""Preparation of flight plans from input files: reference, gains and trim."""

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Numbers
from abhv_mc.custom_code.source import UserSource
from abhv_mc.flights.metrics import pack_metrics
from abhv_mc.flights.timing import Timing
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.controller_file import (
    Controller,
    LqrController,
    TlcController,
    read_controller_document,
)
from abhv_mc_vehicle.control.design.design_cache import cache_results
from abhv_mc_vehicle.control.design.design_model import make_environment, slope, wrench_at
from abhv_mc_vehicle.control.design.lqr_design import make_lqr_gains
from abhv_mc_vehicle.control.design.reference import (
    make_mission_trim_tables,
    make_start_trim,
    on_glide_path,
    solve_reference,
    trim_faults,
)
from abhv_mc_vehicle.control.design.tlc_design import (
    make_limit_settings,
    make_tlc_gains,
    make_tlc_settings,
)
from abhv_mc_vehicle.control.law_file import (
    NATIVE,
    USER_LAWS,
    CController,
    FmuController,
    ProcessController,
    PythonController,
    UserController,
)
from abhv_mc_vehicle.control.mission import Mission, read_mission
from abhv_mc_vehicle.flight.dynamics_start import start_custom
from abhv_mc_vehicle.flight.metrics import effector_metrics
from abhv_mc_vehicle.flight.native_check import check_first_ticks, check_native
from abhv_mc_vehicle.flight.plan import EndBounds, FlightPlan, Limits
from abhv_mc_vehicle.flight.user_law import check_native_law, open_law, plan_source
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.flight.start import multiply
from abhv_mc_vehicle.kernel.laws.columns import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    BANK,
    MASS,
    REFERENCE,
    SPEED,
    TIME,
)
from abhv_mc_vehicle.kernel.numerics.quaternion import from_euler, rotate_to_body
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import LoadBounds, Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth, find_surroundings
from abhv_mc_vehicle.plant.effectiveness import make_effectiveness
from abhv_mc_vehicle.plant.trim import GRAVITY, TrimPoint
from abhv_mc_vehicle.user_code.compiled import COMMANDS, split_columns
from abhv_mc_vehicle.user_code.design import DesignModel, watched_design
from abhv_mc_vehicle.user_code.effector_commands import drive_commanded
from abhv_mc_vehicle.user_code.law_source import check_wiring, read_trusted_law
from abhv_mc_vehicle.user_code.load_law import load_law
from abhv_mc_vehicle.user_code.module import check_closure
from abhv_mc_vehicle.user_code.settings import (
    NO_COMMANDS,
    CommandSteps,
    make_commands,
    make_user_settings,
)
from abhv_mc_vehicle.user_code.vehicle_functions import check_finite, find_code, load_vehicle
from abhv_mc_vehicle.vehicle.actuators import name_effectors
from abhv_mc_vehicle.vehicle.shared_keys import choose_sensing
from abhv_mc_vehicle.vehicle.table_file import valid_range
from abhv_mc_vehicle.vehicle.vehicle_code import make_variables
from abhv_mc_vehicle.vehicle.warnings import find_vehicle_warnings

_find_warnings = cache_results(
    find_vehicle_warnings
)  # All controllers of a campaign use the same vehicle.
_LEAST_FUEL = 1e-9  # fuel mass at which the tank counts as empty, kg
_SPEED_FACTOR = 2.0  # default speed limit relative to the largest reference speed
_OUTSIDE = 1.0  # minimum time outside the tables that causes a warning, s
_ALPHA_OF_AUTHORITY = np.deg2rad(1.2)  # small angle of attack that is rarely a table node, rad


def prepare(vehicle: Path, mission: Path, controller: Path, name: str) -> FlightPlan:
    """Read three input files and return the plan. Raise InputError if a file is invalid."""
    packed_vehicle = load_vehicle(vehicle)
    parsed_mission = read_mission(mission)
    _check_functions(packed_vehicle, parsed_mission)
    law, user_code = read_law(controller)
    glides = packed_vehicle.constants.equivalence_ratio_max == 0.0
    if packed_vehicle.constants.surface_limit == 0.0 or (glides and user_code is None):
        raise InputError(
            vehicle,
            "the vehicle has no control surfaces or no engine",
            "a vehicle with both, because this controller requires them (custom control laws also "
            "work without an engine)",
        )
    if isinstance(law, TlcController) and not has_authority(packed_vehicle, parsed_mission):
        raise InputError(
            vehicle,
            "the moments caused by the deflections are not linearly independent",
            "aileron, rudder and elevator that together control roll, yaw and pitch",
        )
    try:
        plan = make_plan(packed_vehicle, parsed_mission, law, name, mission, user_code)
    except np.linalg.LinAlgError as error:
        raise InputError(
            mission,
            f"{law.law} has no gains for this vehicle along the mission ({str(error).lower()})",
            "a mission along which the vehicle is controllable",
        ) from None
    if plan.law in NATIVE:
        check_native(plan)
    else:
        with open_law(plan, LANES):  # Compilation errors occur before any file is written.
            pass
    if plan.law in USER_LAWS:
        check_first_ticks(plan)
    return plan


class UserLaw(NamedTuple):
    """Custom control law with its settings and the commands of the mission."""

    source: UserSource
    settings: Floats
    commands: CommandSteps = NO_COMMANDS
    # built-in controller whose measurements are filtered
    around: TlcController | LqrController | None = None


def read_law(controller: Path) -> tuple[Controller, UserLaw | None]:
    """Read a controller file; if it has a custom control law, also read and run its file.

    Raise InputError if a file is invalid.
    """
    document, law = read_controller_document(controller)
    if not isinstance(law, UserController):
        return law, None
    if isinstance(law, FmuController | ProcessController):
        check_wiring(document, law)
    source = read_trusted_law(law)
    if not isinstance(law, PythonController):
        check_native_law(document, law.law, source)
        numbers = law.numbers if isinstance(law, CController) else []
        return law, UserLaw(source, np.array(numbers, np.float64))
    check_closure(source)
    loaded = load_law(source)
    around = read_around(law)
    if loaded.mark.filters != (around is not None):
        problem = (
            "the function is a measurement filter, but the key 'around' is missing"
            if around is None
            else "the function is a control law, but the key 'around' is set"
        )
        raise document.error(
            ("file",) if around is None else ("around",),
            problem,
            "'around:' with a TLC or LQR controller file if, and only if, the function is "
            "decorated with @measurement_filter",
        )
    if around is not None:
        law = law.model_copy(update={"rate": around.rate})
    commands = make_commands(document, law, loaded)
    return law, UserLaw(source, make_user_settings(document, law, loaded), commands, around)


def read_around(law: PythonController) -> TlcController | LqrController | None:
    """Read the controller whose measurements ``law`` filters; return None for control laws.

    Raise InputError if the controller is not built in.
    """
    if law.around is None:
        return None
    document, around = read_controller_document(law.around)
    if isinstance(around, UserController):
        raise document.error(("law",), f"the filtered controller is '{around.law}'", "tlc or lqr")
    return around


def user_law_of(plan: FlightPlan, controller: Controller) -> UserLaw | None:
    """Return the custom law of a plan, or None for a built-in law.

    Raise ValueError if the source of the law is missing.
    """
    if plan.law not in USER_LAWS:
        return None
    if isinstance(controller, PythonController) and controller.around is not None:
        around = read_around(controller)
        return UserLaw(plan_source(plan), plan.filter_settings, NO_COMMANDS, around)
    gains, commands = split_columns(tuple(plan.gain_names.tolist()))
    columns = plan.gains[:, len(gains) :]
    times = np.arange(len(columns), dtype=np.float64) * plan.timing.tick
    names = tuple(name.removeprefix(COMMANDS) for name in commands)
    return UserLaw(
        plan_source(plan),
        plan.settings,
        CommandSteps(names, (times,) * len(names), tuple(columns.T)),
    )


def has_authority(vehicle: Vehicle, mission: Mission) -> bool:
    """Return whether control allocation has a solution at the start of the mission."""
    start = mission.start
    environment = make_environment(
        mission.make_earth(), start.altitude, start.latitude, mission.make_air()
    )

    def moment(deflections: Numbers) -> Numbers:
        zero = 0.0 * deflections[0]
        alpha = zero + _ALPHA_OF_AUTHORITY
        rates = (zero, zero, zero)
        mass = vehicle.constants.mass_start
        eta = zero + vehicle.constants.equivalence_ratio_min
        return wrench_at(
            vehicle, environment, mass, start.speed, alpha, zero, rates, deflections, eta
        ).moment

    return bool(np.linalg.cond(slope(moment, np.full(3, _ALPHA_OF_AUTHORITY))) < 1e12)


def _check_functions(vehicle: Vehicle, mission: Mission) -> None:
    """Raise InputError if a vehicle function is not finite at the start of the mission."""
    start = mission.start
    air = make_environment(mission.make_earth(), start.altitude, start.latitude, mission.make_air())
    variables = make_variables(
        vehicle,
        altitude=[start.altitude],
        mach=start.speed / air.sound_speed,
        angle_of_attack=_ALPHA_OF_AUTHORITY,
        equivalence_ratio=vehicle.constants.equivalence_ratio_min,
    )
    check_finite(vehicle, variables, air.density, start.speed)


def make_plan(
    vehicle: Vehicle,
    mission: Mission,
    controller: Controller,
    name: str,
    mission_file: str | Path | None = None,
    user_code: UserLaw | None = None,
) -> FlightPlan:
    """Make the flight plan of one controller, with warnings, for example about missing trim.

    Raise InputError with ``mission_file`` if the vehicle cannot be trimmed at any point of the
    mission.
    """
    sensing = choose_sensing(mission.sensing, vehicle.constants.sensing)
    vehicle = vehicle._replace(constants=vehicle.constants._replace(sensing=sensing))
    if user_code is not None:
        vehicle = drive_commanded(vehicle, user_code.source)
    mission = on_glide_path(mission, vehicle)
    timing = make_timing(mission, controller.rate)
    trim_tables = make_mission_trim_tables(mission, vehicle)
    reference, nominal = solve_reference(mission, vehicle, trim_tables, timing.tick, timing.ticks)
    warnings = trim_faults(nominal, reference[:, TIME])
    if nominal.status.all():
        raise InputError(
            mission_file or mission.name, "; ".join(warnings), "a mission that this vehicle can fly"
        )
    if not isinstance(controller, UserController):
        warnings += limit_faults(controller, reference)
    warnings += _find_warnings(vehicle)
    warnings += table_faults(vehicle, reference, timing.tick)
    warnings += mission.find_air_warnings(reference[:, ALTITUDE])
    dry_ticks = np.flatnonzero(reference[:, MASS] <= vehicle.constants.mass_empty + _LEAST_FUEL)
    if vehicle.constants.burns_fuel and dry_ticks.size:
        endurance = reference[dry_ticks[0], TIME]
        warnings.append(
            f"the fuel of the nominal flight lasts {endurance:.0f} s of {reference[-1, TIME]:.0f} s"
        )
    start, states, step_warnings = trim_start(mission, vehicle, timing.step)
    warnings += step_warnings
    if start.fault:
        warnings.append(f"at the start {start.fault}")
    names, gains, settings = make_gains(
        controller, user_code, DesignModel(vehicle, mission, reference, trim_tables)
    )
    constants = vehicle.constants
    loads = LoadBounds(*map(min, mission.limits.bounds(), constants.bounds))
    if loads.heat_flux < np.inf and constants.nose_radius == 0.0:
        raise InputError(
            mission_file or mission.name,
            "the heat flux has a limit, but the vehicle has no nose radius",
            "reference.nose_radius in the vehicle file",
        )
    return FlightPlan(
        controller=name,
        law=controller.law,
        vehicle=vehicle,
        trim_tables=trim_tables,
        effectiveness=make_effectiveness(vehicle),
        earth=mission.make_earth(),
        timing=timing,
        limits=Limits(
            max(mission.limits.altitude[0], constants.envelope.altitude_min),
            min(mission.limits.altitude[1], constants.envelope.altitude_max),
            angle_of_attack_min=constants.angle_of_attack_min,
            angle_of_attack_max=constants.angle_of_attack_max,
            sideslip_max=constants.sideslip_max,
            loads=loads,
            end=EndBounds(*(mission.end.range_of(name) for name in EndBounds._fields)),
            fuel_min=_LEAST_FUEL if mission.limits.fuel_out and constants.burns_fuel else -np.inf,
            speed_max=mission.limits.speed or _SPEED_FACTOR * float(reference[:, SPEED].max()),
            mach=constants.envelope[2:],
        ),
        initial_state=np.append(make_initial_state(mission, vehicle, start), states),
        reference=reference,
        gains=gains,
        settings=settings,
        profile=mission.stack_air(),
        warnings=np.array(warnings, np.str_),
        gain_names=np.array(names, np.str_),
        period=controller.period if isinstance(controller, UserController) else 0,
        around=user_code.around.law if user_code and user_code.around else "",
        filter_settings=user_code.settings if user_code and user_code.around else np.empty(0),
        source_hash=user_code.source.hash if user_code else "",
        source=user_code.source if user_code else None,
        vehicle_code=find_code(vehicle),
        declared=pack_metrics(
            effector_metrics(name_effectors(vehicle)) if constants.driven else ()
        ),
    )


def make_gains(
    controller: Controller, user_code: UserLaw | None, model: DesignModel
) -> tuple[tuple[str, ...], Floats, Floats]:
    """Return the gain names of a custom control law, gains [tick, gain] and settings.

    The names are empty for built-in control laws. Raise InputError if the design fails.
    """
    if isinstance(controller, TlcController):
        gains = make_tlc_gains(controller, model.table, model.vehicle, model.trim_tables)
        return (), gains, make_tlc_settings(controller, model.vehicle)
    if isinstance(controller, LqrController):
        gains = make_lqr_gains(
            controller, model.mission, model.table, model.vehicle, model.trim_tables
        )
        return (), gains, make_limit_settings(controller.limits, model.vehicle)
    if user_code is None:
        raise ValueError("the control law of a custom controller is missing")
    if user_code.around is not None:
        return make_gains(user_code.around, None, model)
    names, gains = watched_design(user_code.source, model, user_code.settings)
    gains = np.concatenate([gains, user_code.commands.columns(model.time)], axis=1)
    return (*names, *user_code.commands.column_names()), gains, user_code.settings


def limit_faults(controller: TlcController | LqrController, reference: Floats) -> list[str]:
    """Return a sentence for each nominal control that exceeds the controller's limits."""
    limits = controller.limits
    faults = []
    for quantity, column, low, high in (
        ("angle of attack", ANGLE_OF_ATTACK, *limits.angle_of_attack),
        ("bank", BANK, -limits.bank, limits.bank),
    ):
        nominal = reference[:, column]
        ticks = np.flatnonzero((nominal < low) | (nominal > high))
        if ticks.size:
            worst = np.rad2deg(nominal[ticks][np.argmax(np.abs(nominal[ticks]))])
            first = reference[ticks[0], TIME]
            faults.append(
                f"the mission requires {worst:.1f} deg of {quantity} at {first:.2f} s, beyond the "
                "controller's limit"
            )
    return faults


def table_faults(vehicle: Vehicle, reference: Floats, tick: float) -> list[str]:
    """Return a sentence for each variable outside tables or limits for a second or more."""
    column = dict(zip(REFERENCE, reference.T, strict=True))
    column["mach"] = column["speed"] / column["sound_speed"]
    faults = []
    for name in ("mach", "angle_of_attack", "elevator", "equivalence_ratio", "altitude", "mass"):
        low, high = valid_range(vehicle, name)
        slack = 1e-9 * (1.0 + np.abs(column[name]))
        outside = (column[name] < low - slack) | (column[name] > high + slack)
        if np.sum(outside) * tick >= _OUTSIDE:
            first = reference[np.flatnonzero(outside)[0], TIME]
            faults.append(
                f"the reference leaves the vehicle's tables or limits in {name.replace('_', ' ')} "
                f"for {np.sum(outside) * tick:.1f} s, first at {first:.2f} s; table values at the "
                "edge are used"
            )
    return faults


def make_timing(mission: Mission, rate: float) -> Timing:
    """Divide the control period 1 / rate (Hz) into equal integrator steps.

    The steps are at most as long as the mission's step.
    """
    tick = 1.0 / rate
    steps = max(1, int(np.ceil(tick / mission.step - 1e-9)))
    return Timing(tick / steps, steps, round(mission.duration * rate))


def trim_start(
    mission: Mission, vehicle: Vehicle, step: float = 0.0, rotating: bool = False
) -> tuple[TrimPoint, Floats, list[str]]:
    """Return the trim at the mission's start, the custom states, and warnings about the step (s).

    Raise InputError if custom dynamics have no equilibrium.
    """
    make_state = functools.partial(make_initial_state, mission, vehicle)
    find_trim = functools.partial(make_start_trim, mission, vehicle, rotating=rotating)
    return start_custom(mission, vehicle, make_state, find_trim, step)


def make_initial_state(mission: Mission, vehicle: Vehicle, trim: TrimPoint) -> Floats:
    """Return the state of trimmed steady flight, with actuators at rest.

    The body rotates with the local frame and, if banked, also at the turn rate.
    """
    start = mission.start
    x = np.zeros(s.N_STATES)
    x[s.ALTITUDE] = start.altitude
    x[s.LONGITUDE] = start.longitude
    x[s.LATITUDE] = start.latitude
    alpha = trim.angle_of_attack
    x[s.U] = start.speed * np.cos(alpha)
    x[s.W] = start.speed * np.sin(alpha)
    attitude = from_euler(start.heading, start.flight_path_angle + alpha, 0.0)
    if start.bank:
        # The bank is a rotation about the velocity, (cos alpha, 0, sin alpha) in body axes.
        half = 0.5 * start.bank
        turned = np.cos(half), np.sin(half) * np.cos(alpha), 0.0, np.sin(half) * np.sin(alpha)
        attitude = multiply(*attitude, *turned)
    x[s.Q0 : s.Q3 + 1] = attitude
    level = start.speed * np.cos(start.flight_path_angle)
    rate = local_frame_rate(
        mission.make_earth(),
        start.altitude,
        start.latitude,
        level * np.cos(start.heading),
        level * np.sin(start.heading),
    )
    x[s.ROLL_RATE : s.YAW_RATE + 1] = rotate_to_body(*attitude, *rate)
    if start.bank:
        lift = trim.load_factor * GRAVITY * np.sin(start.bank)
        x[s.ROLL_RATE : s.YAW_RATE + 1] += rotate_to_body(*attitude, 0.0, 0.0, lift / level)
    x[s.MASS] = vehicle.constants.mass_start
    x[s.ELEVATOR] = trim.elevator
    x[s.ETA] = trim.equivalence_ratio
    return x


def local_frame_rate(
    earth: Earth, altitude: float, latitude: float, v_north: float, v_east: float
) -> tuple[float, float, float]:
    """Return the inertial angular rate (rad/s) of the NED frame in NED components."""
    sine = np.sin(latitude)
    cosine = np.cos(latitude)
    *_, meridian, vertical = find_surroundings(earth, altitude, sine, cosine)
    longitude_rate = v_east / ((vertical + altitude) * cosine) + earth.rotation_rate
    return (
        float(longitude_rate * cosine),
        float(-v_north / (meridian + altitude)),
        float(-longitude_rate * sine),
    )
