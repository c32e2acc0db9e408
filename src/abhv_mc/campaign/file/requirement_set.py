"""Requirement sets by which the flights of an existing campaign are judged again."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abhv_mc.campaign.file.check import check_campaign
from abhv_mc.campaign.file.config import TRACED, RequirementEntry
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.requirements import read_requirements, select_requirements
from abhv_mc.io.documents import Document, StrictModel, read_document, validate
from abhv_mc.io.messages import InputError, InputErrors, found_value

# Campaign-file keys for judging and reporting, on which the flights do not depend.
JUDGING = ("requirements", "family", "under_test", "question", "asks")
_PRESENTING = ("author", "figures", "measured", "tune")
_JUDGED = tuple(key for key in RequirementEntry.model_fields if key not in TRACED)
_EMPTY = Path("requirements")  # file name in errors about requirements from Python code
RequirementSource = str | Path | Mapping[str, Any] | Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class RequirementChange:
    """Change of one key by which flights are judged."""

    requirement: str  # id of the requirement, or else its metric
    key: str
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.requirement}: {self.key} {self.old} -> {self.new}"


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
        raise document.error(
            (), found_value(document.data), "a campaign file, or a file with the key 'requirements'"
        )
    validate(
        document, _Set
    )  # Validate here, so that errors refer to locations in the requirement set.
    return document


def is_campaign(source: RequirementSource) -> bool:
    """Return whether the source of requirements is a campaign file."""
    is_document = isinstance(source, str | Path) and Path(source).suffix.lower() != ".csv"
    return is_document and "name" in read_document(Path(str(source))).entries


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
    _check_metrics(campaign.document.entries, changed)
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


def _check_metrics(stored: Mapping[str, Any], changed: Document) -> None:
    """Raise InputError if a required metric has another definition, such as another window."""
    metrics = changed.entries.get("metrics") or {}
    if isinstance(metrics, str):
        metrics = read_document(changed.resolve(metrics)).entries
    for name in {entry["metric"] for entry in changed.entries["requirements"]}:
        pair = [data.get(name) for data in (stored.get("metrics") or {}, metrics)]
        old, new = (entry if isinstance(entry, dict) else {} for entry in pair)
        for key in old.keys() | new.keys() if old and new else ():
            if key not in ("label", "doc") and old.get(key) != new.get(key):
                change = f"{key} {_text(old.get(key))} -> {_text(new.get(key))}"
                raise changed.error(
                    ("metrics", name),
                    f"the definition of the metric '{name}' differs ({change})",
                    "the definition of the stored flights",
                )


def _named(error: InputError, file: Path) -> InputError:
    return InputError(file, error.found, error.expected, error.line, error.column)


def find_requirement_changes(
    before: Mapping[str, Any], after: Mapping[str, Any]
) -> Iterator[RequirementChange]:
    """Yield the differences between the requirements of two campaigns.

    Requirements are identified by id or, without an id, by their position among the requirements
    that differ. Controllers that only one of the campaigns has are not compared.
    """
    shared = [name for name in _systems(before) if name in _systems(after)]
    old, new = (
        [*(select_requirements(entries, shared) if shared else entries)]
        for entries in (data.get("requirements") or [] for data in (before, after))
    )
    for name, first, second in _pair_requirements(old, new):
        if first is None or second is None:
            yield RequirementChange(name, "requirement", _limit_text(first), _limit_text(second))
            continue
        parsed = [RequirementEntry.model_validate(entry) for entry in (first, second)]
        for key in ("id", *_JUDGED):
            values = [getattr(entry, key) for entry in parsed]
            if values[0] != values[1]:
                texts = (
                    _text(entry.get(key, value))
                    for entry, value in zip((first, second), values, strict=True)
                )
                yield RequirementChange(name, key, *texts)
    for key in ("family", "under_test"):
        pair: list[Any] = [data.get(key) for data in (before, after)]
        if key == "under_test":
            if None in pair:  # Sets stored by earlier versions lack the key.
                continue
            pair = [[name for name in names if name in (shared or names)] for names in pair]
        if pair[0] != pair[1]:
            yield RequirementChange("all requirements", key, *map(_text, pair))


def _pair_requirements(
    old: Sequence[Mapping[str, Any]], new: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[str, Mapping[str, Any] | None, Mapping[str, Any] | None]]:
    """Yield name, old and new entry of each requirement; None for a missing entry."""
    before, after = [*old], [*new]

    def take(matches: Callable[[Mapping[str, Any], Mapping[str, Any]], bool]) -> Iterator[Any]:
        for first in [*before]:
            second = next((entry for entry in after if matches(first, entry)), None)
            if second is not None:
                before.remove(first)
                after.remove(second)
                yield first, second

    pairs = [
        *take(lambda a, b: a == b),
        *take(lambda a, b: "id" in a and a["id"] == b.get("id")),
        *take(lambda a, b: {**a, "id": None} == {**b, "id": None}),
        *take(lambda a, b: "id" not in a and "id" not in b),
        *((entry, None) for entry in before),
        *((None, entry) for entry in after),
    ]
    metrics = [entry["metric"] for entry in old]
    for first, second in pairs:
        entry = first or second
        name = str(entry.get("id") or entry["metric"])
        if first and "id" not in first and metrics.count(first["metric"]) > 1:
            name += f" ({old.index(first) + 1})"
        yield name, first, second


def _systems(data: Mapping[str, Any]) -> Sequence[str]:
    return tuple(data.get("systems") or data.get("controllers") or ())


def _limit_text(entry: Mapping[str, Any] | None) -> str:
    keys = [key for key in ("above", "below", "probability") if entry and key in entry]
    return " ".join(f"{key} {_text((entry or {})[key])}" for key in keys) or "none"


def _text(value: object) -> str:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return "not set" if value is None else str(value)


def find_later_choices(
    first: Sequence[Mapping[str, Any]], current: Mapping[str, Any], controllers: Sequence[str]
) -> frozenset[tuple[int, str]]:
    """Return the current requirements, with controllers, that the ``first`` sets do not contain.

    The result contains the index of the requirement and the controller. Requirements are compared
    by metric, side, probability, risk, treatment of early terminations, and the controllers that
    must meet them. One-sided limits are not compared: if a changed limit yields a false PASS, the
    limit that the metric meets with exactly the required probability also yields one, so the risk
    does not increase. This does not hold for intervals, whose limits are compared.
    """
    return frozenset(
        (i, name)
        for i, entry in enumerate(current.get("requirements") or [])
        for name in controllers
        if not any(
            _choice(other) == _choice(entry)
            and (not _binds(current, entry, name) or _binds(data, other, name))
            for data in first
            for other in data.get("requirements") or []
        )
    )


def _binds(data: Mapping[str, Any], entry: Mapping[str, Any], name: str) -> bool:
    """Return whether a controller has to meet a requirement, or is unknown to the campaign."""
    bound = entry.get("controllers") or data.get("under_test")
    return not bound or name in bound or name not in (_systems(data) or (name,))


def _choice(entry: Mapping[str, Any]) -> tuple[object, ...]:
    sides = "below" in entry, "above" in entry
    interval = (str(entry["below"]), str(entry["above"])) if all(sides) else ()
    parsed = RequirementEntry.model_validate(entry)
    excluded = ("below", "above", "controllers")
    return *sides, *interval, *(getattr(parsed, key) for key in _JUDGED if key not in excluded)
