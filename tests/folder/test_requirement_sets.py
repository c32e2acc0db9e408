"""Files of the successive sets of requirements of a folder."""

from dataclasses import replace

from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import ControllerCount, Manifest
from abhv_mc.folder.requirement_sets import add_requirement_set, count_known_flights
from abhv_mc.io.documents import read_document


def test_the_first_change_writes_two_sets_and_the_next_writes_one(tmp_path):
    counts = {name: ControllerCount(flights_done=n) for name, n in (("a", 40), ("b", 64))}
    manifest = Manifest(
        name="x",
        state="complete",
        seed=1,
        campaign_hash="",
        source_hash="",
        controllers=counts,
        started="2026-01-02T03:04:05+00:00",
    )
    assert count_known_flights(manifest) == 64
    assert count_known_flights(replace(manifest, controllers={})) == 0
    limit = [{"metric": "miss", "below": 5, "probability": 0.9}]
    none = {"name": "x", "runs": 9, "controllers": {"a": "a.yaml", "b": "b.yaml"}}
    some = none | {"requirements": limit, "under_test": ["a"]}
    folder = CampaignFolder(tmp_path)
    one = add_requirement_set(folder, manifest, none, some)
    two = add_requirement_set(folder, one, some, none)
    sets = [(own.file, own.flights) for own in two.requirement_sets]
    assert sets == [(f"requirements/00{k}.yaml", n) for k, n in ((1, 0), (2, 64), (3, 64))]
    assert two.requirement_sets[0].time == manifest.started
    stored = [read_document(tmp_path / name).data for name, _ in sets]
    names = ["a", "b"]
    assert stored[0] == stored[2] == {"requirements": [], "controllers": names}
    assert stored[1] == {"requirements": limit, "under_test": ["a"], "controllers": names}
