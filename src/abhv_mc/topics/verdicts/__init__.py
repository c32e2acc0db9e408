"""Whether each requirement is met, on each controller and jointly: in sentences and as a table."""

from collections.abc import Sequence

from abhv_mc.campaign.file.config import TRACED
from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Cell, Fold, Row, Section, Table, Text, grouped
from abhv_mc.topics.topic import Topic
from abhv_mc.topics.verdicts.model import (
    ControllerVerdict,
    JudgedRequirement,
    Verdicts,
    compute_verdicts,
)
from abhv_mc.topics.words import count_of, joined, percent, significant

_DROPPED = 4  # verdicts that do not stand jointly, told by name
_DASH = "\N{EM DASH}"
_HEADS = (
    "Verdict",
    "Failed",
    "of these ended early",
    "of these not computed",
    "Tolerance limit",
    "Room to the requirement",
    "What would show it",
)
_RULE = (
    "PASS: if the true success probability were below the requirement, so few failures would occur with at most the "
    "consumer's risk, however often one looks or extends. FAIL: if it were met, so many would occur with at most the "
    "producer's risk. NOT SHOWN: neither. The tolerance limit is what the required share of flights stays within, with "
    "a confidence of 1 less the consumer's risk; PASS says that it lies within the requirement."
)
_ESTIMATES = "Exact binomial statistics need independent flights: the counts below are estimates"
_RANDOM = "; fly the campaign with `sampling: random` for verdicts"


def verdict_sentences(verdicts: Verdicts, names: Names) -> Sequence[str]:
    """How many requirements each controller meets, and how many PASS stand jointly; none without requirements."""
    if not verdicts.requirements:
        return []
    parts = []
    for name in names.controllers:
        words = verdicts.statuses(name)
        counts = [
            f"{words.count(word)} {word}" for word in ("PASS", "FAIL", "NOT SHOWN") if word in words
        ]
        if "ESTIMATE" in words:
            counts = [f"{count_of(verdicts.kept(name), len(words))} kept in every flight"]
        parts.append(f"{names.label(name)} {joined(counts)}")
    return [f"Requirements: {'; '.join(parts)}.{_together_words(verdicts, names)}"]


def _together_words(verdicts: Verdicts, names: Names) -> str:
    """How many of several PASS hold at one risk for all verdicts, and which do not."""
    held = verdicts.held_together
    if held is None or held.stand + len(held.dropped) < 2:
        return ""
    risk = f"at most {percent(held.risk, 2)} chance of any false PASS among {held.verdicts} verdicts (Holm)"
    if verdicts.family_risk or not held.dropped:
        return f" {'They hold' if verdicts.family_risk else 'All PASS also hold'} together, with {risk}."
    dropped = [
        f"{verdicts.requirements[i].words} ({names.label(name)})" for i, name in held.dropped
    ]
    passed = held.stand + len(dropped)
    named = f"; not {joined(dropped)}" if held.stand and len(dropped) <= _DROPPED else ""
    return f" Taken together, with {risk}, {held.stand or 'none'} of the {passed} PASS would stand{named}."


def verdict_section(verdicts: Verdicts, names: Names) -> Section:
    """The rule, and each requirement with its verdicts."""
    title = "What was asked and what came out"
    if not verdicts.requirements:
        return Section(title, (Text("The campaign requires nothing."),))
    groups = tuple(_group(entry, names) for entry in verdicts.requirements)
    heads = "Requirement", names.campaign.kind.capitalize(), *_HEADS
    table = Table("Requirements in full", heads, groups, numbers=False)
    text = _RULE
    if verdicts.held_together is None:
        campaign = names.campaign
        why = f"{campaign.dependence[:1].upper()}{campaign.dependence[1:]}."
        is_random = campaign.has_noise or not campaign.can_rerun
        text = f"{why} {_ESTIMATES}{'' if is_random else _RANDOM}."
    fold = (_other_intervals(verdicts, names),) if verdicts.held_together is not None else ()
    return Section(title, (Text(text), Fold(table.title, (table,)), *fold))


def _other_intervals(verdicts: Verdicts, names: Names) -> Fold:
    """Return binomial intervals for reviewers who use other rules."""
    rows = [
        (
            Cell(f"{entry.asked.traced.get('id', '')} {entry.words}".strip(), head=True),
            Cell(names.label(name), head=True),
            Cell(percent(verdict.one_look_bound)),
            Cell(" to ".join(map(percent, verdict.failure_rate or ()))),
        )
        for entry in verdicts.requirements
        for name, verdict in entry.controllers.items()
    ]
    text = (
        "Valid if the number of flights was fixed before and the counts are looked at once: the lower bound on the "
        "success probability at the consumer's risk (Clopper and Pearson), and the 95 % interval of the failure "
        "probability from Jeffreys' prior."
    )
    heads = (
        "Requirement",
        names.campaign.kind.capitalize(),
        "Success at least (Clopper-Pearson)",
        "Failure probability (Jeffreys)",
    )
    title = "Binomial intervals for one look"
    return Fold(title, (Text(text), Table(title, heads, tuple((row,) for row in rows))))


def _group(entry: JudgedRequirement, names: Names) -> tuple[Row, ...]:
    item, traced = entry.asked, entry.asked.traced
    note = f"in {percent(item.probability)} of the flights, consumer's risk {percent(item.consumer_risk)}"
    told = " \N{MIDDLE DOT} ".join(traced[key] for key in TRACED if key != "id" and key in traced)
    notes = "; ".join(filter(None, (note, told)))
    rows = [
        _row(names.label(name), name, item, verdict, names)
        for name, verdict in entry.controllers.items()
    ]
    return grouped(rows, Cell(f"{traced.get('id', '')} {entry.words}".strip(), notes, head=True))


def _row(label: str, name: str, item: Requirement, verdict: ControllerVerdict, names: Names) -> Row:
    return (
        Cell(label, "binding" if name in item.controllers else "", head=True),
        Cell(verdict.status, verdict.note, verdict=True),
        Cell(count_of(verdict.failures, verdict.flights)),
        Cell(str(verdict.ended_early)),
        Cell(str(verdict.uncomputed)),
        *map(Cell, _tolerance(verdict, item, names)),
        Cell(verdict.advice or _DASH),
    )


def _tolerance(found: ControllerVerdict, item: Requirement, names: Names) -> tuple[str, str]:
    """The tolerance limit, and the room between it and what is required."""
    if found.status == "ESTIMATE":
        return _DASH, _DASH
    if found.tolerance_limit is None:
        return ("too many flights lost" if found.beyond_lost else "too few flights"), _DASH
    value, limits = found.tolerance_limit, item.limits
    sign = "" if limits.both else "> " if limits.high is None else "< "
    limit = sign + names.metrics[item.metric].with_unit(
        significant(abs(value) if limits.both else value, 4)
    )
    if limits.both:
        limit += " outside" if value > 0.0 else " inside"
    if found.room is None:
        return limit, _DASH
    missed = "too little" if limits.high is None else "too much"
    return limit, f"{percent(abs(found.room), 2)} {'to spare' if found.room > 0.0 else missed}"


VERDICTS = Topic("verdicts", Verdicts, compute_verdicts, verdict_section, verdict_sentences)
