"""Candidates of tuning: a controller's file with other numbers, ready to fly, and its margins in steady flight."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flight.metrics import MARGIN_NAMES
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.documents import InputError
from abhv_mc.simulators.controller_numbers import ControllerNumbers
from abhv_mc.simulators.engine import Engine
from abhv_mc.simulators.make_plans import declare
from abhv_mc.simulators.margin_plans import make_steady
from abhv_mc.stability.analysis import margins_of_flights
from abhv_mc.stability.fly_with_margins import add_margins

Time = Literal["trim"] | float  # s


@dataclass(frozen=True)
class Candidate:
    """A controller with its numbers: the plan of its flights."""

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
            plan = declare(self.campaign, self.engine.prepare(model.vehicle, model.mission, file, self.name))
            try:
                return Candidate(plan, make_steady(self.campaign, plan, file) if steady else None)
            except (InputError, np.linalg.LinAlgError):
                return Candidate(plan, None)
        except InputError:
            if not np.any(point):
                raise
            return None
        finally:
            file.unlink(missing_ok=True)
