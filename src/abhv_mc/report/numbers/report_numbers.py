"""Every number of a report, as plain data: `report.json` holds it, the page prints it, `verify campaign` remakes it.

The same folder gives the same numbers to the last bit: seeds are fixed and nothing depends on time or machine.
Infinite and missing values are None.
"""

from typing import Any

from abhv_mc.report.numbers.compare import Baseline
from abhv_mc.report.numbers.judgement import judge_campaign
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.margins.section import missing_margins
from abhv_mc.topics.plain import plain
from abhv_mc.topics.registry import BUILT_IN
from abhv_mc.topics.topic import Models, user_topics

FORMAT = 2


def make_numbers(models: Models, baseline: Baseline | None = None) -> dict[str, Any]:
    """All numbers of the report of a campaign, as JSON holds them; those against a ``baseline`` where given."""
    manifest, users = models.results.manifest, user_topics()
    return {
        "format": FORMAT,
        "state": manifest.state,
        "digest": manifest.digest,
        "warnings": warnings_of(models),
        "judgement": plain(judge_campaign(models)),
        **{topic.name: plain(models[topic]) for topic in BUILT_IN},
        **({"topics": {topic.name: plain(models[topic]) for topic in users}} if users else {}),
        **({"baseline": plain(baseline)} if baseline else {}),
    }


def warnings_of(models: Models) -> list[str]:
    """What a run and the topics have to say of what is missing."""
    manifest = models.results.manifest
    made = (*manifest.warnings, *manifest.not_made)
    return [*made, *missing_margins(models[MARGINS], models.names)]
