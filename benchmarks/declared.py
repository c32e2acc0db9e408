"""Whether every metric of the program, declared as a campaign declares its own, gives the same bits.

    python -m benchmarks.declared [CAMPAIGN.yaml ...] [--flights 64]

On so many flights of each controller of each shipped campaign (or of those given), beside its own metrics. Exit code 1
where a value differs.
"""

import argparse
import dataclasses
import sys
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.file.check import CheckedCampaign, read_campaign
from abhv_mc.campaign.file.user_metrics import MetricEntry, declare_metrics
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution.engine import make_engine
from abhv_mc.execution.plans import make_plans
from abhv_mc.flight.fly import fly
from abhv_mc.flight.metrics import METRICS, TAKES_LIMIT, Metric, pack_metrics
from abhv_mc.io.documents import InputError, InputErrors


def repeat(metric: Metric) -> dict[str, Any]:
    """A metric of the program as a campaign would declare it (an infinite value is that of no tick at all)."""
    words: dict[str, Any] = {"of": metric.of, "statistic": metric.statistic.word, "settled": metric.settled}
    words |= {"limit": metric.limit} if metric.statistic in TAKES_LIMIT else {}
    return words | ({"empty": metric.empty} if isfinite(metric.empty) else {})


def count_differing(campaign: CheckedCampaign, flights: int) -> dict[str, int]:
    """Values that differ in any bit, by metric; those that never do are left out."""
    errors: list[InputError] = []
    entries = {f"user_{metric.name}": MetricEntry.model_validate(repeat(metric)) for metric in METRICS}
    again = declare_metrics(entries, campaign.user_sources, campaign.document, ("metrics",), errors)
    if errors:
        raise InputErrors(errors)
    source = campaign.make_samples()
    parameters = full_rows(source.names, source.draw(0, flights))
    differing = dict.fromkeys((metric.name for metric in METRICS), 0)
    for plan in make_plans(campaign, campaign.model.controllers, make_engine()).values():
        block = fly(dataclasses.replace(plan, declared=pack_metrics(again)), parameters)
        plain = fly(plan, parameters)
        same = block.metrics[:, : len(METRICS)].view(np.uint64) == plain.metrics[:, : len(METRICS)].view(np.uint64)
        same &= block.metrics[:, len(METRICS) :].view(np.uint64) == plain.metrics[:, : len(METRICS)].view(np.uint64)
        for name, column in zip(differing, same.T, strict=True):
            differing[name] += int((~column).sum())
    return {name: count for name, count in differing.items() if count}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", type=Path, nargs="*")
    parser.add_argument("--flights", type=int, default=64)
    options = parser.parse_args()
    shipped = sorted((Path(__file__).resolve().parents[1] / "campaigns").glob("*.yaml"))
    wrong = False
    for path in options.campaigns or shipped:
        campaign = read_campaign(path)
        differing = count_differing(campaign, min(options.flights, campaign.runs))
        names = " and ".join(campaign.model.controllers)
        print(f"{campaign.model.name}, {names}, {len(METRICS)} metrics: {differing or 'all bits alike'}", flush=True)
        wrong |= bool(differing)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
