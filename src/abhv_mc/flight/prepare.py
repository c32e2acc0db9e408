"""From the three files of a flight to its plan: reference, gains, trim and start, computed once."""

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Numbers
from abhv_mc.control.controller_file import (
    Controller,
    LqrController,
    TlcController,
    read_controller_document,
)
from abhv_mc.control.design.design_model import make_environment, slope, wrench_at
from abhv_mc.control.design.guidance_trim import trim_faults
from abhv_mc.control.design.kept import kept
from abhv_mc.control.design.lqr_design import make_lqr_gains
from abhv_mc.control.design.reference import (
    make_mission_trim_tables,
    make_start_trim,
    on_glide_path,
    solve_reference,
)
from abhv_mc.control.design.tlc_design import make_limit_settings, make_tlc_gains, make_tlc_settings
from abhv_mc.control.law_file import (
    USER_LAWS,
    CController,
    FmuController,
    PythonController,
    UserController,
)
from abhv_mc.control.mission import Mission, read_mission
from abhv_mc.flight.dynamics_start import start_custom
from abhv_mc.flight.metrics import effector_metrics, pack_metrics
from abhv_mc.flight.native_check import check_native
from abhv_mc.flight.outcome import EndBounds, Limits
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.user_law import NATIVE, open_law, plan_source, refuse_misfits
from abhv_mc.io.documents import InputError
from abhv_mc.kernel.flight.interface import LANES, Timing
from abhv_mc.kernel.flight.start import multiply
from abhv_mc.kernel.laws.columns import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    BANK,
    MASS,
    REFERENCE,
    SPEED,
    TIME,
)
from abhv_mc.kernel.numerics.quaternion import from_euler, rotate_to_body
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.vehicle import VARIABLES, Vehicle
from abhv_mc.kernel.world.earth import Earth, radii
from abhv_mc.plant.effectiveness import make_effectiveness
from abhv_mc.plant.trim import GRAVITY, TrimPoint
from abhv_mc.user_code.compiled import COMMANDS, split_columns
from abhv_mc.user_code.design import DesignModel, watched_design
from abhv_mc.user_code.effector_commands import drive_commanded
from abhv_mc.user_code.law_source import check_wiring, read_trusted_law
from abhv_mc.user_code.load_law import load_law
from abhv_mc.user_code.module import check_closure
from abhv_mc.user_code.settings import NO_COMMANDS, CommandSteps, make_commands, make_user_settings
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.vehicle_functions import find_code, load_vehicle
from abhv_mc.vehicle.actuators import name_effectors
from abhv_mc.vehicle.shared_keys import choose_sensing, tighter
from abhv_mc.vehicle.warnings import find_vehicle_warnings

_find_warnings = kept(find_vehicle_warnings)  # the controllers of a campaign share their vehicle
_LEAST_FUEL = 1e-9  # kg: below it there is none
_SPEED_FACTOR = 2.0  # on the reference's largest speed: the default limit
_OUTSIDE = 1.0  # s of the reference outside the vehicle's tables, of which to warn
_ALPHA_OF_AUTHORITY = np.deg2rad(1.2)  # a small angle inside of most tables' cells


def prepare(vehicle: Path, mission: Path, controller: Path, name: str) -> FlightPlan:
    """Read the three files and compute the plan. Raises :class:`abhv_mc.io.documents.InputError`."""
    packed = load_vehicle(vehicle)
    asked = read_mission(mission)
    law, user_code = read_law(controller)
    glides = packed.constants.equivalence_ratio_max == 0.0
    if packed.constants.surface_limit == 0.0 or (glides and user_code is None):
        found = "a vehicle without control surfaces or engine"
        expected = (
            "one with both, to fly a mission with this controller (a law of your own flies "
            "one without an engine)"
        )
        raise InputError(vehicle, found, expected)
    if isinstance(law, TlcController) and not has_authority(packed, asked):
        found = "deflections that do not turn the vehicle about three axes"
        raise InputError(vehicle, found, "aileron, rudder and elevator with moments of their own")
    try:
        plan = make_plan(packed, asked, law, name, mission, user_code)
    except np.linalg.LinAlgError as error:
        found = (
            f"a mission along which {law.law} has no gains for this vehicle ({str(error).lower()})"
        )
        expected = "one where the controls rule the flight"
        raise InputError(mission, found, expected) from None
    if plan.law in NATIVE:
        check_native(plan)
        return plan
    with open_law(plan, LANES):  # compiled now, before anything is written
        return plan


