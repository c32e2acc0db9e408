"""Plant that is simulated step by step, with commands computed outside abhv-mc."""

import contextlib
import copy
import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from abhv_mc.array_types import Floats, Singles
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputError, check_names
from abhv_mc.requests import check_count
from abhv_mc.shipped import DEFAULT_VEHICLE
from abhv_mc_vehicle.flight.arguments import make_kernel_plan, make_results
from abhv_mc_vehicle.flight.fly import choose_flight, fly_until
from abhv_mc_vehicle.flight.user_law import open_law
from abhv_mc_vehicle.kernel.flight.interface import LANES, Z_ROWS, make_memory
from abhv_mc_vehicle.kernel.flight.observe import ALIVE
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.one_flight.fly_once import Input, store_text, write_inputs
from abhv_mc_vehicle.user_code.law_interface import Command, Measured
from abhv_mc_vehicle.user_code.plain_law import SOCKET
from abhv_mc_vehicle.vehicle.actuators import name_effectors
from abhv_mc_vehicle.vehicle_simulator.references import temporary_folder

if TYPE_CHECKING:
    import pandas as pd

_SURFACES = Command._fields[:3]
_ENGINE = ("equivalence_ratio", "throttle")
_MOMENTS = ("roll_moment", "pitch_moment", "yaw_moment")
_LAW = """\
from typing import NamedTuple

from abhv_mc.extend import Command, allocate, controller


class Settings(NamedTuple):
{fields}


@controller(dispersable={names})
def plant(settings{onboard}):
{allocation}    return Command({command})
"""
_ALLOCATION = """\
    moment, last = onboard.moment, onboard.last
    aileron, rudder, elevator = allocate(
        onboard, {} - moment.roll, {} - moment.pitch, {} - moment.yaw
    )
"""


class PlantState(NamedTuple):
    """State of a plant's flights at a control tick, before the commands of the tick.

    All arrays have the shape [flight].
    """

    time: float  # s
    # quantities that a control law receives at this tick, in SI units and radians, NaN for flights
    # that have ended; empty if not requested
    measured: dict[str, Floats]
    channels: dict[str, Singles]  # channels at this tick if the last commands are held
    # channels at the previous tick under its commands, as a campaign records them; empty after a
    # reset
    recorded: dict[str, Singles]
    outcome: NDArray[np.str_]  # codes of the outcomes, '' for flights that have not ended


class SavedPlant(NamedTuple):
    """Copy of the flights of a plant at a control tick."""

    tick: int
    rows: Floats
    outcome: NDArray[np.str_]
    metrics: Floats


