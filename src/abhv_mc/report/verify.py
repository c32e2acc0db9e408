"""Every number of a report made again from its campaign's data, and held against what was written."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.io.documents import InputError
from abhv_mc.report.build import hash_files, hash_pages, write_json
from abhv_mc.report.numbers import make_numbers
from abhv_mc.report.results import read_results
from abhv_mc.report.searched import verify_search
from abhv_mc.store.digest import Digest
from abhv_mc.store.flights import DamagedFileError, read_block
from abhv_mc.store.folder import CampaignFolder
from abhv_mc.store.hashes import find_damage
from abhv_mc.store.manifest import read_manifest, read_whole_manifest
from abhv_mc.store.samples import SampleReader

_HASHED = ("files", "pages", "pictures")


def differences(written: Any, remade: Any, place: str = "") -> Iterator[str]:
    """Where two documents of numbers differ, in the order of the written one: 'a.b[2]: 1.5, remade 1.6'."""
    if isinstance(written, dict) and isinstance(remade, dict):
        for key in written:
            inside = f"{place}.{key}" if place else str(key)
            if key in remade:
                yield from differences(written[key], remade[key], inside)
            else:
                yield f"{inside}: in the report, but not in the data"
        yield from (f"{place}.{key}: in the data, but not in the report" for key in remade if key not in written)
    elif isinstance(written, list) and isinstance(remade, list) and len(written) == len(remade):
        for i, (mine, theirs) in enumerate(zip(written, remade, strict=True)):
            yield from differences(mine, theirs, f"{place}[{i}]")
    elif written != remade:
        yield f"{place}: {_short(written)} in the report, {_short(remade)} from the data"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _blocks(folder: CampaignFolder, samples: list[str]) -> Iterator[str]:
    """Whether each block is whole and of the campaign's samples, and all together have the manifest's digest."""
    total, drawn = Digest(), SampleReader(folder.samples)
    for path in sorted(folder.flights.glob("*.parquet")):
        try:
            block = read_block(path, samples)
        except DamagedFileError as error:
            yield f"flights/{error}"
            return
        rows = drawn.rows(block.first, block.stop)
        if drawn.names != block.names or not np.array_equal(rows, block.samples, equal_nan=True):
            yield f"flights/{path.name}: other samples than those of samples.parquet"
            return
        total = total + block.digest()
    wanted = read_manifest(folder.manifest).get("digest")
    if wanted is not None and str(total) != wanted:
        yield f"digest: {wanted} in the manifest, {total} from the flights"


def verify_campaign(root: Path) -> Iterator[str]:
    """What of a campaign's report its data do not confirm, one sentence each; nothing where all is confirmed.

    Raises InputError where the report or the data cannot be read at all.
    """
    folder = CampaignFolder(root)
    manifest = read_whole_manifest(folder.manifest)
    if "search" in manifest:
        yield from verify_search(folder, manifest)
        return
    yield from (f"{path.relative_to(root).as_posix()}: {found}" for path, found in find_damage(folder, manifest))
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
    yield from _blocks(folder, list(results.samples))
    yield from differences(written, json.loads(json.dumps(make_numbers(results))))
