"""Report topic: verdicts on the requirements, for each controller and jointly."""

from collections.abc import Set

from abhv_mc.campaign.file.config import TRACED
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.topics.formatting import count_of, percent, significant
from abhv_mc.topics.topic import (
    Cell,
    Fold,
    Names,
    Row,
    Section,
    Table,
    Text,
    Topic,
    grouped,
    make_row,
)
from abhv_mc.topics.verdicts.model import (
    ControllerVerdict,
    JudgedRequirement,
    Verdicts,
    compute_verdicts,
)

_DASH = "\N{EM DASH}"
_ALONE = "not jointly"
_HEADS = (
    "Verdict",
    "Failed",
    "of these terminated early",
    "of these not computed",
    "Tolerance limit",
    "Margin to the limit",
    "Flights needed",
)
_RULE = (
    "PASS: if the true success probability were below the requirement, the chance of observing "
    "this few failures would be at most the consumer's risk. FAIL: if the requirement were "
    "met, the chance of observing this many failures would be at most the producer's risk. NOT "
    "SHOWN: neither PASS nor FAIL. The rule stays valid when results are checked repeatedly or the "
    "campaign is extended. The tolerance limit contains the required share of flights with a "
    "confidence of 1 minus the consumer's risk; for a PASS, it lies within the requirement. Joint "
    "verdicts limit the risk of any false PASS (Holm)."
)
_LATER = " Verdicts marked 'set later' have no stated risk: the results were already known."
_ESTIMATES = (
    "Exact binomial statistics require independent flights, so the counts below are estimates"
)
_RANDOM = "; run the campaign with `sampling: random` for verdicts"


def verdict_section(verdicts: Verdicts, names: Names) -> Section:
    """Return the section with the decision rule and the verdicts on each requirement."""
    title = "Requirements"
    if not verdicts.requirements:
        return Section(title, (Text("The campaign has no requirements."),))
    joint = verdicts.held_together
    dropped = joint.dropped if joint else ()
    groups = tuple(
        _group(entry, names, {name for number, name in dropped if number == k})
        for k, entry in enumerate(verdicts.requirements)
    )
    heads = "Requirement", names.kind, *_HEADS
    table = Table("Requirements in full", heads, groups, numbers=False)
    text = _RULE
    if any(v.set_later for entry in verdicts.requirements for v in entry.controllers.values()):
        text += _LATER
    if not names.campaign.judged:
        campaign = names.campaign
        why = f"{campaign.dependence[:1].upper()}{campaign.dependence[1:]}."
        is_random = campaign.has_noise or not campaign.can_rerun
        text = f"{why} {_ESTIMATES}{'' if is_random else _RANDOM}."
    fold = (_other_intervals(verdicts, names),) if names.campaign.judged else ()
    return Section(title, (Text(text), Fold(table.title, (table,)), *fold))


def _other_intervals(verdicts: Verdicts, names: Names) -> Fold:
    """Return binomial intervals for reviewers who use other decision rules."""
    groups = tuple(
        grouped(
            [
                make_row(
                    names.label(name),
                    percent(verdict.one_look_bound),
                    " to ".join(map(percent, verdict.failure_rate or ())),
                )
                for name, verdict in entry.controllers.items()
            ],
            Cell(f"{entry.asked.traced.get('id', '')} {entry.words}".strip(), head=True),
        )
        for entry in verdicts.requirements
    )
    text = (
        "These intervals are valid if the number of flights was fixed in advance and results are "
        "checked once: the lower bound on the success probability at the consumer's risk (Clopper "
        "and Pearson), and the 95 % interval of the failure probability from Jeffreys' prior."
    )
    heads = (
        "Requirement",
        names.kind,
        "Success at least (Clopper-Pearson)",
        "Failure probability (Jeffreys)",
    )
    title = "Binomial intervals for a single check"
    return Fold(title, (Text(text), Table(title, heads, groups)))


def _group(entry: JudgedRequirement, names: Names, dropped: Set[str]) -> tuple[Row, ...]:
    item, traced = entry.asked, entry.asked.traced
    note = (
        f"in {percent(item.probability)} of the flights, consumer's risk "
        f"{percent(item.consumer_risk)}"
    )
    trace = " \N{MIDDLE DOT} ".join(traced[key] for key in TRACED if key != "id" and key in traced)
    notes = "; ".join(filter(None, (note, trace)))
    rows = []
    for name, verdict in entry.controllers.items():
        texts = (
            count_of(verdict.failures, verdict.flights),
            str(verdict.ended_early),
            str(verdict.uncomputed),
            *_tolerance(verdict, item, names),
            verdict.advice or _DASH,
        )
        binding = "binding" if name in item.controllers else ""
        label = Cell(verdict.label, verdict.note or _ALONE * (name in dropped), verdict=True)
        rows.append((Cell(names.label(name), binding, head=True), label, *map(Cell, texts)))
    return grouped(rows, Cell(f"{traced.get('id', '')} {entry.words}".strip(), notes, head=True))


def _tolerance(verdict: ControllerVerdict, item: Requirement, names: Names) -> tuple[str, str]:
    """Return the tolerance limit and its margin to the required limit as strings."""
    if verdict.status == "ESTIMATE":
        return _DASH, _DASH
    if verdict.tolerance_limit is None:
        return ("too many early terminations" if verdict.beyond_lost else "too few flights"), _DASH
    value, limits = verdict.tolerance_limit, item.limits
    sign = "" if limits.both else "> " if limits.high is None else "< "
    limit = sign + names.metrics[item.metric].with_unit(
        significant(abs(value) if limits.both else value, 4)
    )
    if limits.both:
        limit += " outside" if value > 0.0 else " inside"
    if verdict.room is None:
        return limit, _DASH
    side = "inside" if verdict.room > 0.0 else "beyond"
    return limit, f"{percent(abs(verdict.room), 2)} {side}"


VERDICTS = Topic("verdicts", Verdicts, compute_verdicts, verdict_section)
