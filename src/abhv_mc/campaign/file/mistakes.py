"""What else is wrong in a campaign file of which a part cannot be read, so that everything is said at once."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from abhv_mc.campaign.file.simulator import is_own
from abhv_mc.io.documents import Document, InputError, InputErrors

Place = tuple[int, int]
# What is judged by another section, and so not at all where that one is wrong.
_RESTS_ON = {
    "dispersions": ("sampling", "inputs"),
    "unknowns": ("inputs",),
    "correlations": ("dispersions", "sampling"),
    "derived": ("dispersions",),
    "metrics": ("channels",),
    "requirements": ("metrics", "channels", "systems"),
    "stop": ("requirements", "runs", "sampling"),
    "margins": ("runs", "mission"),
    "keep": ("metrics", "channels", "runs"),
    "tune": ("metrics", "channels"),
}
_INSTEAD: dict[str, Any] = {"runs": 1_000_000, "margins": {"flights": "all"}}  # of a section that is not judged


def find_more(document: Document, known: Sequence[InputError], check: Callable[[Document], Any]) -> InputErrors:
    """The mistakes that are known, and those that ``check`` finds in what is left without them, in order of place.

    ``check`` is called once: it looks for no more by itself.
    """
    told = {(error.line or 0, error.column or 0) for error in known}
    wrong = {_part_at(document, place) for place in told}
    here = document.path.name  # a file that is there, in the place of one that is not
    data: dict[str, Any] = {"name": "name", "vehicle": here, "mission": here, "controllers": {"name": here}}
    if is_own(document.data):
        data = {"name": "name", "simulator": {"command": [here]}, "metrics": {"name": {}}}
    places: dict[tuple[Any, ...], Place] = {}
    for section, value in document.data.items() if isinstance(document.data, dict) else ():
        items = {keys[1] for keys in wrong if keys[:1] == (section,) and len(keys) > 1}
        if (section,) in wrong or any(keys[:1] == (other,) for keys in wrong for other in _RESTS_ON.get(section, ())):
            data |= {section: _INSTEAD[section]} if section in _INSTEAD else {}
        elif section == "controllers" and isinstance(value, dict):
            data[section] = {name: here if name in items else file for name, file in value.items()}
        elif isinstance(value, dict) and items:
            data[section] = {key: item for key, item in value.items() if key not in items}
        elif isinstance(value, list) and items:
            kept = [i for i in range(len(value)) if i not in items]
            data[section] = [value[i] for i in kept]
            places |= _moved(document.value_places, section, kept)
        else:
            data[section] = value
    errors = list(known)
    try:
        check(replace(document, data=data, value_places={**document.value_places, **places}))
    except InputErrors as more:
        errors += [error for error in more.errors if (error.line, error.column) not in told]
    except InputError as other:  # of another file that it names
        errors.append(other)
    return InputErrors(sorted(errors, key=lambda error: (error.line or 0, error.column or 0)))


def _part_at(document: Document, place: Place) -> tuple[Any, ...]:
    """The section at a place, or the entry of a section: the whole of a block begins where its first key does."""
    named = (
        keys for places in (document.value_places, document.key_places) for keys in places if places[keys] == place
    )
    return min(filter(None, named), key=len, default=())[:2]


def _moved(places: Mapping[tuple[Any, ...], Place], section: str, kept: list[int]) -> dict[tuple[Any, ...], Place]:
    """Where the items of a list that are kept stand, by their new numbers."""
    return {
        (section, new, *keys[2:]): place
        for keys, place in places.items()
        for new, old in enumerate(kept)
        if keys[:2] == (section, old)
    }
