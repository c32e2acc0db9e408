"""Who flew which flights of a campaign: the manifest's ``flown_by``."""

from collections.abc import Iterable
from dataclasses import replace

from abhv_mc.folder.manifest import FlownBy
from abhv_mc.identity import Flyer

Ranges = tuple[tuple[int, int], ...]


def note_flyers(
    entries: Iterable[FlownBy], flyers: tuple[Flyer, ...], controller: str, first: int, stop: int
) -> tuple[FlownBy, ...]:
    """The entries with the flights ``first`` .. ``stop - 1`` as theirs, and no longer anybody else's."""
    kept = []
    for entry in entries:
        ranges = entry.blocks.get(controller, ())
        others = [(a, min(b, first)) for a, b in ranges if a < first] + [
            (max(a, stop), b) for a, b in ranges if b > stop
        ]
        kept.append(replace(entry, blocks={**entry.blocks, controller: tuple(others)}))
    theirs = [FlownBy(*flyer[:5], blocks={controller: ((first, stop),)}) for flyer in flyers]
    return tuple(entry for entry in join_flyers([*kept, *theirs]) if any(entry.blocks.values()))


def shift_flyers(entries: Iterable[FlownBy], flights: int) -> list[FlownBy]:
    """The entries with so much higher numbers of flights."""
    return [
        replace(
            entry,
            blocks={name: tuple((a + flights, b + flights) for a, b in part) for name, part in entry.blocks.items()},
        )
        for entry in entries
    ]


def join_flyers(entries: Iterable[FlownBy]) -> tuple[FlownBy, ...]:
    """The entries of each process as one."""
    joined: dict[tuple[str, str, str, str, str], dict[str, Ranges]] = {}
    for entry in entries:
        blocks = joined.setdefault((entry.code, entry.versions, entry.processor, entry.features, entry.host), {})
        for controller, ranges in entry.blocks.items():
            blocks[controller] = _join((*blocks.get(controller, ()), *ranges))
    return tuple(FlownBy(*who, blocks=blocks) for who, blocks in joined.items())


def _join(ranges: Ranges) -> Ranges:
    """Ranges in order, those that touch as one."""
    joined: list[tuple[int, int]] = []
    for first, stop in sorted(ranges):
        if joined and first <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(stop, joined[-1][1])
        else:
            joined.append((first, stop))
    return tuple(joined)
