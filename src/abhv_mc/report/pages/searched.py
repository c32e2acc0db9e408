"""What `report` and `verify campaign` say of a folder that a search wrote."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.folder.flights import DamagedFileError, FlightRows, read_block
from abhv_mc.folder.hashes import find_damage
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import COMPLETE
from abhv_mc.folder.plans import read_plan
from abhv_mc.folder.samples import SampleReader
from abhv_mc.io.documents import InputError
from abhv_mc.search.methods.evaluation import Floats
from abhv_mc.search.severity import FAILS_ABOVE, Severity, ended_early


def refuse_search(root: Path, manifest: dict[str, Any]) -> None:
    """Raise InputError for a search's folder, naming the command that makes its page again."""
    if "search" in manifest:
        wanted = f"the search's own command, which makes its page again from them: {search_command(root, manifest)}"
        raise InputError(root, None, None, "the flights of a search, of which there is no campaign's report", wanted)


def search_command(root: Path, manifest: dict[str, Any]) -> str:
    """The command that answers the search again from what the folder holds."""
    held = manifest["search"]
    words = ["abhv-mc", held["kind"], str(root / "campaign.yaml"), "--controller", held["controller"]]
    if held["kind"] == "worst":
        words += ["--metric", held["metric"], "--above" if held["largest"] else "--below", "--box", f"{held['box']:g}"]
    else:
        words += ["--requirement", held["requirement"], "--target-cov", f"{held['target_cov']:g}"]
    return shlex.join([*words, "--flights", str(held["flights"]), "-o", str(root)])


def verify_search(folder: CampaignFolder, manifest: dict[str, Any]) -> Iterator[str]:
    """What of a search's result its flights do not confirm: that they are whole, are these, and give these counts.

    Raises InputError where the search is not complete.
    """
    if manifest.get("state") != COMPLETE:
        wanted = f"a complete one; this goes on with it: {search_command(folder.root, manifest)}"
        raise InputError(folder.root, None, None, f"a search that is {manifest.get('state')}", wanted)
    damaged = [f"{path.relative_to(folder.root).as_posix()}: {found}" for path, found in find_damage(folder, manifest)]
    yield from damaged
    if damaged:
        return
    samples = SampleReader(folder.samples)
    try:
        blocks = [read_block(path, samples.names) for path in sorted(folder.flights.glob("*.parquet"))]
    except DamagedFileError as error:
        yield f"flights/{error}"
        return
    blocks.sort(key=lambda block: block.first)
    if not blocks or [block.first for block in blocks] != [0, *(block.stop for block in blocks[:-1])]:
        yield "flights: some are missing"
        return
    rows = FlightRows(
        blocks[0].controller,
        0,
        samples.names,
        np.concatenate([block.samples for block in blocks]),
        tuple(code for block in blocks for code in block.outcome),
        np.concatenate([block.values for block in blocks]),
    )
    if str(rows.digest()) != manifest.get("digest"):
        yield f"digest: {manifest.get('digest')} in the manifest, {rows.digest()} from the flights"
    if samples.flights != rows.stop or not np.array_equal(samples.rows(0, rows.stop), rows.samples):
        yield "samples.parquet: not the samples that the flights have"
    metric = manifest["search"].get("metric", manifest["search"].get("requirement"))
    result = manifest.get("result")
    if result is None or metric not in METRIC_INDEX or not 0 < result["flights"] <= rows.stop:
        yield "manifest.json: no result of these flights"
        return
    remade = _worst(folder, rows, manifest) if manifest["search"]["kind"] == "worst" else _rare(folder, rows, manifest)
    yield from (f"{key}: {result.get(key)} in the result, {value} from the flights" for key, value in remade.items()
                if result.get(key) != value)  # fmt: skip


def _worst(folder: CampaignFolder, rows: FlightRows, manifest: dict[str, Any]) -> dict[str, Any]:
    held, searched = manifest["search"], manifest["result"]["flights"]
    if searched == rows.stop:
        return {"flights": 0}  # no random ones, which follow the search's
    severities = _severities(folder, rows, held["controller"], held["metric"], 1.0 if held["largest"] else -1.0)
    worst, random = int(np.argmax(severities[:searched])), searched + int(np.argmax(severities[searched:]))
    metric = rows.values[:, METRIC_INDEX[held["metric"]]]
    return {
        "flight": worst,
        "value": float(metric[worst]),
        "random_flight": random,
        "random_worst": float(metric[random]),
        "ended_early": int(ended_early(rows)[:searched].sum()),
    }


def _rare(folder: CampaignFolder, rows: FlightRows, manifest: dict[str, Any]) -> dict[str, Any]:
    held, result = manifest["search"], manifest["result"]
    limit, sign = (result["below"], 1.0) if "below" in result else (result.get("above", 0.0), -1.0)
    severities = _severities(
        folder, rows, held["controller"], held["requirement"], sign, limit, result.get("ended_early_fails", False)
    )
    return {
        "flights": rows.stop,
        "failures": int((severities > FAILS_ABOVE).sum()),
        "ended_early": int(ended_early(rows).sum()),
    }


def _severities(
    folder: CampaignFolder,
    rows: FlightRows,
    controller: str,
    metric: str,
    sign: float,
    limit: float = 0.0,
    early_is_worse: bool = True,
) -> Floats:
    duration = read_plan(folder.plan(controller)).timing.duration
    return Severity(metric, sign, duration, limit, early_is_worse).ranked(rows)
