"""What a campaign can show before it flies: flights needed, and the chance of PASS against the true failure rate."""

from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.campaign.file.feasibility import asked_in_vain
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.report.numbers.failures import limit_words
from abhv_mc.report.numbers.plain import plain
from abhv_mc.statistics.flights_planned import (
    flights_for_failures,
    most_failures,
    pass_chance,
    sequential_curve,
    together,
)
from abhv_mc.statistics.judgement import Rules, any_false_pass, own_risks
from abhv_mc.statistics.sequential import choose_looks, make_sequential_plan

# True failure rates over the allowed one, a fifth and the whole of it among them.
_RATES = np.concatenate(
    [[0.0], *(np.geomspace(*ends)[:-1] for ends in ((0.01, 0.2, 22), (0.2, 1.0, 13))), np.geomspace(1.0, 3.0, 7)]
)


def plan_numbers(campaign: CheckedCampaign) -> dict[str, Any]:
    """For each requirement flights for 0 to 3 failures and curves of PASS; for all of them together; as JSON holds it.

    A fixed campaign of `runs` flights beside one of at most as many that stops when proven, whichever the file asks
    for. All curves stand on `rates`, the true failure rate divided by what the requirement allows.
    """
    model, runs = campaign.model, campaign.runs
    family = model.family.risk if model.family else None
    pairs = [(item, name) for item in model.requirements for name in model.controllers]
    risks = [item.consumer_risk for item, _ in pairs]
    # Where a family is held, each pair is planned with its share of the risk: Holm's first step, Bonferroni's any.
    shares = own_risks(risks, Rules((), (1,), True, family))
    requirements, fixed, stopped = [], [], []
    for i, (item, limit) in enumerate(zip(model.requirements, campaign.limits, strict=True)):
        risk = shares[i * len(model.controllers)]
        allowed = 1.0 - item.probability
        rates = np.minimum(_RATES * allowed, 1.0)
        looks = campaign.looks or choose_looks(item.probability, risk, runs)
        plan = make_sequential_plan(looks, item.probability, risk)
        curve = sequential_curve(plan, rates)
        fixed.append(pass_chance(runs, item.probability, risk, rates))
        stopped.append(curve.passed)
        requirements.append(
            {
                "metric": item.metric,
                "words": limit_words(item.metric, limit, item.below is not None),
                "probability": item.probability,
                "consumer_risk": item.consumer_risk,
                "risk_used": risk,
                "flights_for_failures": {str(k): n for k, n in flights_for_failures(item.probability, risk).items()},
                "most_failures_at_runs": most_failures(runs, item.probability, risk),
                "pass_chance": plain(fixed[-1]),
                "false_pass": float(pass_chance(runs, item.probability, risk, np.array([allowed]))[0]),
                "stop_when_proven": {
                    "looks": list(looks),
                    "false_pass": plan.false_pass,
                    "pass_chance": plain(curve.passed),
                    "fail_chance": plain(curve.failed),
                    "expected_flights": plain(curve.flights),
                },
            }
        )
    rules = Rules((), campaign.looks, True, family)
    return {
        "name": model.name,
        "runs": runs,
        "independent_flights": model.sampling.design == INDEPENDENT,
        "stops_when_proven": bool(campaign.looks),
        "family_risk": family,
        "verdicts": len(risks),
        "any_false_pass": any_false_pass(risks, rules) if risks else None,
        "expected_false_passes": float(sum(own_risks(risks, rules))),
        "rates_over_allowed": plain(_RATES),
        "requirements": requirements,
        "together": {
            kind: dict(zip(("low", "high"), plain(list(together(curves))), strict=True))
            for kind, curves in (("fixed", fixed), ("stop_when_proven", stopped))
            if curves
        },
        "problems": asked_in_vain(campaign),
    }


def write_plan_figure(numbers: dict[str, Any], path: Path) -> None:
    """The curves of every requirement as PNG."""
    from abhv_mc.report.figures.planned import plot_planned
    from abhv_mc.report.figures.style import write_png

    write_png(plot_planned(numbers), path)
