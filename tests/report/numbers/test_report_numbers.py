"""Content of `report.json` and its schema."""

from types import SimpleNamespace

import pytest

from abhv_mc.report.numbers import report_numbers
from abhv_mc.report.numbers.report_numbers import make_numbers, report_schema
from abhv_mc.topics.topic import Records

BASE = {"format": 3, "state": "complete", "digest": "d", "warnings": ["w"],
        "summary": {"records": []}}  # fmt: skip


class Stub:
    def __init__(self, sets, users):
        manifest = SimpleNamespace(state="complete", digest="d", requirement_sets=sets)
        self.results = SimpleNamespace(manifest=manifest)
        self.users = [SimpleNamespace(name=name) for name in users]

    def __getitem__(self, topic):
        return {"of": topic.name}


@pytest.mark.parametrize(
    ("sets", "users", "baseline", "more"),
    [
        ((), (), None, {}),
        ((1, 2), (), None, {"requirement_sets": 2}),
        ((), ("x",), None, {"topics": {"x": {"of": "x"}}}),
        ((), (), {"folder": "b"}, {"baseline": {"folder": "b"}}),
    ],
)
def test_optional_entries_are_written_if_there_are_any(monkeypatch, sets, users, baseline, more):
    monkeypatch.setattr(report_numbers, "BUILT_IN", (SimpleNamespace(name="own"),))
    monkeypatch.setattr(report_numbers, "summarize", lambda _: Records(()))
    monkeypatch.setattr(report_numbers, "warnings_of", lambda _: ["w"])
    numbers = make_numbers(Stub(sets, users), baseline)
    assert numbers == {**BASE, "own": {"of": "own"}, **more}


def test_every_field_of_an_entry_is_required_and_no_other_is_allowed():
    schema = report_schema()
    entries = [entry for entry in schema["$defs"].values() if "properties" in entry]
    assert len(entries) > 20
    for entry in entries:
        assert set(entry["required"]) == set(entry["properties"])
        assert entry.get("additionalProperties") is False
        assert not any("title" in field for field in entry["properties"].values())
    interval = schema["$defs"]["Interval"]["properties"]
    assert interval["low"] == {"type": ["number", "null"]}
