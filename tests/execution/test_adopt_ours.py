"""Our own flights, exported and adopted by a campaign that knows no vehicle: the same numbers."""

import json
from pathlib import Path

import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.adopt import adopt_table
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.outcome import OUTCOMES
from abhv_mc.folder.export import export_csv
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.samples import SampleReader
from abhv_mc.report.pages.verify import differences
from abhv_mc.shipped import shipped_folder
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.failures import FAILURES
from abhv_mc.topics.plain import plain
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS


def _no_advice(difference: str) -> bool:
    """How a verdict would stand with more flights is said otherwise of a table, which nothing here can fly."""
    return difference.partition(":")[0].rpartition(".")[2] not in ("words", "advice")


@pytest.mark.parametrize("name", ["s_manoeuvre", "wide"])
def test_ours_adopted_say_the_same(name: str, tmp_path: Path) -> None:
    path = shipped_folder() / "campaigns" / f"{name}.yaml"
    ours = run_campaign(Request(path, tmp_path / "ours", runs=48, workers=2)).manifest
    campaign, table = read_campaign(path, runs=48), tmp_path / "flights.csv"
    assert table in set(export_csv(tmp_path / "ours", tmp_path))
    flown = SampleReader(tmp_path / "ours" / "samples.parquet").names
    records = [campaign.parameters[each] for each in flown]
    required = dict.fromkeys(item.metric for item in campaign.requirements)
    entries = campaign.document.data["requirements"]  # type: ignore[call-overload,index]
    content = {
        "name": name,
        "independent": True,
        "systems": {each: {} for each in campaign.controllers},
        "inputs": {r.name: {"unit": r.unit, "nominal": r.nominal, "seed": r.seed} for r in records},
        "dispersions": {key: law for key, law in campaign.dispersions.items() if not campaign.parameters[key].seed},
        "metrics": {
            each: {key: getattr(campaign.metrics[each], key) for key in ("unit", "label", "doc")} for each in required
        },
        "outcomes": {code: words for code, words in OUTCOMES.sentences.items() if code not in ("ok", "failed_to_run")},
        "requirements": entries,
    }
    (tmp_path / "adopted.yaml").write_text(json.dumps(content))
    adopted = adopt_table(table, tmp_path / "adopted.yaml", tmp_path / "adopted").manifest
    for key in ("requirements", "requirements_shown"):
        found, flown_here = (plain(getattr(manifest, key)) for manifest in (adopted, ours))
        assert not list(filter(_no_advice, differences(found, flown_here)))
    one, two = (Models(read_flown(tmp_path / folder)) for folder in ("ours", "adopted"))
    for topic in (VERDICTS, FAILURES):
        assert not list(filter(_no_advice, differences(plain(one[topic]), plain(two[topic])))), topic.name
    first, second = plain(one[COMPARISON])["pairs"], plain(two[COMPARISON])["pairs"]
    for pair in (*first.values(), *second.values()):  # what both have
        pair["metrics"] = {metric: pair["metrics"][metric] for metric in required}
        del pair["usage"], pair["surfaces"]
    assert not list(differences(first, second))