class UserParts(NamedTuple):
    """A law of the user's own, its settings and its commands."""

    source: UserSource
    settings: Floats
    commands: CommandSteps = NO_COMMANDS
    around: TlcController | LqrController | None = None  # whose measurement the code filters


def read_law(controller: Path) -> tuple[Controller, UserParts | None]:
    """A controller file and, where it names a law of the user's own, that law: its code is run. Raises InputError."""
    document, law = read_controller_document(controller)
    if not isinstance(law, UserController):
        return law, None
    if isinstance(law, FmuController):
        check_wiring(document, law)
    source = read_trusted_law(law)
    if not isinstance(law, PythonController):
        refuse_misfits(document, law.law, source)
        numbers = law.numbers if isinstance(law, CController) else []
        return law, UserParts(source, np.array(numbers, dtype=np.float64))
    check_closure(source)
    loaded = load_law(source)
    around = read_around(law)
    if loaded.mark.filters != (around is not None):
        found = (
            "a filter without the controller around it" if around is None else "'around' of a law"
        )
        wish = "'around:', a controller file of TLC or LQR, with @measurement_filter"
        raise document.error(("file",) if around is None else ("around",), found, wish)
    if around is not None:
        law = law.model_copy(update={"rate": around.rate})
    commands = make_commands(document, law, loaded)
    return law, UserParts(source, make_user_settings(document, law, loaded), commands, around)


def read_around(law: PythonController) -> TlcController | LqrController | None:
    """Read the controller whose measurement a law filters; None for a law that commands. Raise InputError."""
    if law.around is None:
        return None
    document, around = read_controller_document(law.around)
    if isinstance(around, UserController):
        raise document.error(("law",), f"'{around.law}' with a filter", "tlc or lqr")
    return around


def user_parts_of(plan: FlightPlan, controller: Controller) -> UserParts | None:
    """A plan's own law and its settings; None for a law of the program. Raises ValueError without its source."""
    if plan.law not in USER_LAWS:
        return None
    if isinstance(controller, PythonController) and controller.around is not None:
        around = read_around(controller)
        return UserParts(plan_source(plan), plan.filter_settings, NO_COMMANDS, around)
    gains, commands = split_columns(tuple(plan.gain_names.tolist()))
    columns = plan.gains[:, len(gains) :]
    times = np.arange(len(columns), dtype=np.float64) * plan.timing.tick
    names = tuple(name.removeprefix(COMMANDS) for name in commands)
    return UserParts(
        plan_source(plan),
        plan.settings,
        CommandSteps(names, (times,) * len(names), tuple(columns.T)),
    )


def has_authority(vehicle: Vehicle, mission: Mission) -> bool:
    """Whether the deflections' moments at the start can be solved for the deflections, as control allocation does."""
    start = mission.start
    around = make_environment(
        mission.make_earth(), start.altitude, start.latitude, mission.make_air()
    )

    def moment(deflections: Numbers) -> Numbers:
        nothing = 0.0 * deflections[0]
        alpha, rates = nothing + _ALPHA_OF_AUTHORITY, (nothing, nothing, nothing)
        mass, eta = vehicle.constants.mass_start, nothing + vehicle.constants.equivalence_ratio_min
        return wrench_at(
            vehicle, around, mass, start.speed, alpha, nothing, rates, deflections, eta
        ).moment

    return bool(np.linalg.cond(slope(moment, np.full(3, _ALPHA_OF_AUTHORITY))) < 1e12)


