"""Model passed to the ``design`` function of a control law, and the resulting gains."""

import functools
from collections import namedtuple
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Numbers
from abhv_mc.custom_code.child import in_child
from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.foreign_table import NumberTable, read_foreign_table
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.controller_file import LqrController
from abhv_mc_vehicle.control.design.design_model import (
    attitude_rates,
    body_rate_rates,
    slope,
    wrench_at,
)
from abhv_mc_vehicle.control.design.lqr_design import Nominal, make_lqr_gains, make_nominal
from abhv_mc_vehicle.control.mission import Mission
from abhv_mc_vehicle.kernel.laws.columns import LQR_GAINS, REFERENCE
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth
from abhv_mc_vehicle.user_code.law_interface import COMMAND_FIELDS, Measured, Reference
from abhv_mc_vehicle.user_code.load_law import load_law
from abhv_mc_vehicle.user_code.module import refuse_in_words, run_module
from abhv_mc_vehicle.user_code.unpack import in_its_folder, unpack, watching
from abhv_mc_vehicle.user_code.vehicle_functions import find_code, load_functions
from abhv_mc_vehicle.vehicle.vehicle_code import VehicleCode

STATES = Measured._fields[:10]  # altitude to yaw_rate
INPUTS = COMMAND_FIELDS[:4]  # aileron, rudder, elevator and equivalence_ratio


class LinearPlant(NamedTuple):
    """Linear plant ``x' = A x + B u`` for deviations from nominal, in SI units and radians."""

    A: Floats  # [state, state]
    B: Floats  # [state, input]
    states: tuple[str, ...]
    inputs: tuple[str, ...]

    def take(self, states: tuple[str, ...], inputs: tuple[str, ...]) -> tuple[Floats, Floats]:
        """Return A and B for a selection of states and inputs, in the order of the selection."""
        rows = [self.states.index(name) for name in states]
        columns = [self.inputs.index(name) for name in inputs]
        return self.A[np.ix_(rows, rows)], self.B[np.ix_(rows, columns)]


class Trim(NamedTuple):
    """Nominal controls at one time of the reference trajectory, in SI units and radians."""

    angle_of_attack: float
    bank: float
    equivalence_ratio: float
    elevator: float


class DesignModel:
    """Nominal vehicle along the mission, for the design of gains before a flight."""

    def __init__(
        self, vehicle: Vehicle, mission: Mission, reference: Floats, trim_tables: Tables
    ) -> None:
        self.vehicle = vehicle
        self.mission = mission
        self.trim_tables = trim_tables
        self.table = reference  # [tick, column], with the columns kernel.laws.columns.REFERENCE

    @property
    def earth(self) -> Earth:
        """Shape, gravity and rotation of the Earth."""
        return self.mission.make_earth()

    @functools.cached_property
    def reference(self) -> Any:
        """Reference along the mission; each quantity is an array [tick]."""
        return Reference(*self.table.T)

    @property
    def time(self) -> Floats:
        """Time of each control tick, s."""
        return self.table[:, REFERENCE.index("time")]

    def lqr_gains(self, weights: Mapping[str, Any]) -> Any:
        """Return the gains of the built-in LQR, a named tuple of arrays [tick].

        ``weights`` has the entries of a controller file with ``law: lqr``.
        """
        controller = LqrController(**weights)
        gains = make_lqr_gains(controller, self.mission, self.table, self.vehicle, self.trim_tables)
        return namedtuple("LqrGains", LQR_GAINS)(*gains.T)

    def trim(self, time: float) -> Trim:
        """Return the nominal controls at the control tick nearest to ``time`` (s)."""
        row = self.table[self._tick(time)]
        return Trim(*(float(row[REFERENCE.index(name)]) for name in Trim._fields))

    def linearize(self, time: float) -> LinearPlant:
        """Return the nominal vehicle linearized at the control tick nearest to ``time`` (s).

        The Earth is a nonrotating sphere. The vehicle flies the coordinated turn of the reference,
        and actuator dynamics are neglected.
        """
        nominal = make_nominal(self.mission, self.table[self._tick(time)])
        operating_point = [
            nominal.environment.altitude,
            nominal.speed,
            nominal.flight_path_angle,
            nominal.heading,
            nominal.angle_of_attack,
            0.0,
            nominal.bank,
            *nominal.turn_rates(),
            0.0,
            0.0,
            nominal.elevator,
            nominal.equivalence_ratio,
        ]
        J = slope(lambda x: _rates(self.vehicle, nominal, x), operating_point)
        return LinearPlant(J[:, : len(STATES)], J[:, len(STATES) :], STATES, INPUTS)

    def _tick(self, time: float) -> int:
        return int(np.argmin(np.abs(self.time - time)))


