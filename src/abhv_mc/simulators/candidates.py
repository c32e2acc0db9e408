"""Candidates of tuning: a controller's file with other numbers, ready to fly, and its margins in steady flight."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.control.controller_file import Controller, read_controller
from abhv_mc.control.mission import Mission, read_mission
from abhv_mc.flight.metrics import MARGIN_NAMES
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.prepare import user_parts_of
from abhv_mc.io.documents import InputError
from abhv_mc.simulators.controller_numbers import ControllerNumbers
from abhv_mc.simulators.engine import Engine
from abhv_mc.simulators.make_plans import declare
from abhv_mc.stability.analysis import margins_of_flights
from abhv_mc.stability.fly_with_margins import add_margins
from abhv_mc.stability.steady import make_steady_plan

Time = Literal["trim"] | float  # s


@dataclass(frozen=True)
class Candidate:
    """A controller with its numbers, and the plan of its flights."""

    controller: Controller
    plan: FlightPlan
    steady: FlightPlan | None  # of its steady flight, where there is one and margins are asked for

    def with_margins(self, times: Sequence[Time]) -> FlightPlan:
        """The plan with margins at these times; without where there is no steady flight."""
        return self.plan if self.steady is None else add_margins(self.plan, self.steady, tuple(times))

    def margins(self, vehicles: Floats, times: Sequence[Time]) -> Floats:
        """Least margins ``[vehicle, margin]`` of parameter rows; zero where there is no steady flight."""
        if self.steady is None:
            return np.zeros((len(vehicles), len(MARGIN_NAMES)))
        return margins_of_flights(self.plan, self.steady, vehicles, tuple(times)).table


@dataclass(frozen=True)
class Candidates:
    """Makes the candidates of one campaign's controller."""

    campaign: Experiment
    name: str  # of the controller
    numbers: ControllerNumbers
    engine: Engine

    def make(self, point: Floats, file: Path, steady: bool) -> Candidate | None:
        """The candidate of a point, written to ``file`` meanwhile; None where its numbers make no controller.

        Raises InputError where those of the start make none.
        """
        model = self.campaign.model
        try:
            self.numbers.write(file, point)
            plan = self.engine.prepare(model.vehicle, model.mission, file, self.name)
            controller, plan = read_controller(file), declare(self.campaign, plan)
        except InputError:
            if not np.any(point):
                raise
            return None
        finally:
            file.unlink(missing_ok=True)
        return Candidate(controller, plan, self._steady(controller, plan) if steady else None)

    def _steady(self, controller: Controller, plan: FlightPlan) -> FlightPlan | None:
        try:
            parts = user_parts_of(plan)
            steady = make_steady_plan(plan.vehicle, self._mission, controller, self.name, user_code=parts)
        except (InputError, np.linalg.LinAlgError):
            return None
        return steady.lean_for(self.campaign.varied)

    @functools.cached_property
    def _mission(self) -> Mission:
        return read_mission(self.campaign.model.mission)
