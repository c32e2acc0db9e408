"""A campaign's folder held against itself: its files' hashes, its parts (:mod:`.consistency`), its report's numbers."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from abhv_mc.folder.hashes import find_damage
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import read_whole_manifest
from abhv_mc.io.documents import InputError
from abhv_mc.report.numbers.consistency import find_contradictions
from abhv_mc.report.numbers.differences import differences
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.numbers.results import read_results
from abhv_mc.report.pages.build import hash_files, hash_pages, write_json
from abhv_mc.report.pages.searched import verify_search

_HASHED = ("files", "pages", "pictures")


def verify_campaign(root: Path) -> Iterator[str]:
    """What in a campaign's folder does not fit the rest of it, one sentence each; nothing where all fits.

    Raises InputError where the report or the data cannot be read at all, or somebody flies there.
    """
    folder = CampaignFolder(root)
    manifest = read_whole_manifest(folder.manifest)
    if "search" in manifest:
        yield from verify_search(folder, manifest)
        return
    if holder := lock_holder(folder.lock):
        raise InputError(root, None, None, f"a campaign that {holder} is flying", "the end of that run")
    yield from (f"{path.relative_to(folder.root).as_posix()}: {found}" for path, found in find_damage(folder, manifest))
    path = root / "report.json"
    if not path.is_file():
        raise InputError(path, None, None, "no such file", f"a report: abhv-mc report {root}")
    try:
        text = path.read_text(encoding="utf-8")
        written = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(path, None, None, str(error), "JSON") from None
    if not isinstance(written, dict) or not all(isinstance(written.get(name, {}), dict) for name in _HASHED):
        raise InputError(path, None, None, "no numbers of a report", f"a report: abhv-mc report {root}")
    told = False
    for difference in _differences(folder, json.loads(text)):
        told = True
        yield difference
    if not told and text != write_json(written):
        yield "report.json: not as it was written"


def _differences(folder: CampaignFolder, written: dict[str, Any]) -> Iterator[str]:
    root = folder.root
    # Cheap and sharp first: one flipped byte in any file changes its hash.
    yield from differences(written.pop("files", {}), hash_files(root), "files")
    pages = written.pop("pages", {})
    written.pop("key", None)
    yield from differences(pages, hash_pages(root, pages), "pages")
    pictures = written.pop("pictures", {})
    yield from differences(pictures, hash_pages(root, pictures), "pictures")
    results = read_results(root)
    yield from find_contradictions(results)
    yield from differences(written, json.loads(json.dumps(make_numbers(results))))
