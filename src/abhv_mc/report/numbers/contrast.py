"""Unpaired comparison of two campaigns: verdicts, failure shares and quantiles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.campaign.file.requirement_set import find_requirement_changes
from abhv_mc.folder.controller_flights import ControllerFlights, severities
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.folder.inputs import FolderInputs, content_of, describe_changes, read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.documents import InputError
from abhv_mc.report.numbers.compare import pair_controllers, select_flights
from abhv_mc.statistics.estimates import LEVELS, Interval, quantile
from abhv_mc.statistics.unpaired import quantile_difference, share_difference
from abhv_mc.topics.json_data import level_name
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words


@dataclass(frozen=True)
class SideVerdict:
    """Verdict of one campaign on a requirement."""

    status: str
    failures: int
    flights: int


@dataclass(frozen=True)
class ContrastRequirement:
    """Verdicts of both campaigns on a requirement, and the change of the failure share."""

    words: str
    probability: float
    before: SideVerdict
    after: SideVerdict
    share_difference: Interval


@dataclass(frozen=True)
class ContrastQuantile:
    """Quantile in both campaigns, and the difference, which is None if it cannot be estimated."""

    before: Interval
    after: Interval
    difference: Interval | None  # second campaign minus first campaign


@dataclass(frozen=True)
class ContrastController:
    """Comparison of one controller in the first campaign with one in the second campaign."""

    controllers: tuple[str, str]
    flights: tuple[int, int]
    requirements: tuple[ContrastRequirement, ...]
    metrics: Mapping[str, Mapping[str, ContrastQuantile]]  # quantiles by metric and level


@dataclass(frozen=True)
class Contrast:
    """Comparison of two campaigns on different samples by the first campaign's requirements."""

    # changed inputs, e.g. 'dispersions.aero.drag.half_width: "15 %" -> "25 %"'
    changes: tuple[str, ...]
    words: Mapping[str, Mapping[str, str]]  # printed names of each metric
    contrasted: tuple[ContrastController, ...]


def contrast_results(
    a: FlownCampaign, b: FlownCampaign, controllers: Sequence[str] = ()
) -> Contrast:
    """Compare the distributions of the metrics that two campaigns have in common.

    Raise InputError for campaigns with unknowns, because their flights are not drawn from a single
    distribution.
    """
    for results in (a, b):
        if results.campaign.unknowns.names:
            problem = (
                "the campaign has unknowns, and its samples differ from those of the other folder"
            )
            raise InputError(
                results.folder, problem, "the same samples, or campaigns without unknowns"
            )
    metrics = [name for name in a.compared if name in b.metrics]
    requirements = [item for item in a.campaign.requirements if item.metric in b.metrics]
    is_judged = a.campaign.judged and b.campaign.judged
    contrasted = []
    for pair in pair_controllers(a, b, controllers):
        flights = select_flights(a, b, *pair)
        contrasted.append(
            ContrastController(
                pair,
                (flights[0].flight.size, flights[1].flight.size),
                tuple(_contrast_requirement(item, *flights, is_judged) for item in requirements),
                {metric: _contrast_quantiles(metric, *flights) for metric in metrics},
            )
        )
    records = a.campaign.metrics
    return Contrast(
        tuple(find_changes(a, b)),
        {name: records[name].as_texts() for name in metrics},
        tuple(contrasted),
    )


def find_changes(a: FlownCampaign, b: FlownCampaign) -> list[str]:
    """Return the changes of inputs, requirements and flight code from one campaign to another."""
    before, after = (_read_inputs(results) for results in (a, b))
    changes = describe_changes(before, after, extensible=False)
    changes += [
        f"requirements.{change}" for change in find_requirement_changes(before.data, after.data)
    ]
    if a.manifest.source_hash != b.manifest.source_hash:
        commits = (results.manifest.commit or results.manifest.source_hash for results in (a, b))
        changes.append("flight code: {} -> {}".format(*(commit[:12] for commit in commits)))
    return changes


def _read_inputs(results: FlownCampaign) -> FolderInputs:
    """Return the inputs of a folder with contents instead of hashes, which comments change."""
    inputs = read_folder_inputs(CampaignFolder(results.folder), results.manifest)
    paths = {name: results.folder / name for name in inputs.hashes}
    contents = {name: content_of(path) for name, path in paths.items() if path.is_file()}
    return replace(inputs, hashes={**inputs.hashes, **contents})


def _contrast_requirement(
    item: Requirement, a: ControllerFlights, b: ControllerFlights, is_judged: bool
) -> ContrastRequirement:
    before, after = (_verdict(item, flights, is_judged) for flights in (a, b))
    counts = before.failures, before.flights, after.failures, after.flights
    return ContrastRequirement(
        requirement_words(item, a.records),
        item.probability,
        before,
        after,
        share_difference(*counts),
    )


def _verdict(item: Requirement, flights: ControllerFlights, is_judged: bool) -> SideVerdict:
    failures, absent = int(requirement_failures(flights, item).sum()), flights.not_computed
    verdict = item.judge(failures, flights.flight.size + absent, absent)
    status = verdict.status if is_judged else "ESTIMATE"
    return SideVerdict(status, verdict.failures, verdict.flights)


def _contrast_quantiles(
    metric: str, a: ControllerFlights, b: ControllerFlights
) -> dict[str, ContrastQuantile]:
    first, second = (severities(flights, metric) for flights in (a, b))
    sense = a.records[metric].bad
    quantiles = {}
    for level in LEVELS:
        difference = quantile_difference(first, second, level)
        quantiles[level_name(level)] = ContrastQuantile(
            quantile(first, level).in_sense(sense),
            quantile(second, level).in_sense(sense),
            difference and difference.in_sense(sense),
        )
    return quantiles
