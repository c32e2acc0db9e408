"""``list``; the schemas describe the files that are shipped, and units are text there."""

import json

import pytest
from typer.testing import CliRunner

from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.cli.app import app
from abhv_mc.flight.channels import CHANNELS
from abhv_mc.flight.metrics import BUILT_IN
from abhv_mc.plant.parameters import PARAMETERS


def test_a_schema_is_printed_as_it_is() -> None:
    assert json.loads(CliRunner().invoke(app, ["list", "schemas", "vehicle"]).stdout) == make_schema("vehicle")


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("parameters", [parameter.name for parameter in PARAMETERS if parameter.name != "one"]),
        ("channels", [channel.name for channel in CHANNELS]),
        ("metrics", [signal.name for signal in BUILT_IN.values()]),
        ("schemas", ["campaign", "vehicle", "mission", "controller", "report", "manifest"]),
    ],
)
def test_everything_is_listed_in_words_and_as_json(kind: str, names: list[str]) -> None:
    listed = json.loads(CliRunner().invoke(app, ["list", kind, "--json", "-"]).stdout)
    assert [entry["name"] for entry in listed] == names
    table = CliRunner().invoke(app, ["list", kind]).stdout
    assert all(f"{entry['name']} " in table and entry["doc"] in table for entry in listed)
