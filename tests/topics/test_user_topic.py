"""A user's topic, the one of the how-to page: on the page, in JSON, in the terminal and in Python."""

import importlib.util
import json
from pathlib import Path

import pytest
from report.few_figures import build_with
from report.synthetic import write_campaign
from typer.testing import CliRunner

import abhv_mc
from abhv_mc.cli.app import app
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.verify import skipped_topics, verify_campaign
from abhv_mc.topics import Topic, register
from abhv_mc.topics.topic import REGISTERED

EXAMPLE = Path(__file__).parents[2] / "docs/how-to/correlate.py"


@pytest.fixture
def topic():
    spec = importlib.util.spec_from_file_location("correlate", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    register(module.CORRELATE)
    yield module.CORRELATE
    REGISTERED.clear()


def test_it_stands_everywhere(topic, tmp_path):
    folder = write_campaign(tmp_path / "c", runs=40)
    page = build_with(folder).read_text(encoding="utf-8")
    assert '<section id="correlate"' in page and '<a href="#correlate">Rank correlations</a>' in page
    held = json.loads((folder / "report.json").read_text(encoding="utf-8"))["topics"]["correlate"]["controllers"]
    told = abhv_mc.open_results(folder).correlate.controllers
    assert told["lqr"]["sideslip_max_deg"]["aero.lift"] == held["lqr"]["sideslip_max_deg"]["aero.lift"] > 0.3
    shown = CliRunner().invoke(app, ["show", "correlate", str(folder)])
    assert shown.exit_code == 0 and "Speed error, max" in shown.stdout
    assert list(verify_campaign(folder)) == []
    REGISTERED.clear()
    assert list(verify_campaign(folder)) == [] and skipped_topics(folder) == ["correlate"]


def test_a_built_in_name_is_refused(topic):
    with pytest.raises(InputError, match="built in"):
        register(Topic("margins", topic.model, topic.compute, topic.section))
