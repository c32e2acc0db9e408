"""Next step that is recommended after a campaign, with its reason."""

from collections.abc import Sequence

from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.verdicts import MOST_TIMES, UNSEARCHED, Verdict, about, advise
from abhv_mc.topics.formatting import fixed
from abhv_mc.topics.section import Entry
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import Verdicts

# largest number of flights for which a command is suggested, as a multiple of the present number
_MOST_LONGER = 100


def next_step(models: Models) -> Entry | None:
    """Return a command and its reason; None if the campaign is incomplete or not judged."""
    results, verdicts = models.results, models[VERDICTS]
    campaign, manifest = results.campaign, results.manifest
    if manifest.state != "complete":
        return None
    runs = campaign.runs_at_point
    if (manifest.file_runs or 0) > runs:
        remaining = fixed((manifest.file_runs or 0) - runs, 0)
        return _longer_run(manifest.file_runs or 0, f"{remaining} flights not yet run", models)
    if not campaign.judged:
        return None
    if not verdicts.requirements:
        command = "`abhv-mc run FILE -o DIR`: " * campaign.can_rerun
        return Entry((), f"{command}add requirements for verdicts")
    binding = verdicts.binding()
    failed = [verdict for verdict in binding if verdict.status == "FAIL"]
    undecided = [verdict for verdict in binding if verdict.status == "NOT SHOWN"]
    if failed:
        changes = results.requirement_changes
        if changes and not changes[-1].time:
            return Entry((), "`abhv-mc run FILE -o DIR`: adopt these requirements")
        command = "`abhv-mc explain DIR --all`" if campaign.can_rerun else "'Failure analysis'"
        return Entry((), f"{command}: FAIL {len(failed)} of {len(binding)}")
    if undecided:
        return _advise_flights(binding, undecided, models)
    if jointly := flights_for_joint_verdicts(verdicts):
        return _longer_run(jointly, "joint PASS, if no more flights fail", models)
    return Entry((), "none: all requirements are decided")


def flights_for_joint_verdicts(verdicts: Verdicts) -> int | None:
    """Return the number of flights at which all PASS verdicts would hold jointly.

    Return None if they already hold jointly. Joint verdicts follow Holm's procedure; the estimate
    assumes no further failures.
    """
    joint = verdicts.held_together
    if joint is None or not joint.dropped:
        return None
    all_verdicts = [
        verdict for item in verdicts.requirements for verdict in item.controllers.values()
    ]
    passed = sorted(
        (verdict for verdict in all_verdicts if verdict.status == "PASS"),
        key=lambda verdict: verdict.p_value,
    )
    shares = [joint.risk / (joint.verdicts - rank) for rank in range(len(passed))]
    return max(
        flights_to_pass(verdict.failures, verdict.probability, min(verdict.consumer_risk, share))
        for verdict, share in zip(passed, shares, strict=True)
    )


def _advise_flights(
    binding: Sequence[Verdict], undecided: Sequence[Verdict], models: Models
) -> Entry:
    """Recommend a number of flights at which all binding verdicts are likely to be PASS."""
    if any(UNSEARCHED in verdict.note for verdict in undecided):
        return Entry((), "a new folder: worst values of unknowns not searched")
    if advice := advise(binding):
        reason = f"P(all PASS) {about(advice.chance)} if failure rates independent"
        return _longer_run(advice.flights, reason, models)
    flights = max(verdict.flights for verdict in undecided)
    least = max(
        flights_to_pass(verdict.failures, verdict.probability, verdict.consumer_risk)
        for verdict in undecided
    )
    if MOST_TIMES * flights < least <= _MOST_LONGER * flights:
        return _longer_run(least, "least number, if no more flights fail", models)
    return Entry((), f"none: all PASS unlikely up to {fixed(MOST_TIMES * flights, 0)} flights")


def _longer_run(flights: int, reason: str, models: Models) -> Entry:
    command = f"`abhv-mc run DIR/campaign.yaml -o DIR --runs {flights}`"
    if not models.results.campaign.can_rerun:
        command = f"import {fixed(flights, 0)} flights"
    return Entry((), f"{command}: {reason}")
