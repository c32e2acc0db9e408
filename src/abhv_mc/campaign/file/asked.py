"""What a campaign asks of its metrics: which stand first, on which side they are bad, and which flights are worst."""

from collections.abc import Iterator
from dataclasses import replace

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.campaign.file.config import Requirement
from abhv_mc.campaign.file.keep import BY_REQUIREMENTS
from abhv_mc.flight.metrics import MARGINS, Metric
from abhv_mc.numerics.bounds import Bounds
from abhv_mc.statistics.ranking import Criterion


def known_metrics(campaign: CheckedCampaign) -> dict[str, Metric]:
    """The metrics of its flights by name, margins among them where it asks for some; a requirement's side is the bad
    one, and of requirements on both sides the distance outside their limits."""
    metrics = dict(campaign.metrics)
    if campaign.model.margins is not None:
        metrics |= {metric.name: metric for metric in MARGINS}
    for name in {entry.metric for entry in campaign.model.requirements}:
        own = [limits for entry, limits in required(campaign) if entry.metric == name]
        low = max((limits.low for limits in own if limits.low is not None), default=None)
        high = min((limits.high for limits in own if limits.high is not None), default=None)
        if low is not None and high is not None:
            metrics[name] = replace(metrics[name], band=Bounds(low, high))
        else:
            metrics[name] = replace(metrics[name], bad="low" if high is None else "high")
    return metrics


def required(campaign: CheckedCampaign) -> Iterator[tuple[Requirement, Bounds]]:
    """Its requirements, each with its limits in its metric's unit."""
    return zip(campaign.model.requirements, campaign.limits, strict=True)


def asked_metrics(campaign: CheckedCampaign) -> tuple[str, ...]:
    """The metrics of its requirements; without any, those that lead the table."""
    required = dict.fromkeys(entry.metric for entry in campaign.model.requirements)
    return tuple(required or [metric.name for metric in campaign.metrics.values() if metric.leads])


def ranking_criteria(campaign: CheckedCampaign) -> tuple[Criterion, ...]:
    """By what its flights are ranked: ``keep.histories.by``, a metric or all requirements (or what leads without)."""
    by, metrics = campaign.model.keep.histories.by, known_metrics(campaign)
    if by == BY_REQUIREMENTS and campaign.model.requirements:
        found = [_criterion(metrics[entry.metric], limits) for entry, limits in required(campaign)]
        return tuple(dict.fromkeys(found))
    names = asked_metrics(campaign) if by == BY_REQUIREMENTS else (by,)
    return tuple(_criterion(metrics[name], None) for name in names)


def _criterion(metric: Metric, limits: Bounds | None) -> Criterion:
    return Criterion(metric.name, metric.bad, metric.band or limits)


def worst_asked(campaign: CheckedCampaign) -> int:
    """How many of the worst flights keep their histories: the N of 'worst N', 0 without."""
    items = [str(item).split() for item in campaign.model.keep.histories.flights]
    return max((int(words[1]) for words in items if words[0] == "worst"), default=0)
