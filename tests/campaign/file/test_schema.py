"""The schemas describe every key, and an editor underlines what is wrong."""

from collections.abc import Iterator

import pytest
from jsonschema import Draft202012Validator

from abhv_mc.campaign.file.kinds import MODELS
from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.io.documents import read_document
from abhv_mc.io.units import DIMENSIONS
from abhv_mc.shipped import shipped_folder


def properties(kind: str) -> Iterator[tuple[str, dict]]:
    """Every key of every mapping of a schema, and its schema."""
    schema = make_schema(kind)
    for name, part in {**schema.get("$defs", {}), kind: schema}.items():
        for key, value in part.get("properties", {}).items():
            yield f"{name}.{key}", value


@pytest.mark.parametrize("kind", MODELS)
def test_every_key_is_described_in_words_of_its_own(kind: str) -> None:
    schema, described = make_schema(kind), dict(properties(kind))
    Draft202012Validator.check_schema(schema)
    assert schema["$id"].startswith("urn:abhv-mc:") and schema["$id"].endswith(f":{kind}")
    generic = {dimension.expected for dimension in DIMENSIONS}
    assert described
    assert [name for name, value in described.items() if value.get("description", "") in {"", *generic}] == []


def test_what_an_editor_should_underline() -> None:
    validator = Draft202012Validator(make_schema("campaign"))
    right = read_document(shipped_folder() / "campaigns/s_manoeuvre.yaml").data
    del right["metrics"]  # with metrics of its own a requirement may name any
    requirement = right["requirements"][0]
    for wrong in (
        {**right, "requirements": [{**requirement, "metric": "altitude_eror_max_m"}]},
        {**right, "dispersions": {"aero.lfit": {"distribution": "normal", "sigma": "1 %"}}},
        {**right, "sampling": "montecarlo"},
        {**right, "execution": {"flight_time_limit": 10.0}},
        {**right, "execution": {"flight_time_limit": "10"}},
    ):
        assert not validator.is_valid(wrong), wrong
    named, own = make_schema("campaign")["$defs"]["RequirementEntry"]["properties"]["metric"]["anyOf"]
    assert set(METRIC_INDEX) < set(named["enum"]) and "pattern" in own