class Plant:
    """Flights of the built-in vehicle that are advanced step by step with external commands.

    All effects are those of a campaign: tables, custom vehicles and states, wind, sensors, failures
    and limits. A control law outside the plant gives the same flights, bit for bit, as the law in a
    campaign. Angles are in radians, other quantities in SI units, except channels.

    Parameters
    ----------
    mission, vehicle
        Shipped name, path or mapping, see :func:`abhv_mc.fly`.
    flights
        Number of flights.
    dispersions
        Dispersions as in a campaign file; ``seed`` determines the samples.
    rows
        Table with a row for each flight and a column for each parameter that is not nominal, in SI
        units. It replaces ``flights`` and ``dispersions``.
    seed
        Seed of the samples.
    commands
        Names of the commands: ``aileron``, ``rudder``, ``elevator``; or names of effectors; or
        ``roll_moment``, ``pitch_moment``, ``yaw_moment`` (N m about the centre of gravity), which
        are allocated to the surfaces; ``equivalence_ratio`` or ``throttle``; and optionally
        ``flight_path_angle``, ``angle_of_attack`` and ``bank``, from which errors are computed.
    channels
        Names of the returned channels; all by default.
    rate
        Control rate.

    Attributes
    ----------
    nominal
        Commands [command] at the trimmed start.
    period, duration
        Control period and duration of the mission, s.
    metrics
        Metrics [flight] by name; NaN for flights that have not ended.

    Raises
    ------
    InputError
        If an input is invalid.

    Examples
    --------
    >>> plant = abhv_mc.Plant("level", flights=2)
    >>> state = plant.step(plant.nominal, ticks=10)
    >>> state.time, state.measured["altitude"].shape
    (0.1, (2,))
    """

    def __init__(
        self,
        mission: Input,
        vehicle: Input = DEFAULT_VEHICLE,
        *,
        flights: int = 1,
        dispersions: Mapping[str, Any] | None = None,
        rows: "pd.DataFrame | None" = None,
        seed: int = 0,
        commands: Sequence[str] = (*_SURFACES, "equivalence_ratio"),
        channels: Sequence[str] | None = None,
        rate: str = "100 Hz",
    ) -> None:
        if rows is not None and dispersions:
            raise InputError("Plant", "both rows and dispersions", "one of them")
        self.commands = tuple(commands)
        study = {"name": "plant", "mission": mission, "vehicle": vehicle, "seed": seed}
        study |= {"controllers": {"plant": _make_law(self.commands, rate)}}
        if rows is None:
            study |= {"runs": flights, "dispersions": dict(dispersions or {})}
        else:
            table = store_text("rows.csv", rows.to_csv(index=False))
            study["sampling"] = {"design": "file", "path": str(table)}
        self._experiment = read_campaign(
            write_inputs(study, temporary_folder() / f"plant_{id(self)}")
        )
        self.flights = self._experiment.runs
        self._plan = self._experiment.simulator.make_plans(["plant"])["plant"]
        names = tuple(channel.name for channel in self._plan.channels)
        self.channels = names if channels is None else tuple(channels)
        check_names("channels", self.channels, names)
        self.period, self.duration = self._plan.timing.tick, self._plan.timing.duration
        self.nominal = self._find_nominal()
        self._recording = Recording(1, tuple(map(names.index, self.channels)))
        foreign = self._plan.vehicle.foreign
        first = s.SETTING + foreign.settings.size + foreign.states
        self._columns = slice(first, first + len(self.commands))  # commands in the lane memory
        self._memory = make_memory(LANES)
        self._opened = contextlib.ExitStack()
        code = self._opened.enter_context(
            open_law(self._plan, LANES, True, self.flights, dispersed=True)
        )
        # Also compute the measurements that only some control laws read.
        self._code = code._replace(more=2)
        self._pass_commands = SOCKET(code.address)
        self._capture = SOCKET(self._capture_lanes)
        self._seen = np.empty((-(-self.flights // LANES), s.N_SEEN, LANES))
        two_samples = replace(self._plan, timing=self._plan.timing._replace(ticks=1))
        self._results = make_results(two_samples, self.flights, self._recording, False)
        self.reset(seed)

    def reset(self, seed: int | None = None) -> PlantState:
        """Return all flights to the start of the mission.

        Parameters
        ----------
        seed
            Seed of new samples; by default, the samples are unchanged.

        Returns
        -------
        PlantState
        """
        if seed is not None:
            model = self._experiment.model.model_copy(update={"seed": seed})
            experiment = replace(self._experiment, model=model)
            rows = experiment.make_samples().draw(0, self.flights)
            experiment.simulator.fit_plans({"plant": self._plan}, experiment.inputs, rows)
            self._parameters = experiment.rows(rows)
            self._kernel_plan = make_kernel_plan(self._plan, self._parameters, self._recording)
        self._tick, self._rows = fly_until(self._plan, self._parameters, 0)
        self._rows[:, self._columns] = self.nominal
        self._outcome = np.full(self.flights, "", "<U24")
        self._metrics = np.full((self.flights, len(self._plan.metrics)), np.nan)
        return self._observe({}, True)

    def step(
        self, commands: ArrayLike | Mapping[str, ArrayLike], ticks: int = 1, observe: bool = True
    ) -> PlantState:
        """Advance all flights with constant commands.

        Parameters
        ----------
        commands
            Array [flight, command] or [command] in the order of ``commands``, or values by name;
            commands that a mapping does not contain keep their last value.
        ticks
            Number of control ticks. The last step of a flight contains the tick at the end of the
            mission.
        observe
            Whether to compute ``measured`` and ``channels``, which takes one more tick.

        Returns
        -------
        PlantState

        Raises
        ------
        InputError
            If the commands have unknown names, wrong shapes or values that are not finite, or if
            the mission has ended.
        """
        end = self._plan.timing.ticks
        if self._tick > end:
            raise InputError("step", "the mission has ended", "reset() or restore() before step()")
        self._rows[:, self._columns] = self._conform(commands)
        last = self._tick + check_count(ticks, 1, "ticks") - 1
        last, saves = min(last, end), last < end
        recorded = self._run(last, saves, self._code.address)
        results = self._results
        # At the last tick of the mission, all flights end.
        ended = (self._outcome == "") & ((self._rows[:, Z_ROWS + ALIVE] == 0.0) | (not saves))
        self._outcome[ended] = [Outcome(code).code for code in results.outcome[ended].tolist()]
        self._metrics[ended] = results.metrics[ended]
        self._tick = last + 1
        return self._observe(recorded, observe)

    def save(self) -> SavedPlant:
        """Return a copy of the flights for :meth:`restore`."""
        return copy.deepcopy(SavedPlant(self._tick, self._rows, self._outcome, self._metrics))

    def restore(self, saved: SavedPlant) -> PlantState:
        """Return all flights to the state at which they were saved."""
        self._tick, self._rows, self._outcome, self._metrics = copy.deepcopy(saved)
        return self._observe({}, True)

    @property
    def reference(self) -> dict[str, Floats]:
        """Reference of the mission [tick] by name, as a control law receives it."""
        return dict(zip(REFERENCE, self._plan.reference.T, strict=True))

    @property
    def metrics(self) -> dict[str, Floats]:
        """Metrics [flight] by name; NaN for flights that have not ended."""
        return {
            m.name: column for m, column in zip(self._plan.metrics, self._metrics.T, strict=True)
        }

    def _find_nominal(self) -> Floats:
        plan = self._plan
        axes, eta = plan.initial_state[s.AILERON : s.ELEVATOR + 1], plan.initial_state[s.ETA]
        names = (*REFERENCE, *name_effectors(plan.vehicle), *_SURFACES, *_ENGINE)
        numbers = (*plan.reference[0], *plan.vehicle.effectors.mix @ axes, *axes, eta, eta)
        values = dict(zip(names, numbers, strict=True))
        return np.array([values.get(name, 0.0) for name in self.commands], np.float64)

    def _conform(self, commands: ArrayLike | Mapping[str, ArrayLike]) -> Floats:
        """Return commands [flight, command]."""
        values = self._rows[:, self._columns].copy()
        try:
            if not isinstance(commands, Mapping):
                columns = np.asarray(commands, np.float64).T
                commands = dict(zip(self.commands, columns, strict=True))
            check_names("commands", tuple(commands), self.commands)
            for name, column in commands.items():
                values[:, self.commands.index(name)] = column
            if not np.isfinite(values).all():
                raise ValueError
        except (TypeError, ValueError):
            expected = f"finite numbers of shape {values.shape} or {values.shape[1:]}"
            raise InputError("commands", f"found {commands!r:.80}", expected) from None
        return values

    def _run(self, last: int, saves: bool, address: int) -> dict[str, Singles]:
        """Simulate the control ticks up to ``last``; return the channels of this tick.

        If ``saves`` is true, the flights are saved for the next tick; otherwise, they end.
        """
        plan = self._kernel_plan
        results = self._results
        every = max(last, 1)  # The histories have the samples of tick 0 and of the last tick.
        plan = plan._replace(
            timing=plan.timing._replace(ticks=last + saves),
            record_every=every,
            first_tick=self._tick,
            start=self._rows,
            user_code=self._code._replace(address=address),
        )
        if saves:  # A flight's row is read before it is written.
            results = results._replace(saved=self._rows)
        results.history[:] = np.nan
        choose_flight(LANES, False)(plan, self._memory, results)
        return dict(zip(self.channels, results.history[:, last // every].T.copy(), strict=True))

    def _observe(self, recorded: dict[str, Singles], observe: bool) -> PlantState:
        """Return the state at the current tick; the flights are not changed."""
        end = self._plan.timing.ticks
        time = min(self._tick, end) * self.period
        measured = {}
        channels = recorded if self._tick > end else {}
        if observe and self._tick <= end:
            self._group = 0
            address = ctypes.cast(self._capture, ctypes.c_void_p).value or 0
            channels = self._run(self._tick, False, address)
            seen = self._seen.swapaxes(0, 1).reshape(s.N_SEEN, -1)[:, : self.flights]
            values = np.where(self._outcome == "", seen, np.nan)
            measured = dict(zip(Measured._fields, values, strict=True))
        return PlantState(time, measured, channels, recorded, self._outcome.copy())

    def _capture_lanes(self, *arguments: Any) -> None:
        """Store the measurements of a group of lanes, and pass the commands to the vehicle.

        The kernel simulates the groups in the order of the flights.
        """
        self._seen[self._group] = self._memory.Z[s.MEASURED : s.COUNTED]
        self._group += 1
        self._pass_commands(*arguments)


def _make_law(commands: tuple[str, ...], rate: str) -> dict[str, Any]:
    """Return the content of a controller file for a law whose settings are its commands."""
    settings = {name: f"settings.{name}" for name in commands}
    values = dict.fromkeys(_SURFACES, "0.0") | settings
    moments = [values.pop(name, "0.0") for name in _MOMENTS]
    allocation = ""
    if moments != ["0.0"] * 3:
        allocation = _ALLOCATION.format(*moments)
        values |= {name: f"last.{name} + {name}" for name in _SURFACES}
    effectors = [name for name in values if name not in Command._fields]
    if effectors:
        entries = (f"{name!r}: {values.pop(name)}" for name in effectors)
        values["effectors"] = f"{{{', '.join(entries)}}}"
    text = _LAW.format(
        fields="\n".join(f"    {name}: float" for name in commands),
        names=commands,
        onboard=", onboard" * bool(allocation),
        allocation=allocation,
        command=", ".join(f"{name}={value}" for name, value in values.items()),
    )
    file = str(store_text("plant.py", text))
    return {"law": "python", "file": file, "rate": rate, "settings": dict.fromkeys(commands, 0.0)}
