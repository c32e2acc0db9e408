"""Recommended next step after a campaign, with a command and the reason."""

import shlex
from collections.abc import Sequence
from typing import NamedTuple

from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.io.messages import grouped_digits
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import MOST_TIMES, UNSEARCHED, Verdict, about, advise, predict_pass
from abhv_mc.topics.formatting import count_of
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import Verdicts

# largest number of flights for which a command is suggested, as a multiple of the present number
_MOST_LONGER = 100
_ASSUMPTION = "chance for the present failure counts (Jeffreys prior), failure rates independent"


class NextStep(NamedTuple):
    """Recommended next step."""

    why: str
    command: str = ""  # command with DIR for the results folder; '' if no command is recommended
    assumption: str = ""  # assumption of a chance in ``why``


def find_next_step(models: Models) -> NextStep | None:
    """Recommend to finish the campaign, explain failures, run more flights, or stop.

    Return None for estimates, and for imported tables without requirements.
    """
    results, verdicts = models.results, models[VERDICTS]
    campaign, manifest = results.campaign, results.manifest
    flies, present = campaign.can_rerun, campaign.runs_at_point
    planned = max(manifest.file_runs or 0, present)
    if manifest.state != "complete" or planned > present:
        done, total = manifest.runs_done, manifest.runs_planned
        if planned > present:
            done, total = present, planned
        why = f"complete the campaign ({count_of(done, total)} flights)"
        return _longer_run(models, planned, why) if flies else NextStep(why)
    if not campaign.judged:
        return None
    if not verdicts.requirements:
        why = "add requirements for verdicts; stored flights are kept"
        return NextStep(why, "abhv-mc run CAMPAIGN.yaml -o DIR") if flies else None
    binding = [verdict for _, _, verdict in verdicts.binding if verdict]
    if any(verdict.status == "FAIL" for verdict in binding):
        if results.judged_by:
            command = f"abhv-mc run {_campaign_file(results)} -o DIR"
            why = "adopt these requirements, then explain the failures"
            return NextStep(why, command if flies else "")
        return NextStep("explain the failures", "abhv-mc explain DIR --all" if flies else "")
    if len(binding) < len(verdicts.binding) or any(v.status != "PASS" for v in binding):
        return _advise_flights(models, binding)
    if any(verdict.set_later for verdict in binding):
        why = "confirm requirements set later with another seed"
        seeds = [campaign.seed, *campaign.pooled_seeds]
        command = f"abhv-mc run {_campaign_file(results)} -o DIR-confirmed --seed {max(seeds) + 1}"
        return NextStep(why, command if flies else "")
    if jointly := flights_for_joint_verdicts(verdicts):
        why = f"joint PASS of all verdicts: {grouped_digits(jointly)} flights without failures"
        return _longer_run(models, jointly, why)
    names = map(models.names.label, sorted({name for _, name, _ in verdicts.binding}))
    return NextStep(f"none: all requirements decided for {', '.join(names)}")


def _campaign_file(results: FlownCampaign) -> str:
    """Return the campaign file with the requirements of a report, or a placeholder."""
    if not results.judged_by:
        return "DIR/campaign.yaml"
    return shlex.quote(results.judged_by) if results.judged_by_campaign else "CAMPAIGN.yaml"


def flights_for_joint_verdicts(verdicts: Verdicts) -> int | None:
    """Return the number of flights at which all PASS verdicts would hold jointly.

    Return None if they already hold jointly. Joint verdicts follow Holm's procedure; the estimate
    assumes no further failures.
    """
    joint = verdicts.held_together
    if joint is None or not joint.dropped:
        return None
    passed = sorted(
        (
            verdict
            for item in verdicts.requirements
            for verdict in item.controllers.values()
            if verdict.status == "PASS" and not verdict.set_later
        ),
        key=lambda verdict: verdict.p_value,
    )
    shares = [joint.risk / (joint.verdicts - rank) for rank in range(len(passed))]
    return max(
        flights_to_pass(verdict.failures, verdict.probability, min(verdict.consumer_risk, share))
        for verdict, share in zip(passed, shares, strict=True)
    )


def _advise_flights(models: Models, binding: Sequence[Verdict]) -> NextStep | None:
    """Recommend a number of flights at which all binding verdicts are likely to be PASS.

    With unknown parameters, the numbers of flights and the chances are those at the worst point of
    each verdict.
    """
    open_ones = [verdict for verdict in binding if verdict.status == "NOT SHOWN"]
    if not open_ones:
        return None
    if any(UNSEARCHED in verdict.note for verdict in open_ones):
        return NextStep("worst unknowns not searched: use a new folder")
    at_points = " at each point" * bool(models.names.campaign.unknowns.names)
    if advice := advise(binding):
        why = (
            f"all PASS with {grouped_digits(advice.flights)} flights{at_points}: "
            f"{about(advice.chance)}"
        )
        return _longer_run(models, advice.flights, why, _ASSUMPTION)
    present = max(verdict.flights for verdict in open_ones)
    least = max(
        flights_to_pass(verdict.failures, verdict.probability, verdict.consumer_risk)
        for verdict in open_ones
    )
    separate = [single for verdict in open_ones if (single := advise([verdict]))]
    if least > MOST_TIMES * present and not separate:
        chance = about(min(predict_pass(verdict, least) for verdict in open_ones))
        why = f"PASS needs at least {grouped_digits(least)} flights{at_points}: {chance}"
        if least > _MOST_LONGER * present:
            return NextStep(why, assumption=_ASSUMPTION)
        return _longer_run(models, least, why, _ASSUMPTION)
    most = f"{grouped_digits(MOST_TIMES * present)} flights"
    return NextStep(
        f"PASS of all verdicts unlikely up to {most}{at_points}", assumption=_ASSUMPTION
    )


def _longer_run(models: Models, flights: int, why: str, assumption: str = "") -> NextStep:
    """Recommend more flights, and to judge them again by the requirements of this report."""
    if not models.names.campaign.can_rerun:
        return NextStep(f"import a larger table: {why}", assumption=assumption)
    command = f"abhv-mc run DIR/campaign.yaml -o DIR --runs {flights}"
    if source := models.results.judged_by:
        command += f" && abhv-mc report DIR --requirements {shlex.quote(source)} -o OUT"
    return NextStep(why, command, assumption)
