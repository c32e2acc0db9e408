"""Campaigns of a user's simulator: flown, gone on with, joined, and never run by a folder."""

import os
import re
import select
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from own_simulators import DIVE, DIVE_CHANNELS, DIVE_HISTORY, DIVE_SCATTERED, dive_campaign, shown_text

from abhv_mc.analysis.explain import explain_flight
from abhv_mc.analysis.failure_map import map_failures
from abhv_mc.analysis.replay import replay_flight
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.explore.counts import find_flight, open_flights
from abhv_mc.explore.server import ExploreServer
from abhv_mc.folder import envelope_states
from abhv_mc.folder.envelopes import QUANTILES
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.flights_view import make_flights_view
from abhv_mc.results import Results
from abhv_mc.simulators.engine import make_engine

pytestmark = pytest.mark.usefixtures("no_figures")


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


def test_a_flight_that_hangs_ends_with_the_command_that_is_killed(tmp_path: Path) -> None:
    alive = tmp_path / "alive"
    os.mkfifo(alive)
    source = DIVE + (
        f"\nheld = open({str(alive)!r}, 'w')\n"
        "def fly(inputs, settings):\n    print('x', file=held, flush=True)\n    time.sleep(600.0)\n"
    )
    path = dive_campaign(tmp_path / "own", source, simulator={"python": "dive.py", "time_limit": "600 s"})
    command = [sys.executable, "-m", "abhv_mc", "run", str(path), "-o", str(tmp_path / "out")]
    process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)
    with alive.open("rb", buffering=0) as held:
        assert held.read(1)
        process.kill()
        process.wait()
        while (ready := select.select([held], [], [], 60.0)[0]) and held.read(1):
            pass
        assert ready  # nobody holds it any more


def test_metrics_with_names_of_the_explorers_own_are_listed(tmp_path: Path) -> None:
    source = DIVE + "\nwell = fly\n\ndef fly(inputs, settings):\n    return {'rank': inputs['delay'], 'by': 1.0}\n"
    required = [{"metric": "rank", "below": 2.0, "probability": "50 %"}]
    changes = {"metrics": {"rank": {}, "by": {}}, "requirements": required, "runs": 20}
    path = dive_campaign(tmp_path / "own", source, **changes)
    run_campaign(Request(path, tmp_path / "out", workers=1))
    with open_flights(tmp_path / "out") as table:
        found = find_flight(table, "v1", 3)
    assert found["values"]["by"] == 1.0 and 1.0 <= found["values"]["rank"] <= 2.2


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
    data, arrays = make_flights_view(results, {"v1": "v1", "v2": "v2"}, {"v1": "", "v2": ""})
    assert [(each["label"], each["unit"]) for each in data["channels"]] == [
        ("Altitude", "ft"),
        ("Sink rate", "ft/s"),
    ]
    assert arrays["history:altitude"].shape == (10, 4)
    assert max(data["rows"]["history"]) == 9
    assert data["criteria"][0]["channel"] == "altitude"

    again = opened.replay(int(numbers[0]), "v1")
    assert again["altitude"].to_numpy() == pytest.approx(kept.loc[numbers[0]]["altitude"].to_numpy(), rel=0)
    with open_flights(out) as table, ExploreServer(out, table, make_engine()) as server:
        assert [each["name"] for each in table.view["channels"]] == ["altitude", "sink_rate"]
        history = server.open_flight("v2", 3)["history"]
        assert history is not None
        assert history["time"].tolist() == [0.0, 0.5, 1.0, 1.5]
        assert set(history["channels"]) == {"altitude", "sink_rate"}


RATE = 4.0  # Hz
BANDS = {"histories": {"flights": "none"}, "envelopes": {"rate": f"{RATE:g} Hz"}}


