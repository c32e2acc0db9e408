"""Who flew which flights of a campaign: the manifest's ``flown_by``."""

from typing import Any

from abhv_mc.identity import Flyer

Entries = list[dict[str, Any]]  # facts of a flyer, and ``blocks``: controller -> [[first flight, one after the last]]
_NAMED = ("code", "versions", "processor", "features", "host")


def note_flyers(entries: Entries, flyers: tuple[Flyer, ...], controller: str, first: int, stop: int) -> Entries:
    """The entries with the flights ``first`` .. ``stop - 1`` as theirs, and no longer anybody else's."""
    kept = [{**entry, "blocks": dict(entry["blocks"])} for entry in entries]
    for entry in kept:
        ranges = entry["blocks"].get(controller, [])
        before = [[a, min(b, first)] for a, b in ranges if a < first]
        entry["blocks"][controller] = before + [[max(a, stop), b] for a, b in ranges if b > stop]
    for flyer in flyers:
        facts = {name: getattr(flyer, name) for name in _NAMED}
        theirs = next((entry for entry in kept if entry.items() >= facts.items()), None)
        if theirs is None:
            kept.append(theirs := facts | {"blocks": {}})
        theirs["blocks"][controller] = _join([*theirs["blocks"].get(controller, []), [first, stop]])
    return [entry for entry in kept if any(entry["blocks"].values())]


def shift_flyers(entries: Entries, flights: int) -> Entries:
    """The entries with so much higher numbers of flights."""
    return [
        {**entry, "blocks": {name: [[a + flights, b + flights] for a, b in ranges] for name, ranges in blocks.items()}}
        for entry in entries
        for blocks in [entry["blocks"]]
    ]


def join_flyers(parts: list[Entries]) -> Entries:
    """The entries of shards as one campaign's."""
    joined: Entries = []
    for entry in [entry for part in parts for entry in part]:
        same = next((one for one in joined if all(one[name] == entry[name] for name in _NAMED)), None)
        if same is None:
            joined.append(same := {**entry, "blocks": {}})
        for controller, ranges in entry["blocks"].items():
            same["blocks"][controller] = _join([*same["blocks"].get(controller, []), *ranges])
    return joined


def _join(ranges: list[list[int]]) -> list[list[int]]:
    """Ranges in order, those that touch as one."""
    joined: list[list[int]] = []
    for first, stop in sorted(ranges):
        if joined and first <= joined[-1][1]:
            joined[-1] = [joined[-1][0], max(stop, joined[-1][1])]
        else:
            joined.append([first, stop])
    return joined
