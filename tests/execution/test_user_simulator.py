"""Campaigns of a user's simulator: flown, gone on with, joined, and never run by a folder."""

import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from own_simulators import DIVE, DIVE_CHANNELS, DIVE_HISTORY, dive_campaign, shown_text

from abhv_mc.analysis.explain import explain_flight
from abhv_mc.analysis.failure_map import map_failures
from abhv_mc.analysis.replay import replay_flight
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.explore.counts import open_flights
from abhv_mc.explore.server import ExploreServer
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.flights_view import make_flights_view
from abhv_mc.results import Results
from abhv_mc.simulators.engine import make_engine


@pytest.fixture(autouse=True)
def own_list(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The list of what this user has flown."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def test_a_campaign_is_flown_judged_and_explained(tmp_path: Path) -> None:
    path, out = dive_campaign(tmp_path / "own"), tmp_path / "out"
    manifest = run_campaign(Request(path, out, workers=2)).manifest
    assert manifest.complete
    assert len(manifest.warnings) == 1  # too few flights for 99 %
    results = read_flown(out)
    for name in ("v1", "v2"):
        flights = results.flights[name]
        low = flights.metrics["altitude_min"]
        counted = next(v for v in (*manifest.requirements, *manifest.requirements_shown) if v.controller == name)
        assert counted.failures == int((low <= 0.0).sum())
        assert flights.count_outcomes().get("ground", 0) == int((low < -200.0).sum())
    assert flights.flight.size == 200
    text = shown_text(build_report(out))
    assert "System" in text and not re.search("[Cc]ontroller|Control usage", text.replace("--controller", ""))
    failed = int(np.argmin(results.flights["v1"].metrics["altitude_min"]))
    fly = make_engine().fly
    assert replay_flight(out, "v1", failed, fly).differences == ()
    assert Results(out).replay(failed, "v1").columns.tolist() == ["time"]
    found = explain_flight(out, "v1", failed, fly)
    assert set(found.causes) <= {"altitude", "speed", "delay", "thrust"}
    assert found.causes
    groups = map_failures(out, {"v1": [failed]}, make_engine()).controllers["v1"]
    assert groups.looked_at == 1


def test_a_campaign_goes_on_and_its_shards_are_joined(tmp_path: Path) -> None:
    path = dive_campaign(tmp_path / "own", runs=80)
    whole = run_campaign(Request(path, tmp_path / "whole")).manifest
    run_campaign(Request(path, tmp_path / "grown", runs=50, controllers=("v1",)))
    grown = run_campaign(Request(path, tmp_path / "grown")).manifest
    assert grown.digest == whole.digest
    shards = [tmp_path / "a", tmp_path / "b"]
    for i, out in enumerate(shards, 1):
        run_campaign(Request(path, out, shard=(i, 2)))
    assert merge_campaign(shards, tmp_path / "joined").manifest.digest == whole.digest
    changed = dive_campaign(tmp_path / "own", systems={"v1": {"pull": 5.5}, "v2": {"pull": 6.0}}, runs=80)
    with pytest.raises(InputError, match=r"systems\.v1\.pull"):
        run_campaign(Request(changed, tmp_path / "whole"))
    changed = dive_campaign(tmp_path / "own", DIVE + "\n", runs=80)
    with pytest.raises(InputError, match=r"dive\.py: other content"):
        run_campaign(Request(changed, tmp_path / "whole"))


def test_the_folder_of_a_stranger_runs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = tmp_path / "ran"
    source = DIVE + f"\nopen({str(ran)!r}, 'a').write('x')\n"
    out = tmp_path / "out"
    run_campaign(Request(dive_campaign(tmp_path / "own", source, runs=20), out))
    ran.unlink()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "stranger"))
    fly = make_engine().fly
    build_report(out)
    for ask in (
        lambda: replay_flight(out, "v1", 0, fly),
        lambda: explain_flight(out, "v1", 0, fly),
        lambda: map_failures(out, {"v1": [0]}, make_engine()),
        lambda: run_campaign(Request(out / "campaign.yaml", tmp_path / "again")),
    ):
        with pytest.raises(InputError, match="not flown"):
            ask()
    assert not ran.exists()
    assert replay_flight(out, "v1", 0, fly, trust_code=True).differences == ()
    assert ran.exists()


