"""What a campaign can show before it flies: flights needed, and the chance of PASS against the true failure rate."""

from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.simulators.feasibility import asked_in_vain
from abhv_mc.statistics.evidence import flights_to_pass, most_failures
from abhv_mc.statistics.flights_planned import PLANNED_FAILURES, ever_chance, pass_chance, together
from abhv_mc.topics.failed_flights import limit_words
from abhv_mc.topics.plain import plain

TIMES = (1, 2, 4)  # the planned number of flights
# True failure rates over the allowed one, a fifth and the whole of it among them.
_RATES = np.concatenate(
    [[0.0], *(np.geomspace(*ends)[:-1] for ends in ((0.02, 0.2, 8), (0.2, 1.0, 13))), np.geomspace(1.0, 3.0, 5)]
)


def plan_numbers(campaign: Experiment) -> dict[str, Any]:
    """For each requirement flights for 0 to 3 failures and chances of PASS; for all of them together; as JSON holds it.

    Chances are at some flight up to so many, for one who looks after each, and at that number itself. All curves
    stand on `rates_over_allowed`, the true failure rate divided by what the requirement allows.
    """
    model, runs, known = campaign.model, campaign.runs, campaign.metrics
    verdicts = len(model.requirements) * len(model.controllers)
    requirements: list[dict[str, Any]] = []
    for item in campaign.requirements:
        # Where a family is held, each verdict is planned with its share of the risk: Holm's first step.
        risk = min(item.consumer_risk, model.family.risk / verdicts) if model.family else item.consumer_risk
        asked = item.probability, risk
        rates = np.minimum(_RATES * (1.0 - item.probability), 1.0)
        requirements.append(
            {
                "metric": item.metric,
                "words": limit_words(known[item.metric], item.limits),
                "probability": item.probability,
                "consumer_risk": item.consumer_risk,
                "risk_used": risk,
                "flights_for_failures": {str(k): flights_to_pass(k, *asked) for k in PLANNED_FAILURES},
                "most_failures_at_runs": most_failures(runs, *asked),
                "pass_chance": [
                    {
                        "runs": times * runs,
                        "at_some_flight": plain(ever_chance(times * runs, *asked, rates)),
                        "at_runs": plain(pass_chance(times * runs, *asked, rates)),
                    }
                    for times in TIMES
                ],
            }
        )
    return {
        "name": model.name,
        "runs": runs,
        "independent_flights": model.sampling.design == INDEPENDENT,
        "stops_when_proven": model.stop is not None,
        "family_risk": model.family.risk if model.family else None,
        "verdicts": verdicts,
        "rates_over_allowed": plain(_RATES),
        "requirements": requirements,
        "together": [
            {
                "runs": times * runs,
                **{
                    kind: dict(zip(("low", "high"), plain(list(together(curves))), strict=True))
                    for kind in ("at_some_flight", "at_runs")
                    if (curves := [np.array(entry["pass_chance"][i][kind]) for entry in requirements])
                },
            }
            for i, times in enumerate(TIMES)
        ],
        "problems": asked_in_vain(campaign),
    }


def write_plan_figure(numbers: dict[str, Any], path: Path) -> None:
    """The curves of every requirement as PNG."""
    from abhv_mc.report.figures.planned import plot_planned
    from abhv_mc.topics.figure_style import write_png

    write_png(plot_planned(numbers), path)
