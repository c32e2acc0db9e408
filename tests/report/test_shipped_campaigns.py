"""Every shipped campaign is valid, and those beside the default one fly and pass through the report as they are."""

import json
from dataclasses import replace
from functools import cache

import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.run.engine import make_engine
from abhv_mc.campaign.run.runner import run_campaign
from abhv_mc.campaign.run.setup import Request
from abhv_mc.report.build import build_report
from abhv_mc.report.verify import verify_campaign
from abhv_mc.shipped import shipped_campaigns

FILES = sorted(shipped_campaigns().glob("*.yaml"))
SHORTENED = {"wide": 60, "sobol": 16 * 9, "wind_and_sensors": 40}


@pytest.fixture(scope="module")
def engine():
    compiled = make_engine()
    return replace(compiled, prepare=cache(compiled.prepare))


@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
def test_it_is_valid_and_asks_something(path):
    checked = read_campaign(path)
    assert checked.model.name == path.stem and checked.model.question.endswith("?")
    assert checked.runs >= 200


@pytest.mark.parametrize("name", SHORTENED)
def test_it_flies_and_its_report_follows_from_the_data(name, engine, tmp_path):
    path = shipped_campaigns() / f"{name}.yaml"
    flown = run_campaign(Request(path, tmp_path / name, SHORTENED[name]), engine)
    assert flown.complete
    page = build_report(flown.folder).read_text(encoding="utf-8")
    markdown = build_report(flown.folder, "md").read_text(encoding="utf-8")
    numbers = json.loads((flown.folder / "report.json").read_text(encoding="utf-8"))
    question = read_campaign(path).model.question
    assert f"<h1>{question}</h1>" in page and markdown.startswith(f"# {question}\n")
    assert list(verify_campaign(flown.folder)) == []
    statuses = {entry["status"] for item in numbers["requirements"] for entry in item["controllers"].values()}
    failed = {name: counts["failed"] for name, counts in numbers["flights"].items()}
    if name == "wide":
        assert failed["tlc"] > 0 and failed["lqr"] > failed["tlc"] and "FAIL" in statuses
    else:
        assert failed == {"tlc": 0, "lqr": 0}
    if name == "sobol":
        assert all(part["metrics"] and part["refused"] is None for part in numbers["sobol"]["controllers"].values())