def test_a_simulator_that_differs_is_flown_and_marked(tmp_path: Path) -> None:
    source = (
        DIVE + "\nwell = fly\ndef fly(inputs, settings):\n    return well(inputs, settings) | {'load': time.time()}\n"
    )
    path = dive_campaign(tmp_path / "own", source, runs=20)
    manifest = run_campaign(Request(path, tmp_path / "out")).manifest
    assert manifest.complete
    assert any("not repeatable" in words and "load" in words for words in manifest.warnings)
    assert [
        words for words in replay_flight(tmp_path / "out", "v1", 0, make_engine().fly).differences if "load" in words
    ]


def test_an_input_that_changes_no_flight_is_said(tmp_path: Path) -> None:
    source = DIVE.replace('inputs["thrust"]', "1.0")
    manifest = run_campaign(Request(dive_campaign(tmp_path / "own", source, runs=20), tmp_path / "out")).manifest
    assert [words for words in manifest.warnings if words.startswith("'thrust' from 0.91 to 1.09")]


def test_a_simulator_that_flies_nothing_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    path = dive_campaign(tmp_path / "own", "def fly(inputs, settings):\n    return {}\n")
    with pytest.raises(InputError, match="no flight of 'v1'"):
        run_campaign(Request(path, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_histories_that_a_flight_returns_are_kept_and_opened(tmp_path: Path) -> None:
    keep = {"histories": {"flights": "worst 5", "rate": "2 Hz"}}
    path = dive_campaign(tmp_path / "own", DIVE_HISTORY, histories=DIVE_CHANNELS, keep=keep, runs=20)
    out = tmp_path / "out"
    manifest = run_campaign(Request(path, out)).manifest
    assert not manifest.not_made
    results, opened = read_flown(out), Results(out)
    kept = opened.histories.set_index(["controller", "flight", "time"]).loc["v1"]
    numbers = kept.index.get_level_values("flight").unique()
    assert len(numbers) == 5
    for number in numbers:
        given = {name: values[number] for name, values in results.samples.items()}
        flown = kept.loc[number]
        assert flown.index.tolist() == [0.0, 0.5, 1.0, 1.5]
        sink = given["speed"] * np.sin(np.radians(60.0))
        assert flown["sink_rate"].to_numpy() == pytest.approx(np.float32(sink - 10.0 * flown.index))
        at_own_samples = flown["altitude"].iloc[:3].to_numpy()
        assert (at_own_samples == np.float32(given["altitude"] - sink * flown.index[:3] ** 2)).all()
        end = 1.5 + 0.1 * given["thrust"]  # linear between the last samples
        between = np.interp(1.5, [1.0, end], given["altitude"] - sink * np.array([1.0, end**2]))
        assert flown["altitude"].iloc[3] == pytest.approx(between, rel=1e-6)
    field = pq.read_schema(next((out / "histories").glob("v1-*.parquet"))).field("altitude")
    assert field.type == "float"
    assert field.metadata[b"unit"] == b"ft"

    build_report(out)
    view = make_flights_view(results, {"v1": "v1", "v2": "v2"}, {"v1": "", "v2": ""})
    assert [(each["label"], each["unit"]) for each in view.data["channels"]] == [
        ("Altitude", "ft"),
        ("Sink rate", "ft/s"),
    ]
    assert view.arrays["history:altitude"].shape == (10, 4)
    assert max(view.data["rows"]["history"]) == 9
    assert view.data["criteria"][0]["channel"] == "altitude"

    again = opened.replay(int(numbers[0]), "v1")
    assert again["altitude"].to_numpy() == pytest.approx(kept.loc[numbers[0]]["altitude"].to_numpy(), rel=0)
    with open_flights(out) as table, ExploreServer(out, table, make_engine()) as server:
        assert [each["name"] for each in table.view["channels"]] == ["altitude", "sink_rate"]
        history = server.open_flight("v2", 3)["history"]
        assert history is not None
        assert history["time"].tolist() == [0.0, 0.5, 1.0, 1.5]
        assert set(history["channels"]) == {"altitude", "sink_rate"}


@pytest.mark.parametrize(
    ("keep", "found"), [({"histories": {"channels": ["mach"]}}, "channels"), ({"envelopes": {}}, "envelopes")]
)
def test_channels_and_bands_are_of_our_own_simulator(tmp_path: Path, keep: dict[str, object], found: str) -> None:
    path = dive_campaign(tmp_path / "own", DIVE_HISTORY, histories=DIVE_CHANNELS, keep=keep)
    with pytest.raises(InputError, match=f"{found} of "):
        run_campaign(Request(path, tmp_path / "out"))
