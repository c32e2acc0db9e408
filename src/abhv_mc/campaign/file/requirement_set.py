"""Requirement sets by which the flights of an existing campaign are judged again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.check import check_campaign
from abhv_mc.campaign.file.config import RequirementEntry
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.requirements import read_requirements
from abhv_mc.io.documents import (
    Document,
    InputError,
    InputErrors,
    StrictModel,
    found_value,
    read_document,
    validate,
)

# Campaign-file keys for judging and reporting, on which the flights do not depend.
JUDGING = ("requirements", "family", "question", "asks")
_PRESENTING = ("author", "figures", "measured", "tune")
_LIMITS = ("below", "above", "probability", "consumer_risk", "producer_risk", "ended_early")
_EMPTY = Path("requirements")  # file name in errors about requirements from Python code
RequirementSource = str | Path | Mapping[str, Any] | Sequence[Mapping[str, Any]]


class _Set(StrictModel, extra="ignore"):
    requirements: tuple[RequirementEntry, ...]


def data_of_rows(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a campaign on which the simulated flights depend.

    Entries about execution, requirements, questions and labels are omitted.
    """
    left_out = ("execution", *JUDGING, *_PRESENTING)
    row_data = {key: value for key, value in data.items() if key not in left_out}
    if isinstance(metrics := row_data.get("metrics"), dict):
        row_data["metrics"] = {
            name: {key: value for key, value in entry.items() if key != "label"}
            if isinstance(entry, dict)
            else entry
            for name, entry in metrics.items()
        }
    return row_data


def read_requirement_set(source: RequirementSource) -> Document:
    """Read requirements from a campaign, YAML or CSV file, or from entries in memory."""
    if isinstance(source, str | Path):
        path = Path(source)
        if path.suffix.lower() == ".csv":
            table = Document(path.parent / _EMPTY, {"requirements": path.name}, {(): (1, 1)}, {})
            return replace(read_requirements(table), path=path)
        document = read_document(path)
    else:
        data = source if isinstance(source, Mapping) else {"requirements": list(source)}
        document = Document(_EMPTY, {**data}, {(): (1, 1)}, {})
    document = read_requirements(document)
    if not isinstance(document.data, dict) or "requirements" not in document.data:
        expected = "a campaign file, or a file with the key 'requirements'"
        raise document.error((), found_value(document.data), expected)
    validate(
        document, _Set
    )  # Validate here, so that errors refer to locations in the requirement set.
    return document


def with_requirements(data: Mapping[str, Any], changed: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of a campaign with another set of requirements.

    The entry ``points`` still lists the requirements for which the worst values of the unknowns
    were searched.
    """
    judged = {**data, **{key: changed[key] for key in JUDGING if key in changed}}
    points, before = data.get("points") or {}, data.get("requirements") or []
    searched = "most_failures" in points and "requirements" not in points
    if searched and judged["requirements"] != before:
        judged["points"] = {**points, "requirements": before}
    return judged


def judge_by(campaign: Experiment, source: RequirementSource) -> Experiment:
    """Return a campaign whose flights are judged by another set of requirements.

    Raise InputErrors with source locations in the requirement set.
    """
    changed = read_requirement_set(source)
    data = with_requirements(campaign.document.entries, changed.entries)
    locations = {**campaign.document.value_places, **changed.value_places}
    keys = {**campaign.document.key_places, **changed.key_places}
    tables = [table for table in campaign.document.tables if "requirements" not in table.entries]
    document = replace(
        campaign.document,
        data=data,
        value_places=locations,
        key_places=keys,
        tables=(*changed.tables, *tables),
    )
    try:
        judged = check_campaign(document, campaign.engine)
    except InputErrors as error:  # The campaign was valid before the requirements were changed.
        raise InputErrors([_named(problem, changed.path) for problem in error.errors]) from None
    except InputError as error:
        raise _named(error, changed.path) from None
    return replace(judged, repeatability=campaign.repeatability, systems=campaign.systems)


def _named(error: InputError, file: Path) -> InputError:
    return InputError(file, error.found, error.expected, error.line, error.column)


def describe_requirement_changes(
    before: Mapping[str, Any], after: Mapping[str, Any]
) -> Iterator[str]:
    """Yield a description of each difference between the requirements of two campaigns.

    An example is 'speed_error_max_mps: below 5 -> 3'.
    """
    old, new = (_by_name(data.get("requirements") or []) for data in (before, after))
    for name in dict.fromkeys((*old, *new)):
        if name not in new:
            yield f"{name}: no longer required"
        elif name not in old:
            yield f"{name}: newly required"
        else:
            changes = [
                f"{key} {_text(old[name].get(key))} -> {_text(new[name].get(key))}"
                for key in _LIMITS
                if old[name].get(key) != new[name].get(key)
            ]
            if changes:
                yield f"{name}: {', '.join(changes)}"
    if before.get("family") != after.get("family"):
        yield f"family: {_text(before.get('family'))} -> {_text(after.get('family'))}"


def _by_name(entries: Sequence[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Return requirement entries keyed by id or metric; repeated keys are numbered."""
    named: dict[str, Mapping[str, Any]] = {}
    for entry in entries:
        name = str(entry.get("id") or entry["metric"])
        number = sum(key.partition(" ")[0] == name for key in named)
        named[name if not number else f"{name} ({number + 1})"] = entry
    return named


def _text(value: object) -> str:
    if isinstance(value, list):
        return " ".join(map(str, value))
    return "not set" if value is None else str(value)


def find_later_choices(
    first: Sequence[Mapping[str, Any]], current: Sequence[Mapping[str, Any]]
) -> frozenset[int]:
    """Return the indices of the current requirements that the first set does not contain.

    Requirements are compared by metric, side, probability, risk and treatment of early
    terminations. One-sided limits are not compared: if a changed limit yields a false PASS, the
    limit that the metric meets with exactly the required probability also yields one, so the risk
    does not increase. This does not hold for intervals, whose limits are compared.
    """
    first_choices = {_choice(entry) for entry in first}
    return frozenset(i for i, entry in enumerate(current) if _choice(entry) not in first_choices)


def _choice(entry: Mapping[str, Any]) -> tuple[object, ...]:
    sides = "below" in entry, "above" in entry
    interval = (str(entry["below"]), str(entry["above"])) if all(sides) else ()
    risks = (str(entry.get(key)) for key in ("probability", "consumer_risk", "producer_risk"))
    return (entry["metric"], *sides, *interval, *risks, entry.get("ended_early", "failure"))
