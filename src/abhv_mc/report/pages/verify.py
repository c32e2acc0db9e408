"""Verification of a campaign's folder: hashes of its files, and numbers in its report."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.hashes import find_damage
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.identity import code_hash
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.compare import compare_baseline
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.numbers.summary import HASH
from abhv_mc.report.pages.build import hash_failure_map, hash_files, hash_pages
from abhv_mc.topics.topic import Models, user_topics


def verify_campaign(root: Path) -> Iterator[str]:
    """Yield a sentence for each inconsistency in a folder; for a search, check only files.

    Raise InputError if the folder cannot be read or is in use.
    """
    folder = CampaignFolder(root)
    manifest = read_manifest(folder.manifest)
    if holder := lock_holder(folder.lock):
        raise InputError(root, f"{holder} is running the campaign", "a run that has ended")
    damage = list(find_damage(folder, manifest))
    yield from (
        f"{path.relative_to(folder.root).as_posix()}: {problem}" for path, problem in damage
    )
    if not damage and manifest.search is None:
        yield from _report_differences(root)


def _report_differences(root: Path) -> Iterator[str]:
    path = root / "report.json"
    if not path.is_file():
        if (root / "report.html").is_file():
            yield "report.json: missing, although report.html exists"
        return
    try:
        written = json.loads(path.read_text(encoding="utf-8"))
        files, pages, pictures = (written.pop(name) for name in ("files", "pages", "pictures"))
    except (ValueError, KeyError) as error:
        problem = f"the file does not contain the valid numbers of a report ({error})"
        raise InputError(path, problem, f"a report made by `abhv-mc report {root}`") from None
    is_current = written.pop("code", None) == code_hash()
    for name in ("key", HASH):
        written.pop(name, None)
    yield from _find_changed(pages, hash_pages(root, pages))
    yield from _find_changed(pictures, hash_pages(root, pictures))
    baseline = Path(written["baseline"]["folder"]) if "baseline" in written else None
    if baseline is not None and not baseline.is_dir():
        yield f"baseline: {baseline} no longer exists"
        del written["baseline"]
        baseline = None
    for difference in _find_stale(root, files, written, baseline):
        if not is_current:
            yield "report.json: written by another version of abhv-mc, which gives other numbers"
            return
        yield difference


def _find_stale(
    root: Path, files: dict[str, str], written: dict[str, Any], baseline: Path | None
) -> Iterator[str]:
    """Yield changed data files, and differences between the numbers of a report and its data."""
    yield from _find_changed(files, hash_files(root))
    results = read_flown(root)
    comparison = compare_baseline(results, baseline) if baseline else None
    remade = json.loads(json.dumps(make_numbers(Models(results), comparison)))
    if written.pop("failure_map", None) != hash_failure_map(root):
        written["failures"]["map"] = remade["failures"]["map"]  # computed after the report
    # Topics from installed packages may have changed since the report was written.
    users = [numbers.pop("topics", {}) for numbers in (written, remade)]
    yield from find_differences(written, remade)
    written, remade = (
        {name: users[k][name] for name in users[0] if name in users[1]} for k in (0, 1)
    )
    yield from find_differences(written, remade, "topics")


def _find_changed(
    written: Mapping[str, str | None], current: Mapping[str, str | None]
) -> Iterator[str]:
    """Yield a sentence for each file whose hash differs from the hash in the report."""
    for name in sorted({*written, *current}):
        if current.get(name) is None:
            yield f"{name}: missing, although the report was made with it"
        elif written.get(name) != current[name]:
            yield f"{name}: changed after the report was made"


def skipped_topics(root: Path) -> list[str]:
    """Return the topics of a report that cannot be verified because they are not installed."""
    path = root / "report.json"
    numbers = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return sorted(set(numbers.get("topics", ())) - {topic.name for topic in user_topics()})


def find_differences(
    written: Any, remade: Any, key_path: str = "", document: str = "the report"
) -> Iterator[str]:
    """Yield differences of two documents, such as 'a.b[2]: 1.5 in the report, but 1.6 ...'."""
    if isinstance(written, dict) and isinstance(remade, dict):
        for key in written:
            child = f"{key_path}.{key}" if key_path else str(key)
            if key in remade:
                yield from find_differences(written[key], remade[key], child, document)
            else:
                yield f"{child}: in {document}, but not in the data"
        yield from (
            f"{key_path}.{key}: in the data, but not in {document}"
            for key in remade
            if key not in written
        )
    elif isinstance(written, list) and isinstance(remade, list) and len(written) == len(remade):
        for i, (item_a, item_b) in enumerate(zip(written, remade, strict=True)):
            yield from find_differences(item_a, item_b, f"{key_path}[{i}]", document)
    elif written != remade:
        yield f"{key_path}: {_short(written)} in {document}, but {_short(remade)} in the data"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
