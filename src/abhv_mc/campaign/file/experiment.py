"""Checked campaign with all derived settings, used by runs, searches and reports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.config import BY_REQUIREMENTS, Compared
from abhv_mc.campaign.file.systems import find_simulator
from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.campaign.sampling.derived_parameters import Derived
from abhv_mc.campaign.sampling.designs import INDEPENDENT, Copula, Design, stream_key
from abhv_mc.campaign.sampling.marginals import Marginal
from abhv_mc.campaign.sampling.samples import (
    SampleFile,
    SampleSource,
    drawn_samples,
    find_seeds,
    full_rows,
    pooled_samples,
    samples_at_points,
    seeded_samples,
)
from abhv_mc.custom_code.source import UserSource, check_trusted, is_in_a_folder
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.outcomes import Outcomes
from abhv_mc.flights.parameters import Parameters
from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.flights.signals import Signal
from abhv_mc.interfaces import Engine, Plan, Simulator
from abhv_mc.io.documents import Document
from abhv_mc.io.messages import InputError, one_of, quoted
from abhv_mc.statistics.estimates import Criterion
from abhv_mc.statistics.family import judge_family
from abhv_mc.statistics.verdicts import SET_LATER, UNSEARCHED, Verdict, judge

_MIDDLE = 0.6  # position of the middle value in a range, chosen to differ from nominal


@dataclass(frozen=True)
class Requirement:
    """Requirement: limits that a metric must meet in a specified share of the flights."""

    metric: str
    limits: Bounds  # limits in the metric's unit
    probability: float
    consumer_risk: float
    producer_risk: float | None  # None if equal to the consumer's risk
    controllers: tuple[str, ...]  # controllers that must meet the requirement
    named: bool  # whether the file names the controllers of the requirement
    early_is_failure: bool  # whether an early termination counts as a failure
    traced: dict[str, str]  # id, text, source and rationale, if present

    def failures(self, values: Floats, early: Mask) -> Mask:
        """Return the mask [flight] of failed flights, given metric and early terminations."""
        return self.limits.failures(values, early & self.early_is_failure)

    def judge(self, failures: int, flights: int, uncomputed: int = 0) -> Verdict:
        """Return the verdict for given numbers of failures and flights.

        ``flights`` includes the ``uncomputed`` flights; ``failures`` does not.
        """
        return judge(
            failures, flights, self.probability, self.consumer_risk, self.producer_risk, uncomputed
        )


class System(NamedTuple):
    """Plans for simulating one of the compared systems."""

    plan: Plan
    with_margins: Plan | None = None  # plan with stability margins of each flight


@dataclass(frozen=True)
class Experiment:
    """Checked campaign file with all derived settings."""

    document: Document
    model: Any  # keys of the campaign file: Campaign and those of the simulator
    contents: Any  # what the file states about the flights, as Contents or a subclass
    runs: int  # total number of flights per controller at all points of the unknowns
    # distributions of the dispersed parameters, by name; empty for a sample file
    marginals: dict[str, Marginal]
    copula: Copula
    sample_file: SampleFile | None
    requirements: tuple[Requirement, ...]
    systems: Mapping[str, System] = field(default_factory=dict)  # prepared systems, by controller
    columns: tuple[str, ...] | None = None  # columns of imported samples; None if drawn
    derived: Derived = ()  # parameters computed from other parameters
    unknowns: Unknowns = field(default_factory=Unknowns)
    repeatability: Repeatability | None = None  # repeatability of a custom simulator
    file_runs: int | None = None  # number of flights stated in the campaign file
    engine: Engine | None = None  # replacement for the compiled flight code
    # indices and controllers of requirements that were set after the results were known
    later_choices: frozenset[tuple[int, str]] = frozenset()

    @cached_property
    def simulator(self) -> Simulator:
        """Simulator that computes the flights."""
        return find_simulator(self.document).make(self)

    @property
    def parameters(self) -> Parameters:
        """All parameters of a flight, dispersed or nominal."""
        parameters: Parameters = self.contents.parameters
        return parameters

    @property
    def measured(self) -> tuple[Metric, ...]:
        """Metrics of every flight: built-in metrics, then declared metrics."""
        metrics: tuple[Metric, ...] = self.contents.metrics
        return metrics

    @property
    def name(self) -> str:
        return self.model.name

    @property
    def question(self) -> str:
        return self.model.question

    @property
    def compared(self) -> tuple[str, ...]:
        """Controllers that the campaign compares; empty if it compares none."""
        return self.model.asks.compare if isinstance(self.model.asks, Compared) else ()

    @property
    def controllers(self) -> tuple[str, ...]:
        return self.simulator.systems

    @property
    def under_test(self) -> tuple[str, ...]:
        """Controllers that must meet the requirements without controllers of their own."""
        tested = self.model.under_test
        return tuple(name for name in self.controllers if tested is None or name in tested)

    def choose_controller(self, name: str | None) -> str:
        """Return the named controller, or else the only controller under test.

        Raise InputError if the name is unknown, or if it is missing and several are under test.
        """
        if name is None and len(self.under_test) == 1:
            return self.under_test[0]
        if name not in self.controllers:
            problem, choices = f"unknown {self.kind} '{name}'", self.controllers
            if name is None:
                problem, choices = f"under test: {quoted(self.under_test)}", self.under_test
            raise InputError("--controller", problem, one_of(choices, name))
        return name

    @cached_property
    def outcomes(self) -> Outcomes:
        """Possible outcomes of the campaign's flights."""
        return self.simulator.outcomes

    @property
    def can_rerun(self) -> bool:
        """Return whether flights can be re-run; imported flights cannot."""
        return self.simulator.capabilities.can_rerun

    @property
    def transients(self) -> tuple[tuple[float, float], ...]:
        """Time intervals (s) of transients, which some metrics exclude."""
        mission = self.simulator.mission
        return mission.find_transients() if mission else ()

    @property
    def kind(self) -> str:
        """Noun for a compared system, such as 'controller'."""
        return self.simulator.kind

    @property
    def seed(self) -> int:
        return self.model.seed

    @property
    def sampling(self) -> str:
        return self.model.sampling.design if self.can_rerun else "adopted"

    @property
    def runs_at_point(self) -> int:
        """Number of flights per controller at each point of the unknowns.

        With n points, row k contains sample k // n at point k % n.
        """
        return self.runs // len(self.unknowns.points)

    @property
    def judged(self) -> bool:
        """Return whether the flights at each point of the unknowns are independent.

        Verdicts require independent flights.
        """
        if (stated := self.simulator.independent) is not None:
            return stated
        return self.sampling == INDEPENDENT and not self.has_noise

    @property
    def has_noise(self) -> bool:
        """Return whether the simulator has noise that has not been shown to be independent."""
        return self.repeatability is not None and not self.repeatability.is_evidence

    @property
    def dependence(self) -> str:
        """Clause that explains why the flights are not independent draws."""
        if self.has_noise:
            return "the simulator is not repeatable, and there is no evidence of independent noise"
        if not self.can_rerun:
            return "the imported flights are not declared, or not found, to be independent draws"
        return f"the flights of the design '{self.sampling}' are not independent draws"

    @property
    def independent(self) -> bool:
        """Return whether all flights are independent, so that binomial statistics are exact."""
        return self.judged and not self.unknowns.names

    @property
    def pooled_seeds(self) -> tuple[int, ...]:
        """Seeds of the campaigns that a merged campaign pools."""
        return tuple(pool.seed for pool in self.model.pooled)

    @property
    def family_risk(self) -> float | None:
        """Joint risk of a false PASS among all verdicts, or None if not set."""
        return self.model.family.risk if self.model.family else None

    @property
    def margin_flights(self) -> int:
        """Number of flights for which stability margins are computed."""
        return int(self.contents.margin_flights(self.runs))

    @cached_property
    def channels(self) -> tuple[Signal, ...]:
        """Channels of the histories; empty if a custom simulator returns none."""
        return self.simulator.channels

    @cached_property
    def periods(self) -> dict[str, float]:
        """Period of each channel in its unit, 0 if the channel is not circular."""
        return {channel.name: channel.period for channel in self.channels}

    @property
    def kept_channels(self) -> tuple[str, ...]:
        """Channels of the stored time histories."""
        kept = self.contents.kept
        return tuple(c.name for c in self.channels if kept is None or c.name in kept)

    @property
    def enveloped_channels(self) -> tuple[str, ...]:
        """Channels of the envelopes."""
        names = self.contents.enveloped
        return tuple(c.name for c in self.channels) if names is None else names

    @property
    def has_bands(self) -> bool:
        """Return whether time-history envelopes are computed."""
        is_requested = "envelopes" in self.model.keep.model_fields_set
        return is_requested or self.simulator.mission is not None

    @property
    def dispersions(self) -> dict[str, dict[str, Any]]:
        """Dispersions and unknowns as written in the campaign file."""
        data = self.document.entries
        unknowns = {
            name: {"distribution": "unknown", **entry}
            for name, entry in (data.get("unknowns") or {}).items()
        }
        return (data.get("dispersions") or {}) | unknowns

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the dispersed parameters."""
        return self.sample_file.names if self.sample_file else tuple(self.marginals)

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of the dispersed parameters, followed by the unknowns."""
        return (*self.names, *self.unknowns.names)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the parameters that differ from flight to flight."""
        return (*self.dimensions, *(parameter.name for parameter in self.derived))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Columns of the simulated rows: dispersed parameters, unknowns and noise seeds."""
        own = (*self.dimensions, *find_seeds(self.varied, self.parameters))
        return self.columns if self.columns is not None else own

    @cached_property
    def metrics(self) -> dict[str, Metric]:
        """Metrics of the flights by name, including the requested stability margins.

        Requirements define which values of a metric are worse. If a metric has a lower and an upper
        limit, a value is worse the farther it lies outside these limits.
        """
        margins = self.contents.margins if self.margin_flights else ()
        metrics = {metric.name: metric for metric in (*self.measured, *margins)}
        for name in {item.metric for item in self.requirements}:
            own = [item.limits for item in self.requirements if item.metric == name]
            low = max((limits.low for limits in own if limits.low is not None), default=None)
            high = min((limits.high for limits in own if limits.high is not None), default=None)
            if low is not None and high is not None:
                metrics[name] = replace(metrics[name], band=Bounds(low, high))
            else:
                metrics[name] = replace(metrics[name], bad="low" if high is None else "high")
        return metrics

    @property
    def asked(self) -> tuple[str, ...]:
        """Metrics of the requirements; without requirements, the main built-in metrics."""
        required = dict.fromkeys(item.metric for item in self.requirements)
        return tuple(required or [metric.name for metric in self.measured if metric.leads])

    @cached_property
    def criteria(self) -> tuple[Criterion, ...]:
        """Criteria that rank the flights, as selected by ``keep.histories.by``.

        The criteria are one metric or all requirements; without requirements, the main metrics.
        """
        ranking = self.model.keep.histories.by
        if ranking == BY_REQUIREMENTS and self.requirements:
            return tuple(
                dict.fromkeys(
                    self._criterion(item.metric, item.limits) for item in self.requirements
                )
            )
        return tuple(
            self._criterion(name, None)
            for name in (self.asked if ranking == BY_REQUIREMENTS else (ranking,))
        )

    def _criterion(self, name: str, limits: Bounds | None) -> Criterion:
        metric = self.metrics[name]
        return Criterion(name, metric.bad, metric.band or limits)

    @property
    def worst(self) -> int:
        """Number of worst flights to keep: N of the entry ``worst N``, or 0."""
        items = [str(item).split() for item in self.model.keep.histories.flights]
        return max((int(fields[1]) for fields in items if fields[0] == "worst"), default=0)

    def limits_of(self, metric: str) -> list[float]:
        """Return the limits that all requirements set on a metric."""
        return [
            limit
            for item in self.requirements
            if item.metric == metric
            for limit in item.limits.as_entry().values()
        ]

    def ends_of(self, i: int) -> Floats:
        """Return the lower bound, a middle value and the upper bound of dimension ``i``."""
        if i >= len(self.names):
            low, high = (
                float(end[i - len(self.names)]) for end in (self.unknowns.low, self.unknowns.high)
            )
            return np.array([low, low + _MIDDLE * (high - low), high])
        if self.sample_file is not None:
            return np.quantile(self.sample_file.values[: self.runs, i], [0.0, _MIDDLE, 1.0])
        return np.asarray(self.marginals[self.names[i]].at_fraction(np.array([0.0, _MIDDLE, 1.0])))

    def make_samples(self) -> SampleSource:
        """Return the source of samples, with its columns in the order of ``inputs``."""
        if self.model.pooled:
            sources = [self._samples_of(pool.seed, self.runs) for pool in self.model.pooled]
            return pooled_samples(sources, [pool.runs for pool in self.model.pooled], self.runs)
        return self._at_points(
            self._samples_of(self.model.seed, self.runs_at_point), self.unknowns.points
        )

    def search_rows(self, flights: int, points: Floats) -> Floats:
        """Return rows of ``inputs`` at each of ``points`` [point, unknown], for a search.

        The samples are independent of the samples of the judged flights.
        """
        seed = stream_key(self.seed, "unknowns", "search") % 2**63
        rows = self._at_points(self._samples_of(seed, flights), points).draw(
            0, flights * len(points)
        )
        return rows.reshape(flights, len(points), -1).swapaxes(0, 1).reshape(len(rows), -1)

    def _at_points(self, samples: SampleSource, points: Floats) -> SampleSource:
        names = self.unknowns.names
        return samples_at_points(samples, len(self.names), names, points) if names else samples

    def judge(
        self, controllers: Sequence[str], groups: Sequence[Sequence[Verdict]]
    ) -> list[tuple[Verdict, int]]:
        """Judge each requirement for each controller; return verdicts and points.

        ``groups`` contains the verdicts at each point of the unknowns, by controller and
        requirement. Each verdict is returned with the index of the point from which its counts were
        taken.
        """
        number = max(1, len(self.requirements))
        return [
            (self._note_limits(k % number, controllers[k // number], verdict), point)
            for k, (verdict, point) in enumerate(self._judge(controllers, groups))
        ]

    def _note_limits(self, number: int, name: str, verdict: Verdict) -> Verdict:
        """Return a verdict with its limitations noted.

        The notes state whether the requirement was set after the results were known, and whether no
        search for the worst values of the unknowns was made. Without this search, PASS becomes NOT
        SHOWN.
        """
        notes = [verdict.note]
        if number in self.unknowns.unsearched and verdict.status in ("PASS", "NOT SHOWN"):
            verdict = replace(verdict, status="NOT SHOWN")
            notes.append(UNSEARCHED)
        if (number, name) in self.later_choices:
            notes.append(SET_LATER)
        return replace(verdict, note="; ".join(filter(None, notes)))

    def _judge(
        self, controllers: Sequence[str], groups: Sequence[Sequence[Verdict]]
    ) -> list[tuple[Verdict, int]]:
        if not self.unknowns.names:
            return judge_family(groups, self.judged, self.family_risk)
        requirements = range(len(self.requirements))
        pairs = [(name, number) for name in controllers for number in requirements]
        points = [self.unknowns.judged(number) for _, number in pairs]
        judged = [[group[k] for k in own] for own, group in zip(points, groups, strict=True)]
        verdicts = []
        for pair, own, group, (verdict, k) in zip(
            pairs,
            points,
            groups,
            judge_family(judged, self.judged, self.family_risk),
            strict=True,
        ):
            notes = filter(None, (self.unknowns.note(*pair, group, own[k]), verdict.note))
            verdicts.append((replace(verdict, note="; ".join(notes)), own[k]))
        return verdicts

    def rows(self, values: Floats) -> Floats:
        """Return rows of all parameters ``[flight, parameter]`` for rows of ``inputs``."""
        return full_rows(self.inputs, values, self.derived, self.parameters)

    def _samples_of(self, seed: int, runs: int) -> SampleSource:
        sampling = self.model.sampling
        if self.sample_file is not None:
            values = self.sample_file.values[:runs]
            source = SampleSource(
                self.sample_file.names, len(values), lambda first, stop: values[first:stop]
            )
        else:
            design = Design(
                sampling.design, seed, self.names, runs, sampling.levels, self.parameters
            )
            source = drawn_samples(
                design, tuple(self.marginals.values()), self.copula, self.parameters
            )
        seeds = find_seeds(self.varied, self.parameters)
        records = [self.parameters[name] for name in seeds]
        return seeded_samples(source, records, seed, sampling.design) if seeds else source


def check_user_code(campaign: Experiment, trusted: bool = False) -> list[UserSource]:
    """Return the custom code of a campaign. Raise InputError for untrusted code.

    Files outside results folders are trusted. A copy in a results folder is trusted if the user has
    run the same code before or sets ``trusted``. This function does not run any code.
    """
    foreign, own = is_in_a_folder(campaign.document.path), []
    for file, source in campaign.simulator.find_code():
        if foreign or is_in_a_folder(file):
            check_trusted(source, trusted)
        else:
            own.append(source)
    return own