def _rates(vehicle: Vehicle, nominal: Nominal, x: Numbers) -> Numbers:
    """Return the time derivatives of STATES for values of STATES and INPUTS.

    The derivatives follow equations (1), (13) and (3) of the theory manual, with the full
    aerodynamic tables.
    """
    altitude, speed, gamma, chi, alpha, beta, bank = x[:7]
    environment = nominal.environment
    mass = nominal.mass
    rise = altitude - environment.altitude
    gravity = environment.gravity + environment.gravity_slope * rise
    local_air = environment._replace(
        density=environment.density + environment.density_slope * rise,
        sound_speed=environment.sound_speed + environment.sound_speed_slope * rise,
    )
    wrench = wrench_at(vehicle, local_air, mass, speed, alpha, beta, x[7:10], x[10:13], x[13])
    F = wrench.force
    sa = np.sin(alpha)
    ca = np.cos(alpha)
    sb = np.sin(beta)
    cb = np.cos(beta)
    along = F[0] * ca * cb + F[1] * sb + F[2] * sa * cb
    side = F[1] * cb - (F[0] * ca + F[2] * sa) * sb
    normal = F[0] * sa - F[2] * ca
    momentum = mass * speed
    radius = environment.radius + rise
    sg = np.sin(gamma)
    cg = np.cos(gamma)
    ss = np.sin(bank)
    cs = np.cos(bank)
    path = (normal * cs - side * ss) / momentum + (speed / radius - gravity / speed) * cg
    turn = (normal * ss + side * cs) / (momentum * cg) + speed / radius * cg * np.sin(chi) * np.tan(
        environment.latitude
    )
    angles = attitude_rates(F, mass, speed, gravity, gamma, x[4:7], x[7:10])
    rates = body_rate_rates(wrench.inertia, wrench.moment, x[7:10])
    return np.concatenate(
        [np.stack([speed * sg, along / mass - gravity * sg, path, turn]), angles, rates]
    )


def watched_design(
    source: UserSource, model: DesignModel, settings: Floats
) -> tuple[tuple[str, ...], Floats]:
    """Return the names and columns [tick, gain] of the gains designed for a control law.

    The design runs in the child process, which rejects reads of undeclared files. Raise InputError
    if the design fails.
    """
    recipe = source.recipe
    design: Any = load_law(source).design if recipe is None else recipe["design"]
    if design is None:
        return (), np.empty((len(model.table), 0))
    if recipe is not None and not design.endswith(".py"):
        return _read_gains(unpack(source) / design, model.time)
    return in_child(_design, source, model, settings, find_code(model.vehicle))


def _read_gains(path: Path, times: Floats) -> tuple[tuple[str, ...], Floats]:
    """Read gains from a CSV file and interpolate them linearly at ``times`` (s).

    Outside the times in the file, the gains are constant.
    """
    table = read_foreign_table(path)
    time = table.find(["time"]).get("time")
    indices = [i for i in range(len(table.heads)) if not time or i != time.position]
    if not time or not indices:
        raise table.error(
            None,
            None,
            "the table of gains has no times or no gains",
            "a column time_s and at least one column of gains",
        )
    own = NumberTable(
        table, {"time": time}, table.numbers([time.position]) * table.factor(time, "s")
    )
    own.check_rising("time", "s")
    columns = [np.interp(times, own.values[:, 0], gain) for gain in table.numbers(indices).T]
    return tuple(table.heads[i] for i in indices), np.ascontiguousarray(np.array(columns).T)


def _design(
    source: UserSource, model: DesignModel, settings: Floats, code: VehicleCode | None
) -> tuple[tuple[str, ...], Floats]:
    if code is not None:
        load_functions(code, model.vehicle)
    recipe = source.recipe
    numbers = iter(settings.tolist())
    if recipe is None:
        kind = load_law(source).settings
        settings_tuple = kind and kind(*numbers)
    else:  # The design function is in a Python file, which may read all declared files.
        root = source.file.removesuffix(source.files[0][0])
        files = {recipe["design"]: b"", **dict(source.files)}
        source = UserSource(
            files[recipe["design"]].decode(), f"{root}{recipe['design']}", tuple(files.items())
        )
        values = {
            name: tuple(islice(numbers, n)) if n else next(numbers)
            for name, n in recipe["settings"]
        }
        settings_tuple = namedtuple("Settings", values)(**values)
    ticks = len(model.table)
    file = source.file
    expected = f"design(model, settings) that returns a named tuple of numbers or arrays [{ticks}]"
    with in_its_folder(source), watching(source), refuse_in_words(source, "the design", expected):
        design = run_module(source).names["design"]
        designed = design(model, settings_tuple)
        line = design.__code__.co_firstlineno
        if not (isinstance(designed, tuple) and hasattr(designed, "_fields")):
            raise InputError(file, f"the design returns {type(designed).__name__}", expected, line)
        columns = np.empty((ticks, len(designed)))
        for i, (name, value) in enumerate(zip(designed._fields, designed, strict=True)):
            try:
                columns[:, i] = np.asarray(value, np.float64)
            except (TypeError, ValueError):
                raise InputError(
                    file,
                    f"the gain '{name}' has the shape {np.shape(value)}",
                    f"a number, or an array [{ticks}]",
                    line,
                ) from None
            if not np.isfinite(columns[:, i]).all():
                raise InputError(
                    file,
                    f"the gain '{name}' has a value that is not finite",
                    "finite numbers",
                    line,
                )
        return designed._fields, columns
