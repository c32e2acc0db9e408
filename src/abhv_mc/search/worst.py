"""Search for the worst value of a metric (``abhv-mc worst``) and for the smallest margins.

``abhv-mc margins CAMPAIGN --worst`` finds the smallest margins over dispersions and unknowns by
linear analysis.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import compress, product
from math import prod
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.campaign.sampling.marginals import DiscreteMarginal
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.flights.metrics import MARGIN_NAMES, Metric
from abhv_mc.flights.parameters import Parameters
from abhv_mc.folder.flights import FlightRows
from abhv_mc.interfaces import Engine, TrimMargins
from abhv_mc.io.messages import InputError, counted, grouped_digits
from abhv_mc.requests import WorstRequest
from abhv_mc.search.methods.worst import WorstCase, least_evaluations, search_worst
from abhv_mc.search.search_flights import (
    DrawnFlights,
    Severity,
    binding_requirements,
    ended_early,
    find_metric,
    not_computed,
    open_search,
    read_searched,
)
from abhv_mc.search.space import Space, make_space
from abhv_mc.statistics.estimates import Criterion

_BATCH = 512  # number of random flights per batch
_MOST_COMBINATIONS = 64  # maximum number of combinations of discrete values
_OTHER_SEEDS = 64  # number of flights at the worst point with other turbulence and noise
MARGIN_EVALUATIONS = 512  # number of evaluations per margin
_MARGIN_BOX = 3.0  # half width in sigma of the box for unbounded distributions
_MOVED = 1e-6  # smallest change of a parameter that is reported, in half widths of its range


@dataclass(frozen=True)
class WorstFound:
    """Worst flight of a search, with random flights for comparison."""

    request: WorstRequest
    metric: Metric
    criterion: Criterion
    controller: str
    case: WorstCase = field(repr=False)
    names: tuple[str, ...]
    bounds: Floats  # range of each parameter [parameter, 2]
    probabilities: dict[
        str, float
    ]  # probabilities of parameters that act only in some flights; in the search they always act
    # flights of the search, followed by random flights
    flights: FlightRows = field(repr=False)
    searched: int  # number of flights of the search
    worst: int  # number of the worst flight
    random_worst: int  # number of the worst random flight
    severities: Floats = field(repr=False)  # severities [flight]
    duration: float  # duration in s of a flight that does not terminate early
    failed_to_run: int
    drawn: DrawnFlights | None = field(repr=False)
    known: Parameters
    requirements: tuple[Requirement, ...] = ()  # requirements on the metric
    random: int = 0  # number of random flights; copies of the worst flight with other seeds follow

    @property
    def other_seeds(self) -> tuple[int, int, tuple[float, float, float] | None] | None:
        """Number of re-seeded worst flights, number terminated early, and range of the metric.

        The range is the smallest, median and largest value over completed flights. The result is
        None if the campaign has no seeds.
        """
        rows = slice(self.searched + self.random, None)
        early, absent = ended_early(self.flights)[rows], not_computed(self.flights)[rows]
        values = self.flights.column(self.metric.name)[rows][~early & ~absent]
        if not early.size:
            return None
        ends = None
        if values.size:
            ends = float(values.min()), float(np.median(values)), float(values.max())
        return early.size, int(early.sum()), ends

    def failures(self, requirement: Requirement) -> int:
        """Return the number of search flights that violate a requirement."""
        values = self.flights.column(self.metric.name)
        failed = requirement.failures(values, ended_early(self.flights))
        return int(np.sum((failed & ~not_computed(self.flights))[: self.searched]))

    def value(self, flight: int) -> float:
        """Return the value of the metric in a flight."""
        return float(self.flights.column(self.metric.name)[flight])

    @property
    def sign(self) -> float:
        """Sign that converts a severity to the plotted value."""
        return -1.0 if self.criterion.bad == "low" and self.criterion.limits is None else 1.0

    @property
    def at_bounds(self) -> list[str]:
        """Parameters that are at a bound of their range in the worst flight."""
        return list(compress(self.names, self.case.at_bounds))

    def numbers(self) -> dict[str, Any]:
        """Return the result as JSON values in SI units."""
        return {
            "metric": self.request.metric,
            "controller": self.controller,
            "value": self.value(self.worst),
            "outcome": self.flights.outcome[self.worst],
            "flight": self.worst,
            "flights": self.searched,
            "parameters": dict(
                zip(self.flights.names, self.flights.samples[self.worst].tolist(), strict=True)
            ),
            "random_worst": self.value(self.random_worst),
            "random_outcome": self.flights.outcome[self.random_worst],
            "random_flight": self.random_worst,
            "at_bounds": self.at_bounds,
            "other_seeds": self.other_seeds
            and dict(zip(("flights", "ended_early", "range"), self.other_seeds, strict=True)),
            "requirements": [
                {**item.limits.as_entry(), "failures": self.failures(item)}
                for item in self.requirements
            ],
            "ended_early": int(ended_early(self.flights)[: self.searched].sum()),
            "failed_to_run": self.failed_to_run,
        }


def find_worst(request: WorstRequest, engine: Engine | None = None) -> WorstFound:
    """Search for the worst flight, then simulate random flights in the same box.

    There are as many random flights as search flights. Raise InputError for an invalid request.
    """
    campaign, controller = read_searched(request.campaign, request.controller, request.seed)
    metric = find_metric(campaign, request.metric, partial(InputError, "--metric"))
    criterion = Criterion(
        metric.name, request.bad or metric.bad, None if request.bad else metric.band
    )
    space = make_space(campaign)
    bounds = space.bounds(request.box)
    least = least_evaluations(len(space.names), request.flights)
    if request.flights < least:
        raise InputError(
            "--flights",
            f"found {grouped_digits(request.flights)}",
            f"at least {grouped_digits(least)} for {counted(len(space.names), 'dispersion')}",
        )
    random = space.draw_in_box(bounds, campaign.model.seed, request.flights)
    settings = {"kind": "worst", **request.settings}
    with open_search(
        request, settings, 2 * request.flights, engine, metric.name in MARGIN_NAMES
    ) as search:
        severity = Severity(criterion, search.duration)

        def evaluate(points: Floats) -> Floats:
            return severity.of(search.fly(space.from_box(points, bounds), common_seed=True))

        case = search_worst(evaluate, len(space.names), request.flights, search.seed)
        best = space.from_box(case.place[None], bounds)
        for values in _combine(space, best):
            search.fly(values, common_seed=True)
        searched = search.flown
        random = random[:searched]
        for start in range(0, len(random), _BATCH):
            search.fly(random[start : start + _BATCH], common_seed=True)
        if space.seeds:
            found_so_far = search.rows()
            index = int(np.argmax(severity.ranked(found_so_far)[:searched]))
            worst = found_so_far.samples[index, : len(space.names)]
            search.fly(np.tile(worst, (_OTHER_SEEDS, 1)), common_seed=False)
        rows = search.rows()
        severities = severity.ranked(rows)
        result = WorstFound(
            request=request,
            metric=metric,
            criterion=criterion,
            controller=controller,
            case=case,
            names=space.names,
            bounds=bounds,
            probabilities=space.probabilities,
            flights=rows,
            searched=searched,
            worst=int(np.argmax(severities[:searched])),
            random_worst=searched + int(np.argmax(severities[searched : searched + len(random)])),
            severities=severities[: searched + len(random)],
            duration=severity.duration,
            failed_to_run=search.failed_to_run,
            drawn=search.draw(severities[:searched]),
            known=campaign.parameters,
            requirements=tuple(
                item
                for item in binding_requirements(campaign, controller)
                if item.metric == metric.name
            ),
            random=len(random),
        )
        search.finish(result.numbers())
    return result


def _combine(space: Space, best: Floats) -> Iterator[Floats]:
    """Yield the best point [1, dimension] with all combinations of discrete values.

    Yield nothing if there are too many combinations. The search itself may miss combinations,
    because it moves one or all parameters at a time and discrete values have no slope.
    """
    values = {
        i: marginal.values
        for i, marginal in enumerate(space.marginals)
        if isinstance(marginal, DiscreteMarginal)
    }
    number = prod(map(len, values.values()))
    if 1 < number <= _MOST_COMBINATIONS:
        rows = np.tile(best, (number, 1))
        rows[:, list(values)] = list(product(*values.values()))
        yield rows


@dataclass(frozen=True)
class WorstMargin:
    """Smallest value found for one margin; the true minimum may be smaller."""

    controller: str
    metric: str
    nominal: float  # nominal margin in the metric's unit; 0 if unstable or if there is no trim
    found: float
    parameters: dict[str, float]  # parameters in SI units at the smallest margin
    moved: tuple[str, ...]  # parameters away from the middle of their range, farthest first
    fault: str  # 'unstable', the reason why there is no trim, or ''
    evaluations: int


def find_worst_margins(campaign: Experiment, controllers: Sequence[str]) -> list[WorstMargin]:
    """Return each controller's smallest margins in steady flight, without simulation."""
    space = make_space(campaign, with_unknowns=True)
    bounds, seed, dimension = space.bounds(_MARGIN_BOX), campaign.model.seed, len(space.names)
    evaluations = max(MARGIN_EVALUATIONS, least_evaluations(dimension, MARGIN_EVALUATIONS))
    worst_margins = []
    if (mission := campaign.simulator.mission) is None:
        return []
    for name, margins in mission.trim_margins(controllers).items():
        nominal = margins(full_rows((), np.empty((1, 0)), (), campaign.parameters))[0][0]
        for k, metric in enumerate(MARGIN_NAMES):

            def evaluate(points: Floats, k: int = k, margins: TrimMargins = margins) -> Floats:
                values = space.complete(space.from_box(points, bounds), seed, None)
                return -margins(space.rows(values))[0][:, k]

            case = search_worst(evaluate, dimension, evaluations, seed)
            values = space.from_box(case.place[None], bounds)
            least, faults = margins(space.rows(space.complete(values, seed, None)))
            worst_margins.append(
                WorstMargin(
                    controller=name,
                    metric=metric,
                    nominal=float(nominal[k]),
                    found=float(least[0, k]),
                    parameters=dict(zip(space.names, values[0].tolist(), strict=True)),
                    moved=tuple(
                        space.names[i]
                        for i in np.argsort(-np.abs(case.place))
                        if abs(case.place[i]) > _MOVED
                    ),
                    fault=faults[0],
                    evaluations=len(case.values),
                )
            )
    return worst_margins