def make_plan(
    vehicle: Vehicle,
    mission: Mission,
    controller: Controller,
    name: str,
    mission_file: str | Path | None = None,
    user_code: UserParts | None = None,
) -> FlightPlan:
    """The plan of one controller's flights; its warnings say where nominal controls do not fly the mission.

    Raises InputError, which names ``mission_file``, for a mission that they do not fly at any time.
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
        expected = "a mission that this vehicle can fly"
        raise InputError(mission_file or mission.name, "; ".join(warnings), expected)
    if not isinstance(controller, UserController):
        warnings += limit_faults(controller, reference)
    warnings += _find_warnings(vehicle)
    warnings += table_faults(vehicle, reference, timing.tick)
    warnings += mission.find_air_warnings(reference[:, ALTITUDE])
    dry = np.flatnonzero(reference[:, MASS] <= vehicle.constants.mass_empty + _LEAST_FUEL)
    if vehicle.constants.burns_fuel and dry.size:
        lasts = reference[dry[0], TIME]
        warnings.append(
            f"the nominal fuel lasts {lasts:.0f} s of the mission's {reference[-1, TIME]:.0f} s"
        )
    rigid = make_start_trim(mission, vehicle)
    make_state = functools.partial(make_initial_state, mission, vehicle)
    start, states, slow = start_custom(mission, vehicle, make_state, rigid, timing.step)
    warnings += slow
    if start.fault:
        warnings.append(f"at the start {start.fault}")
    names, gains, settings = make_gains(
        controller, user_code, DesignModel(vehicle, mission, reference, trim_tables)
    )
    constants = vehicle.constants
    loads = tighter(mission.limits.bounds(), constants.bounds)
    if loads.heat_flux < np.inf and constants.nose_radius == 0.0:
        found = "a limit on the heat flux for a vehicle whose file gives no nose radius"
        raise InputError(
            mission_file or mission.name, found, "reference.nose_radius in the vehicle's file"
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
            *mission.limits.altitude,
            constants.angle_of_attack_min,
            constants.angle_of_attack_max,
            constants.sideslip_max,
            loads,
            EndBounds(*(mission.end.range_of(name) for name in EndBounds._fields)),
            _LEAST_FUEL if mission.limits.fuel_out and constants.burns_fuel else -np.inf,
            mission.limits.speed or _SPEED_FACTOR * float(reference[:, SPEED].max()),
        ),
        initial_state=np.append(make_state(start), states),
        reference=reference,
        gains=gains,
        settings=settings,
        profile=mission.make_air(),
        warnings=np.array(warnings, dtype=np.str_),
        gain_names=np.array(names, dtype=np.str_),
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
    controller: Controller, user_code: UserParts | None, model: DesignModel
) -> tuple[tuple[str, ...], Floats, Floats]:
    """Names, if the law is a user's, gains [tick, gain] along the model's reference, settings. Raises InputError."""
    if isinstance(controller, TlcController):
        gains = make_tlc_gains(controller, model.table, model.vehicle, model.trim_tables)
        return (), gains, make_tlc_settings(controller, model.vehicle)
    if isinstance(controller, LqrController):
        gains = make_lqr_gains(
            controller, model.mission, model.table, model.vehicle, model.trim_tables
        )
        return (), gains, make_limit_settings(controller.limits, model.vehicle)
    if user_code is None:
        raise ValueError("a controller of the user's own without its law")
    if user_code.around is not None:
        return make_gains(user_code.around, None, model)
    names, gains = watched_design(user_code.source, model, user_code.settings)
    gains = np.concatenate([gains, user_code.commands.columns(model.time)], axis=1)
    return (*names, *user_code.commands.column_names()), gains, user_code.settings


def limit_faults(controller: TlcController | LqrController, reference: Floats) -> list[str]:
    """A sentence for each nominal control that is beyond what the controller may command."""
    limits = controller.limits
    faults = []
    for words, column, low, high in (
        ("angle of attack", ANGLE_OF_ATTACK, *limits.angle_of_attack),
        ("bank", BANK, -limits.bank, limits.bank),
    ):
        nominal = reference[:, column]
        where = np.flatnonzero((nominal < low) | (nominal > high))
        if where.size:
            worst = np.rad2deg(nominal[where][np.argmax(np.abs(nominal[where]))])
            first = reference[where[0], TIME]
            faults.append(
                f"the mission takes {worst:.1f} deg of {words}, which the controller limits, at {first:.2f} s"
            )
    return faults


def table_faults(vehicle: Vehicle, reference: Floats, tick: float) -> list[str]:
    """Return a sentence for each variable that is outside its tables along the reference for a second or more."""
    column = dict(zip(REFERENCE, reference.T, strict=True))
    column["mach"] = column["speed"] / column["sound_speed"]
    faults = []
    tables = vehicle.tables
    for name in ("mach", "angle_of_attack", "elevator", "equivalence_ratio", "altitude", "mass"):
        low, high = -np.inf, np.inf
        for axis in np.flatnonzero(tables.axis_variable == VARIABLES.index(name)):
            grid = tables.grid[tables.axis_start[axis] :][: tables.axis_length[axis]]
            low, high = max(low, grid[0]), min(high, grid[-1])
        slack = 1e-9 * (1.0 + np.abs(column[name]))
        outside = (column[name] < low - slack) | (column[name] > high + slack)
        if np.sum(outside) * tick >= _OUTSIDE:
            first = reference[np.flatnonzero(outside)[0], TIME]
            faults.append(
                f"the reference leaves the vehicle's tables in {name.replace('_', ' ')} for "
                f"{np.sum(outside) * tick:.1f} s, first at {first:.2f} s: the values of the edge are used there"
            )
    return faults


def make_timing(mission: Mission, rate: float) -> Timing:
    """Whole integrator steps in a control period of 1 / rate (Hz); at most the mission's step."""
    tick = 1.0 / rate
    steps = max(1, int(np.ceil(tick / mission.step - 1e-9)))
    return Timing(tick / steps, steps, round(mission.duration * rate))


