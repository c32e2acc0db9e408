"""Built-in simulator of a vehicle on a mission with several controllers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.config import PROCESSES, THREADS
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.custom_code.source import UserSource
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import OUTCOMES, Outcome
from abhv_mc.flights.signals import Signal
from abhv_mc.identity import code_hash, count_cores
from abhv_mc.interfaces import (
    FEW_FLIGHTS,
    Engine,
    Recorded,
    Simulator,
    StoredPlans,
    TrimMargins,
)
from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.channels import REFERENCE_CHANNELS, all_channels
from abhv_mc_vehicle.flight.plan import FlightPlan

# Number of workers up to which threads cost less than worker processes for any number of flights.
_MOST_THREADS = 4
_EXCHANGE = 1e-4  # assumed time in s of a control tick of a law in a program


class VehicleSimulator(Simulator):
    """Built-in simulator, which trims the vehicle, designs controllers and runs kernels."""

    kind = "controller"
    reference_channels: tuple[Signal, ...] = REFERENCE_CHANNELS
    method = (
        "Method: G. D. Zhu and Z. J. Shen, three-dimensional trajectory linearization control of"
        " an air-breathing hypersonic vehicle, 2014."
    )

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.outcomes = OUTCOMES
        self.systems, self.mission = tuple(experiment.model.controllers), self
        contents = experiment.contents
        self.channels = all_channels(contents.effectors, contents.states)

    @cached_property
    def engine(self) -> Engine:
        if self.experiment.engine is not None:
            return self.experiment.engine
        engine = make_engine()
        return engine if self._needs_processes() else replace(engine, isolation=THREADS)

    def _needs_processes(self) -> bool:
        execution = self.experiment.model.execution
        is_large = self.experiment.runs * len(self.systems) > FEW_FLIGHTS
        has_many = (execution.workers or count_cores()) > _MOST_THREADS
        has_limit = execution.flight_time_limit is not None
        return (is_large and has_many) or has_limit or bool(self.find_code())

    def check(self, feature: str) -> None:
        pass

    def find_code(self) -> list[tuple[Path, UserSource]]:
        from abhv_mc_vehicle.vehicle_simulator.stored_plans import find_campaign_code

        return find_campaign_code(self.experiment.model)

    def pack(self, take: Callable[..., str], copies: dict[str, Path]) -> dict[str, Any]:
        from abhv_mc.campaign.file.kinds import locate
        from abhv_mc_vehicle.vehicle_simulator.references import find_references

        model = self.experiment.model

        def pack(path: Path, location: str) -> str:
            return take(path, f"inputs/{location}", find_references(locate(path)))

        entries: dict[str, Any] = {
            "vehicle": pack(model.vehicle, "vehicle"),
            "mission": pack(model.mission, "mission"),
            "controllers": {
                name: pack(path, f"controllers/{name}") for name, path in model.controllers.items()
            },
        }
        if model.channels is not None:
            entries["channels"] = pack(model.channels, "channels")
        if isinstance(model.metrics, Path):
            entries["metrics"] = read_document(model.metrics).data
        return entries

    @staticmethod
    def fly(plan: FlightPlan, rows: Floats, recorded: Recorded = None) -> FlightBlock:
        from abhv_mc_vehicle.stability.fly_with_margins import fly_with_margins

        return fly_with_margins(plan, rows, recorded)

    def make_plans(self, names: Sequence[str]) -> dict[str, FlightPlan]:
        from abhv_mc_vehicle.vehicle_simulator.make_plans import make_plans

        return make_plans(self.experiment, names, self.engine.prepare)

    def restore_plans(
        self, stored: StoredPlans, names: Sequence[str], trusted: bool = False
    ) -> dict[str, FlightPlan]:
        from abhv_mc_vehicle.vehicle_simulator.stored_plans import read_trusted_plan

        return {name: read_trusted_plan(stored, self.experiment, name, trusted) for name in names}

    def add_margins(self, plans: Mapping[str, FlightPlan]) -> Mapping[str, FlightPlan]:
        from abhv_mc_vehicle.vehicle_simulator.corner_margins import make_margin_plans

        return make_margin_plans(self.experiment, plans)

    def fit_plans(
        self, plans: Mapping[str, FlightPlan], names: Sequence[str], rows: Floats
    ) -> dict[str, FlightPlan]:
        from abhv_mc.campaign.sampling.samples import full_rows
        from abhv_mc_vehicle.vehicle_simulator.make_plans import check_rows

        varied = {*self.experiment.names, *names}
        derived = self.experiment.derived
        parameters = self.experiment.parameters
        for plan in plans.values():
            check_rows(plan, full_rows(names, rows, derived, parameters))
        return {name: plan.lean_for(varied) for name, plan in plans.items()}

    def find_stride(self, plan: FlightPlan, output: str) -> int:
        document = self.experiment.document
        rate = getattr(self.experiment.model.keep, output).rate
        ticks = 1.0 / (rate * plan.timing.tick)
        every = round(ticks)
        if every < 1 or abs(ticks - every) > 1e-9 * ticks:
            control = f"the control rate of {1.0 / plan.timing.tick:g} Hz"
            raise document.error(
                ("keep", output, "rate"),
                f"the rate of {rate:g} Hz (keep.{output}.rate) does not divide {control}",
                "a divisor of the control rate",
            )
        return every

    def find_warnings(self, plans: Mapping[str, FlightPlan]) -> list[str]:
        from abhv_mc_vehicle.vehicle_simulator.make_plans import find_warnings

        return find_warnings(plans, self.experiment)

    def find_reference(self, plan: FlightPlan) -> dict[str, Floats]:
        from abhv_mc_vehicle.vehicle_simulator.make_plans import reference_of

        return reference_of(plan, self.find_stride(plan, "histories"))

    def find_transients(self) -> tuple[tuple[float, float], ...]:
        from abhv_mc_vehicle.control.design.reference import transients
        from abhv_mc_vehicle.control.mission import read_mission

        return transients(read_mission(self.experiment.model.mission))

    def time_of_flight(self, plans: Sequence[FlightPlan]) -> float | None:
        ticks = (plan.timing.ticks for plan in plans if plan.law == "process")
        return max((_EXCHANGE * number for number in ticks), default=None)

    def find_compiler(self) -> str:
        from abhv_mc_vehicle.kernel.jit import (
            compiler,  # Import late, because the module loads numba.
        )

        return compiler()

    def trim_margins(self, names: Sequence[str]) -> dict[str, TrimMargins]:
        from abhv_mc_vehicle.vehicle_simulator.corner_margins import trim_margins

        return trim_margins(self.experiment, names)

    def describe_end(self, system: str, row: Floats, outcome: int) -> str:
        from abhv_mc_vehicle.vehicle_simulator.make_plans import describe_end

        plan: Any = self.experiment.systems[system].plan
        return describe_end(plan, self.experiment.rows(row), Outcome(outcome))

    def find_lacking(self) -> list[InputError]:
        from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
        from abhv_mc_vehicle.vehicle_simulator.make_plans import find_lacking

        return find_lacking(self.experiment, load_vehicle(self.experiment.model.vehicle))


def make_engine() -> Engine:
    """Return the engine that prepares and runs compiled flights."""
    from abhv_mc_vehicle.flight.fly import describe_last_tick
    from abhv_mc_vehicle.flight.prepare import prepare
    from abhv_mc_vehicle.stability.fly_with_margins import fly_with_margins
    from abhv_mc_vehicle.vehicle_simulator.corner_margins import describe_stability, is_compiled

    return Engine(
        prepare,
        fly_with_margins,
        code_hash(),
        find_stability=describe_stability,
        is_stability_compiled=is_compiled,
        checked=True,
        isolation=PROCESSES,
        describe_crash=describe_last_tick,
    )
