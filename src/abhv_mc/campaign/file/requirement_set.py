"""What of a campaign file judges flights and no flight depends on; campaigns judged by another set of requirements."""

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
    describe,
    read_document,
    validate,
)

# Keys of a campaign file that judge and present flights; rows depend on none of them.
JUDGING = ("requirements", "family", "question", "asks")
_PRESENTING = ("author", "figures", "measured", "tune")
_LIMITS = ("below", "above", "probability", "consumer_risk", "producer_risk", "ended_early")
_EMPTY = Path("requirements")  # what errors name if a set comes from Python
RequirementSource = str | Path | Mapping[str, Any] | Sequence[Mapping[str, Any]]


class _Set(StrictModel, extra="ignore"):
    requirements: tuple[RequirementEntry, ...]


def data_of_rows(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a campaign's data without what no row depends on: how it runs, what is required, asked and labelled."""
    left_out = ("execution", *JUDGING, *_PRESENTING)
    kept = {key: value for key, value in data.items() if key not in left_out}
    if isinstance(metrics := kept.get("metrics"), dict):
        kept["metrics"] = {
            name: {key: value for key, value in entry.items() if key != "label"}
            if isinstance(entry, dict)
            else entry
            for name, entry in metrics.items()
        }
    return kept


def read_requirement_set(source: RequirementSource) -> Document:
    """Read a set of requirements: a campaign file, a YAML file with ``requirements``, a CSV file, or entries.

    Raise InputErrors for anything else, each with its place.
    """
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
        wish = "a campaign file, or a file with 'requirements'"
        raise document.error((), describe(document.data), wish)
    validate(document, _Set)  # here, where the places are those of the file
    return document


def with_requirements(data: Mapping[str, Any], changed: Mapping[str, Any]) -> dict[str, Any]:
    """Return a campaign's data judged by another set; points of unknowns keep the requirements they were found for."""
    judged = {**data, **{key: changed[key] for key in JUDGING if key in changed}}
    points, before = data.get("points") or {}, data.get("requirements") or []
    searched = "most_failures" in points and "requirements" not in points
    if searched and judged["requirements"] != before:
        judged["points"] = {**points, "requirements": before}
    return judged


def judge_by(campaign: Experiment, source: RequirementSource) -> Experiment:
    """Return a campaign judged by another set of requirements. Raise InputErrors in the places of the set."""
    changed = read_requirement_set(source)
    data = with_requirements(campaign.document.entries, changed.entries)
    places = {**campaign.document.value_places, **changed.value_places}
    keys = {**campaign.document.key_places, **changed.key_places}
    document = replace(campaign.document, data=data, value_places=places, key_places=keys)
    try:
        judged = check_campaign(document, campaign.engine)
    except InputErrors as error:  # the campaign alone was right
        raise InputErrors([_named(each, changed.path) for each in error.errors]) from None
    except InputError as error:
        raise _named(error, changed.path) from None
    return replace(judged, repeatability=campaign.repeatability, systems=campaign.systems)


def _named(error: InputError, file: Path) -> InputError:
    return InputError(file, error.found, error.expected, error.line, error.column)


def describe_requirement_changes(
    before: Mapping[str, Any], after: Mapping[str, Any]
) -> Iterator[str]:
    """Yield what differs between the requirements of two campaigns: 'speed_error_max_mps: below 5 -> 3'."""
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
    """The entries by id or metric; a second one of a metric by its place, too."""
    named: dict[str, Mapping[str, Any]] = {}
    for entry in entries:
        name = str(entry.get("id") or entry["metric"])
        number = sum(key.partition(" ")[0] == name for key in named)
        named[name if not number else f"{name} ({number + 1})"] = entry
    return named


def _text(value: object) -> str:
    if isinstance(value, list):
        return " ".join(map(str, value))
    return "nothing" if value is None else str(value)


def find_later_choices(
    first: Sequence[Mapping[str, Any]], current: Sequence[Mapping[str, Any]]
) -> frozenset[int]:
    """Return the numbers of current requirements whose metric, side, probability or risk is none of the first set's.

    Another limit on the same metric keeps its risk: its verdict is valid however often flights are looked at.
    """
    known = {_choice(entry) for entry in first}
    return frozenset(i for i, entry in enumerate(current) if _choice(entry) not in known)


def _choice(entry: Mapping[str, Any]) -> tuple[object, ...]:
    sides = "below" in entry, "above" in entry
    risks = (str(entry.get(key)) for key in ("probability", "consumer_risk", "producer_risk"))
    return (entry["metric"], *sides, *risks, entry.get("ended_early", "failure"))
