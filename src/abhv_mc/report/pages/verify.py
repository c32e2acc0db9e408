"""A campaign's folder checked against itself: its files' hashes, and every number of its report from the data."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.hashes import find_damage
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.io.documents import InputError
from abhv_mc.report.numbers.compare import compare_baseline
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.pages.build import hash_files, hash_pages
from abhv_mc.topics.topic import Models, user_topics


def verify_campaign(root: Path) -> Iterator[str]:
    """What does not fit the rest of a folder, a sentence each; of a search its files alone. Raises InputError."""
    folder = CampaignFolder(root)
    manifest = read_manifest(folder.manifest)
    if holder := lock_holder(folder.lock):
        raise InputError(root, f"a campaign that {holder} is flying", "the end of that run")
    damage = list(find_damage(folder, manifest))
    yield from (f"{path.relative_to(folder.root).as_posix()}: {words}" for path, words in damage)
    if not damage and manifest.search is None:
        yield from _report_differences(root)


def _report_differences(root: Path) -> Iterator[str]:
    path = root / "report.json"
    if not path.is_file():
        if (root / "report.html").is_file():
            yield "report.json: missing, although report.html is there"
        return
    try:
        written: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        files, pages, pictures = (written.pop(name) for name in ("files", "pages", "pictures"))
    except (ValueError, KeyError) as error:
        raise InputError(path, f"no report's numbers ({error})", f"abhv-mc report {root}") from None
    written.pop("key", None)
    yield from differences(files, hash_files(root), "files")
    yield from differences(pages, hash_pages(root, pages), "pages")
    yield from differences(pictures, hash_pages(root, pictures), "pictures")
    baseline = Path(written["baseline"]["folder"]) if "baseline" in written else None
    if baseline is not None and not baseline.is_dir():
        yield f"baseline: {baseline} is no longer there to compare with"
        del written["baseline"]
        baseline = None
    results = read_flown(root)
    held = compare_baseline(results, baseline) if baseline else None
    remade = json.loads(json.dumps(make_numbers(Models(results), held)))
    users = [
        each.pop("topics", {}) for each in (written, remade)
    ]  # of those installed then, and now
    yield from differences(written, remade)
    written, remade = (
        {name: users[k][name] for name in users[0] if name in users[1]} for k in (0, 1)
    )
    yield from differences(written, remade, "topics")


def skipped_topics(root: Path) -> list[str]:
    """The users' topics of a report that are not installed here, so that nothing can hold them against the data."""
    path = root / "report.json"
    held = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return sorted(set(held.get("topics", ())) - {topic.name for topic in user_topics()})


def differences(
    written: Any, remade: Any, place: str = "", where: str = "the report"
) -> Iterator[str]:
    """Where two documents differ, in the order of the written one: 'a.b[2]: 1.5 in the report, 1.6 from the data'."""
    if isinstance(written, dict) and isinstance(remade, dict):
        for key in written:
            inside = f"{place}.{key}" if place else str(key)
            if key in remade:
                yield from differences(written[key], remade[key], inside, where)
            else:
                yield f"{inside}: in {where}, but not in the data"
        yield from (
            f"{place}.{key}: in the data, but not in {where}"
            for key in remade
            if key not in written
        )
    elif isinstance(written, list) and isinstance(remade, list) and len(written) == len(remade):
        for i, (mine, theirs) in enumerate(zip(written, remade, strict=True)):
            yield from differences(mine, theirs, f"{place}[{i}]", where)
    elif written != remade:
        yield f"{place}: {_short(written)} in {where}, {_short(remade)} from the data"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
