"""Search for the smallest set of dispersions that explains the failure of a flight.

All dispersions outside the set have their nominal values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from abhv_mc.analysis.replay import find_rows
from abhv_mc.analysis.shrink import BUDGET, Shrunk, shrink
from abhv_mc.array_types import Floats, Indices, Ints, Mask
from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.execution.executor import make_ready, open_flown, simulate
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.parameters import Parameters
from abhv_mc.flights.signals import Signal
from abhv_mc.folder.flights import END_TIME, FlightRows, SampleReader
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.interfaces import Fly
from abhv_mc.io.messages import InputError, one_of

_MOST_SAMPLES = 10_000  # maximum number of flights used to estimate how rare a sampled value is


@dataclass(frozen=True)
class Failure:
    """Failure criterion: an early termination or a missed requirement."""

    requirement: Requirement | None
    column: int = 0  # column of the requirement's metric in `metrics`

    @property
    def words(self) -> str:
        if self.requirement is None:
            return "ended early"
        return f"missed {self.requirement.metric} {self.requirement.limits}"

    def severity(self, outcome: Ints, end_time: Floats, metrics: Floats) -> Floats:
        """Return the severity of the failure of each flight [flight], or -inf without failure.

        `metrics` has shape [flight, metric].
        """
        early = outcome != Outcome.OK
        if self.requirement is None:
            return np.where(early, -end_time, -np.inf)
        value = metrics[:, self.column]
        worse = np.nan_to_num(self.requirement.limits.worse(value), nan=np.inf)
        return np.where(self.requirement.failures(value, early), worse, -np.inf)


@dataclass(frozen=True)
class Explanation:
    """Smallest set of dispersions that makes a flight fail."""

    controller: str
    flight: int
    failure: Failure
    ended: str  # description of how the flight ended
    samples: dict[str, float]  # all dispersions of the flight in SI units
    # dispersions that suffice for the failure; empty if the nominal flight fails too
    causes: tuple[str, ...]
    # other sets of dispersions, of the same size, that also make the flight fail
    others: tuple[tuple[str, ...], ...]
    # True if no smaller set causes the failure. Otherwise no single cause can be omitted, but a
    # smaller set may exist.
    smallest: bool
    tried: int  # number of flights simulated for the analysis
    # values [flight, dispersion] and results of the nominal, the reduced and the original flight
    rows: Floats = field(repr=False)
    block: FlightBlock = field(repr=False)
    known: Parameters
    # channels of the histories in ``block``
    channels: tuple[Signal, ...] = field(repr=False)


def explain_flight(
    root: Path,
    controller: str,
    flight: int,
    fly: Fly | None = None,
    requirement: str | None = None,
    trust_code: bool = False,
) -> Explanation:
    """Find the smallest set of a failed flight's dispersions that reproduces the failure.

    `root` is the campaign's folder. `requirement` is the metric of the missed requirement to
    explain. By default, the early termination is explained if there was one, else the first missed
    requirement. Raise InputError if the flight does not exist or did not fail.
    """
    folder = CampaignFolder(root)
    campaign = open_flown(folder, [controller], trust_code)
    (row,) = find_rows(folder, controller, [flight])
    failure = find_failure(root, campaign, row, requirement)
    campaign, margins = with_margins(campaign, controller, [failure])
    (shrunk,) = smallest_sets(
        folder, campaign, controller, row.samples, [failure], fly=fly, margins=margins
    )
    if shrunk is None:
        again = simulate(campaign, controller, row.samples, None, fly, margins=margins)
        if again.outcome[0] == Outcome.FAILED_TO_RUN:
            reason = again.reasons.get(0, "no reason is known")
            raise InputError(
                root,
                f"flight {flight} failed to run ({reason})",
                "a flight that runs without errors",
            )
        expected = "the program version that computed the flight (see manifest.json)"
        raise InputError(root, f"flight {flight} does not fail when it is re-run", expected)
    names = campaign.dimensions
    nominal, values, seeds = (
        campaign.parameters.nominal_of(names),
        *np.split(row.samples[0], [len(names)]),
    )
    sets = [tuple(names[i] for i in members) for members in shrunk.sets]
    alone = np.isin(names, sets[0])
    flown = campaign.outcomes.numbers[row.outcome[0]]
    rows = np.stack([nominal, np.where(alone, values, nominal), values])
    return Explanation(
        controller=controller,
        flight=flight,
        failure=failure,
        ended=campaign.simulator.describe_end(controller, row.samples, flown),
        samples=dict(zip(names, values.tolist(), strict=True)),
        causes=sets[0],
        others=tuple(sets[1:]),
        smallest=shrunk.smallest,
        tried=shrunk.tried,
        rows=rows,
        block=simulate(
            campaign,
            controller,
            np.column_stack([rows, np.tile(seeds, (3, 1))]),
            1,
            fly,
            margins=margins,
        ),
        known=campaign.parameters,
        channels=campaign.channels,
    )


def with_margins(
    campaign: Experiment, controller: str, failures: Sequence[Failure]
) -> tuple[Experiment, bool]:
    """Return a campaign for re-running failed flights, and whether it computes margins.

    Margins are computed if any failure is a missed requirement on a stability margin.
    """
    if not any(
        failure.requirement is not None and failure.requirement.metric in MARGIN_NAMES
        for failure in failures
    ):
        return campaign, False
    return make_ready(campaign, {controller: campaign.systems[controller].plan}, margins=True), True


def smallest_sets(
    folder: CampaignFolder,
    campaign: Experiment,
    controller: str,
    samples: Floats,
    failures: Sequence[Failure],
    *,
    fly: Fly | None,
    margins: bool,
    budget: int = BUDGET,
) -> list[Shrunk | None]:
    """Return, for each flight, the smallest sets of dispersions that make it fail.

    `samples` has shape [failure, parameter].
    """
    names = campaign.dimensions
    nominal, values, seeds = (
        campaign.parameters.nominal_of(names),
        *np.split(samples, [len(names)], axis=1),
    )

    def severity(owners: Indices, keep: Mask) -> Floats:
        rows = np.column_stack(
            [np.where(keep, values[owners], nominal), seeds[owners]]
        )  # All flights use the noise of the original flight.
        block = simulate(campaign, controller, rows, None, fly, margins=margins)
        severities = np.full(owners.size, -np.inf)
        for index in np.unique(owners).tolist():
            mask = owners == index
            severities[mask] = failures[index].severity(
                block.outcome[mask], block.end_time[mask], block.metrics[mask]
            )
        return np.where(block.outcome == Outcome.FAILED_TO_RUN, -np.inf, severities)

    drawn = SampleReader(folder.samples)
    return shrink(len(names), severity, [mildest_first(drawn, row) for row in values], budget)


def find_failure(
    root: Path, campaign: Experiment, row: FlightRows, requirement: str | None
) -> Failure:
    """Return the failure of a flight: its early termination or a missed requirement.

    If `requirement` names a metric, only requirements on this metric are considered. Raise
    InputError if the flight did not fail.
    """
    outcome = campaign.outcomes.numbers[row.outcome[0]]
    if outcome == Outcome.FAILED_TO_RUN:
        problem = f"flight {row.first} could not be computed"
        raise InputError(root, problem, "a flight that was simulated successfully")
    positions = [
        i for i, name in enumerate(row.columns) if name != END_TIME.name
    ]  # The column of the end time lies between the metrics and the stability margins.
    columns = [row.columns[i] for i in positions]
    state = np.array([outcome]), row.end_time, row.values[:, positions]
    metrics = [item.metric for item in campaign.requirements]
    if requirement is not None and requirement not in metrics:
        raise InputError(
            "--requirement",
            f"the campaign has no requirement on '{requirement}'",
            one_of(metrics, requirement) if metrics else "the command without --requirement",
        )
    failures = [
        Failure(item, columns.index(item.metric))
        for item in campaign.requirements
        if requirement in (None, item.metric)
    ]
    for failure in failures if requirement is not None else [Failure(None), *failures]:
        if failure.severity(*state)[0] > -np.inf:
            return failure
    reason = f"met the requirement on '{requirement}'" if requirement else "did not fail"
    raise InputError(
        root,
        f"flight {row.first} of controller '{row.controller}' {reason}",
        "a flight of this controller that terminated early or missed a requirement",
    )


def mildest_first(samples: SampleReader, values: Floats) -> Indices:
    """Return the indices of the parameters, sorted from the least to the most unusual value."""
    drawn = samples.rows(0, min(samples.flights, _MOST_SAMPLES))[:, : values.size]
    # A failure that does not occur in most flights has an infinite median time.
    middle = np.median(drawn, axis=0)

    def off(some: Floats) -> Floats:
        with np.errstate(invalid="ignore"):
            return np.where(some == middle, 0.0, np.abs(some - middle))

    return np.argsort((off(drawn) < off(values)).mean(axis=0), kind="stable")