def make_initial_state(mission: Mission, vehicle: Vehicle, trim: TrimPoint) -> Floats:
    """Steady flight in trim, the body turning with the local frame and, in a bank, with the turn; actuators at rest."""
    start = mission.start
    x = np.zeros(s.N_STATES)
    x[s.ALTITUDE], x[s.LONGITUDE], x[s.LATITUDE] = start.altitude, start.longitude, start.latitude
    alpha = trim.angle_of_attack
    x[s.U], x[s.W] = start.speed * np.cos(alpha), start.speed * np.sin(alpha)
    attitude = from_euler(start.heading, start.flight_path_angle + alpha, 0.0)
    if start.bank:
        half = (
            0.5 * start.bank
        )  # about the velocity, which in body axes is (cos alpha, 0, sin alpha)
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
    x[s.ELEVATOR], x[s.ETA] = trim.elevator, trim.equivalence_ratio
    return x


def local_frame_rate(
    earth: Earth, altitude: float, latitude: float, v_north: float, v_east: float
) -> tuple[float, float, float]:
    """Inertial rate of the local NED frame under a flight, NED components, rad/s."""
    meridian, vertical = radii(earth, float(np.sin(latitude)))
    longitude_rate = v_east / ((vertical + altitude) * np.cos(latitude)) + earth.rotation_rate
    return (
        float(longitude_rate * np.cos(latitude)),
        -v_north / (meridian + altitude),
        float(-longitude_rate * np.sin(latitude)),
    )