def bands_by_hand(folder: Path, system: str, channel: str, flights: int) -> dict[float, dict[str, float]]:
    """Bands of the first flights of a system by time, from what its flights returned: value by value."""
    namespace: dict[str, Any] = {}
    exec(DIVE_SCATTERED, namespace)  # noqa: S102  our own text
    samples, settings = read_flown(folder).samples, {"v1": {"pull": 5.0}, "v2": {"pull": 6.0}}
    given = [{**{"dive": 60.0}, **{name: values[k] for name, values in samples.items()}} for k in range(flights)]
    flown = [namespace["fly"](inputs, settings[system])["history"] for inputs in given]
    paths = [(each["time"], np.array(each[channel], float)) for each in flown]
    first, last = min(times[0] for times, _ in paths), max(times[-1] for times, _ in paths)
    bands = {}
    for k in range(int(np.floor(first * RATE)) - 1, int(np.ceil(last * RATE)) + 2):
        at = lambda time: [np.interp(time, *path) for path in paths if path[0][0] <= time <= path[0][-1]]  # noqa: E731
        now = [value for value in at(k / RATE) if not np.isnan(value)]
        if not now:
            continue
        low, high = (k - 1) / RATE, (k + 1) / RATE
        near = [
            value for times, values in paths for time, value in zip(times, values, strict=True) if low <= time <= high
        ]
        near += at(low) + at(k / RATE) + at(high)
        bands[k / RATE] = {
            "count": len(now), "min": np.float32(np.nanmin(near)), "max": np.float32(np.nanmax(near)),
            **{f"q{100 * q:g}": np.quantile(np.float32(now).astype(float), q) for q in QUANTILES},
        }  # fmt: skip
    return bands


def test_bands_are_those_of_the_first_flights_histories(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(envelope_states, "ENVELOPE_FLIGHTS", 50)
    path = dive_campaign(tmp_path / "own", DIVE_SCATTERED, histories=DIVE_CHANNELS, keep=BANDS, runs=60)
    out = tmp_path / "out"
    run_campaign(Request(path, out))
    table = pq.read_table(out / "envelopes.parquet").to_pandas()
    assert set(read_flown(out).flights["v1"].count_outcomes()) == {"ok", "ground"}
    for system in ("v1", "v2"):
        for channel in ("altitude", "sink_rate"):
            found = table[(table["controller"] == system) & (table["channel"] == channel)].set_index("time")
            expected = bands_by_hand(out, system, channel, 50)
            there = found[found["count"] > 0]
            assert there.index.tolist() == list(expected)
            for name in next(iter(expected.values())):
                of = [each[name] for each in expected.values()]
                assert there[name].to_numpy() == pytest.approx(of, rel=1e-12, abs=1e-12), name
    page = build_report(out)
    text = shown_text(page)
    assert "flights that have a history then of flights 0 to 49" in text
    assert "sink rate (ft/s)" in text
    assert 'id="plot"' in page.read_text("utf-8")


def test_a_campaign_goes_on_and_its_shards_are_joined_to_the_same_tables_and_none_flies_twice(tmp_path: Path) -> None:
    flown, own = tmp_path / "flown", tmp_path / "own"
    source = DIVE_SCATTERED + (
        f"\nonce = fly\ndef fly(inputs, settings):\n    open({str(flown)!r}, 'a').write('x')\n"
        "    return once(inputs, settings)\n"
    )
    path = dive_campaign(own, source, histories=DIVE_CHANNELS, keep=BANDS, runs=60)
    whole = run_campaign(Request(path, tmp_path / "whole")).manifest
    bands = pq.read_table(tmp_path / "whole" / "envelopes.parquet")
    run_campaign(Request(path, tmp_path / "grown", runs=25, controllers=("v1",)))
    run_campaign(Request(path, tmp_path / "grown", runs=25))
    before = flown.stat().st_size
    grown = run_campaign(Request(path, tmp_path / "grown")).manifest
    assert flown.stat().st_size - before == 2 * 35
    shards = [tmp_path / "a", tmp_path / "b"]
    for i, out in enumerate(shards, 1):
        run_campaign(Request(path, out, shard=(i, 2)))
    joined = merge_campaign(shards, tmp_path / "joined").manifest
    assert whole.digest == grown.digest == joined.digest
    for out in ("grown", "joined"):
        assert pq.read_table(tmp_path / out / "envelopes.parquet").equals(bands)
    for changes, found in (
        ({"systems": {"v1": {"pull": 5.5}, "v2": {"pull": 6.0}}}, r"systems\.v1\.pull"),
        ({"source": source + "\n"}, r"dive\.py: other content"),
    ):
        given = {"source": source, "histories": DIVE_CHANNELS, "keep": BANDS, "runs": 60} | changes
        with pytest.raises(InputError, match=found):
            run_campaign(Request(dive_campaign(own, **given), tmp_path / "whole"))
