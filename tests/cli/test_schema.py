"""The schemas describe the files that are shipped, and units are text there."""

import json

import pytest
from typer.testing import CliRunner

from abhv_mc.cli.app import app


def schema(kind: str) -> dict:
    answer = CliRunner().invoke(app, ["schema", kind])
    assert answer.exit_code == 0
    return json.loads(answer.stdout)


def test_campaign() -> None:
    made = schema("campaign")
    assert {"vehicle", "mission", "controllers"} <= set(made["required"])
    assert made["additionalProperties"] is False
    assert made["properties"]["vehicle"]["type"] == "string"


def test_mission_lengths_are_text_with_a_unit() -> None:
    start = schema("mission")["$defs"]["Start"]["properties"]
    assert start["altitude"]["type"] == "string"
    assert start["altitude"]["examples"] == ["20 km"]


@pytest.mark.parametrize("kind", ["vehicle", "controller"])
def test_others(kind: str) -> None:
    assert schema(kind)["$defs"]


def test_unknown_kind() -> None:
    assert CliRunner().invoke(app, ["schema", "flight"]).exit_code == 2
