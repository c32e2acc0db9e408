"""Campaigns of user simulators: run, resume, merge; reading a folder never runs its code."""

import html
import os
import re
import select
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from own_simulators import DIVE, DIVE_CHANNELS, DIVE_HISTORY, dive_campaign, shown_text

from abhv_mc.analysis.explain import explain_flight
from abhv_mc.analysis.failure_map import map_failures
from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.check_inputs import check_inputs
from abhv_mc.execution.executor import make_ready
from abhv_mc.execution.first_flights import fly_first
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.external_simulators.simulator import ExternalSimulator
from abhv_mc.folder import envelope_states
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.histories import QUANTILES
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.flights_view import make_flights_view
from abhv_mc.requests import Request
from abhv_mc.results import Results
from abhv_mc_explore.counts import open_flights
from abhv_mc_explore.server import ExploreServer

pytestmark = pytest.mark.usefixtures("no_figures", "own_list")


def test_a_campaign_is_run_judged_and_explained(tmp_path):
    path, out = dive_campaign(tmp_path / "own"), tmp_path / "out"
    manifest = run_campaign(Request(path, out, workers=2)).manifest
    assert manifest.complete
    assert len(manifest.warnings) == 1  # too few flights for 99 %
    results = read_flown(out)
    for name in ("v1", "v2"):
        flights = results.flights[name]
        low = flights.metrics["altitude_min"]
        counted = next(
            v
            for v in (*manifest.requirements, *manifest.requirements_shown)
            if v.controller == name
        )
        assert counted.failures == int((low <= 0.0).sum())
        assert flights.count_outcomes().get("ground", 0) == int((low < -200.0).sum())
    assert flights.flight.size == 200
    text = shown_text(build_report(out))
    assert "System" in text and not re.search(
        "[Cc]ontroller|Control effort", text.replace("--controller", "")
    )
    failed = int(np.argmin(results.flights["v1"].metrics["altitude_min"]))
    assert replay_flight(out, "v1", failed).differences == ()
    assert Results(out).replay(failed, "v1").columns.tolist() == ["time"]
    explanation = explain_flight(out, "v1", failed)
    assert set(explanation.causes) <= {"altitude", "speed", "delay", "thrust"}
    assert explanation.causes
    groups = map_failures(out, {"v1": [failed]}).controllers["v1"]
    assert groups.looked_at == 1


def test_a_foreign_folder_runs_no_code(tmp_path, monkeypatch):
    ran = tmp_path / "ran"
    source = DIVE + f"\nopen({str(ran)!r}, 'a').write('x')\n"
    out = tmp_path / "out"
    run_campaign(Request(dive_campaign(tmp_path / "own", source, runs=20), out))
    ran.unlink()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "stranger"))
    build_report(out)
    for ask in (
        lambda: replay_flight(out, "v1", 0),
        lambda: explain_flight(out, "v1", 0),
        lambda: map_failures(out, {"v1": [0]}),
        lambda: run_campaign(Request(out / "campaign.yaml", tmp_path / "again")),
    ):
        with pytest.raises(InputError, match="--trust-code"):
            ask()
    assert not ran.exists()
    assert replay_flight(out, "v1", 0, trust_code=True).differences == ()
    assert ran.exists()


WELL = DIVE + "\nwell = fly\ndef fly(inputs, settings):\n    return "


@pytest.mark.parametrize(
    ("source", "pattern"),
    [
        (WELL + "well(inputs, settings) | {'load': time.time() % 1.0}\n", "not repeatable.*load"),
        (DIVE.replace('inputs["thrust"]', "1.0"), "^'thrust' from 0.91 to 1.09"),
    ],
)
def test_findings_of_the_first_flights_are_warnings(tmp_path, source, pattern):
    """A campaign with noise or with an input without effect runs, with a warning."""
    manifest = run_campaign(
        Request(dive_campaign(tmp_path / "own", source, runs=20), tmp_path / "out")
    ).manifest
    assert manifest.complete and any(re.search(pattern, warning) for warning in manifest.warnings)
    differences = replay_flight(tmp_path / "out", "v1", 0).differences
    assert any("load" in difference for difference in differences) == ("load" in pattern)


def test_a_simulator_without_flights_is_rejected_before_writing(tmp_path):
    path, out = (
        dive_campaign(tmp_path / "own", "import math\n\nmath.nothing\n", runs=300),
        tmp_path / "out",
    )
    with pytest.raises(
        InputError, match=r": AttributeError: module 'math' .* \(dive\.py, line 3\)"
    ):
        check_inputs(path)
    with pytest.raises(InputError, match=r"dive\.yaml:\d+:\d+: .*'v1'.*AttributeError"):
        run_campaign(Request(path, out))
    assert not out.exists()


def test_surplus_output_is_a_warning_and_standard_error_is_kept(tmp_path):
    text = (
        "import json, sys\nfor line in sys.stdin:\n    x = json.loads(line)['inputs']['thrust']\n"
    )
    text += "    answer = json.dumps({'altitude_min': x, 'load': x})\n"
    text += "    print('flying', file=sys.stderr)\n    if x > 1.03:\n        print(answer)\n"
    text += "    print(answer, flush=True)\n"
    out = tmp_path / "out"
    simulator = {"command": [sys.executable, "sim.py"], "files": ["results/"]}
    path = dive_campaign(tmp_path / "own", simulator=simulator, runs=60)
    (tmp_path / "own" / "sim.py").write_text(text)
    manifest = run_campaign(Request(path, out, workers=2)).manifest
    flown = read_flown(out)
    thrust = flown.samples["thrust"]
    for name in ("v1", "v2"):
        flights = flown.flights[name]
        assert flights.flight.tolist() == np.flatnonzero(thrust <= 1.03).tolist()
        assert np.array_equal(flights.metrics["altitude_min"], thrust[flights.flight])
        assert any(warning.startswith(f"'{name}' ") for warning in manifest.warnings)
        assert manifest.simulator_events and manifest.simulator_events[name]["surplus"]
    page = html.unescape(shown_text(build_report(out)))
    assert all(warning in page for warning in manifest.warnings)
    assert "flying" in (out / "simulator.log").read_text()
    before = {path: path.stat() for path in out.rglob("*")}
    flight = int(np.argmin(thrust))
    assert replay_flight(out, "v1", flight).differences == ()
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == {
        path: status.st_mtime_ns for path, status in before.items()
    }
    again = run_campaign(Request(out / "campaign.yaml", tmp_path / "again")).manifest
    assert again.digest == manifest.digest


def test_validate_warns_once_of_answers_matched_by_order(tmp_path):
    path = dive_campaign(tmp_path, simulator={"command": ["cat"]}, runs=300)
    (checked,) = check_inputs(path)
    assert [warning for warning in checked.warnings if "order" in warning]


def test_a_hanging_flight_ends_with_the_killed_command(tmp_path):
    alive = tmp_path / "alive"
    os.mkfifo(alive)
    source = DIVE + (
        f"\nheld = open({str(alive)!r}, 'w')\n"
        "def fly(inputs, settings):\n    print('x', file=held, flush=True)\n    time.sleep(600.0)\n"
    )
    path = dive_campaign(
        tmp_path / "own", source, simulator={"python": "dive.py", "time_limit": "600 s"}
    )
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    command = [sys.executable, "-m", "abhv_mc", "run", str(path), "-o", str(tmp_path / "out")]
    process = subprocess.Popen(
        command,
        start_new_session=True,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"TMPDIR": str(scratch)},
    )
    with alive.open("rb", buffering=0) as pipe:
        assert pipe.read(1)
        assert list(scratch.glob("abhv-mc-*/dive.py"))
        process.kill()
        process.wait()
        while (ready := select.select([pipe], [], [], 60.0)[0]) and pipe.read(1):
            pass
        assert ready  # end of file: no process has the pipe open
    while list(scratch.iterdir()):  # the watcher deletes the working folders
        select.select([], [], [], 0.05)


RATE = 4.0  # Hz
KEEP = {
    "histories": {"flights": "worst 5", "rate": f"{RATE:g} Hz"},
    "envelopes": {"rate": f"{RATE:g} Hz"},
}
HISTORIES = {"histories": DIVE_CHANNELS, "keep": KEEP, "runs": 60}
BANDED = 50  # flights in the envelopes


@pytest.fixture
def few_banded(monkeypatch):
    monkeypatch.setattr(envelope_states, "ENVELOPE_FLIGHTS", BANDED)


def paths_by_hand(folder, system, channel):
    """Return times and values of each flight of a system, computed without the package."""
    namespace = {}
    exec(DIVE_HISTORY, namespace)  # noqa: S102  our own text
    samples, settings = read_flown(folder).samples, {"v1": {"pull": 5.0}, "v2": {"pull": 6.0}}
    rows = [
        {"dive": 60.0} | dict(zip(samples, row, strict=True))
        for row in zip(*samples.values(), strict=True)
    ]
    flown = [namespace["fly"](inputs, settings[system])["history"] for inputs in rows]
    return [(history["time"], np.array(history[channel], float)) for history in flown]


@pytest.mark.usefixtures("few_banded")
def test_histories_and_envelopes_are_those_returned(tmp_path):
    """Histories are interpolated linearly; envelopes skip flights without a history."""
    out = tmp_path / "out"
    metrics = {
        **{name: {"unit": "ft"} for name in ("altitude_min", "load")},
        "dips": {"unit": "ft", "of": "eventually[0, 2](altitude < -5)"},
    }
    assert not run_campaign(
        Request(dive_campaign(tmp_path / "own", DIVE_HISTORY, metrics=metrics, **HISTORIES), out)
    ).manifest.not_made
    results, opened = read_flown(out), Results(out)
    assert set(results.flights["v1"].count_outcomes()) == {"ok", "ground"}
    histories = opened.histories.set_index(["controller", "flight", "time"])
    assert len(histories.loc["v1"].index.unique("flight")) == 5
    bands = (
        pq.read_table(out / "envelopes.parquet")
        .to_pandas()
        .set_index(["controller", "channel", "time"])
    )
    for system in ("v1", "v2"):
        altitudes = paths_by_hand(out, system, "altitude")
        for flight, (times, values) in enumerate(altitudes):
            grid = np.arange(np.ceil(times[0] * RATE), times[-1] * RATE + 1e-12) / RATE
            sampled = np.interp(grid, times, values).astype(np.float32).astype(float)
            is_known = sampled.size > 0 and not np.isnan(sampled).any()
            dips = -5.0 - sampled[:9].min() if is_known else np.nan
            metric = results.flights[system].metrics["dips"][flight]
            assert metric == pytest.approx(dips, nan_ok=True), flight
        for channel in DIVE_CHANNELS:  # every history has the first channel
            paths = paths_by_hand(out, system, channel)
            for flight, history in histories.loc[system].groupby("flight"):
                times, values = paths[flight]
                grid = np.arange(np.ceil(times[0] * RATE), times[-1] * RATE + 1e-12) / RATE
                expected = dict(zip(grid, np.interp(grid, times, values), strict=True))
                stored_times = history.index.get_level_values("time").tolist()
                if channel == "altitude":
                    assert stored_times == [
                        time for time, value in expected.items() if not np.isnan(value)
                    ]
                assert history[channel].to_numpy() == pytest.approx(
                    [expected[time] for time in stored_times], rel=1e-6
                )
            table = bands.loc[system, channel]
            table, expected = table[table["count"] > 0], bands_by_hand(paths[:BANDED])
            assert table.index.tolist() == list(expected)
            for name in next(iter(expected.values())):
                quantile = [quantiles[name] for quantiles in expected.values()]
                assert table[name].to_numpy() == pytest.approx(quantile, rel=1e-12, abs=1e-12), name
    field = pq.read_schema(next((out / "histories").glob("v1-*.parquet"))).field("altitude")
    assert field.type == "float" and field.metadata[b"unit"] == b"ft"
    show_histories(out)


def bands_by_hand(paths):
    """Return quantiles by time."""
    first, last = min(times[0] for times, _ in paths), max(times[-1] for times, _ in paths)
    bands = {}
    for k in range(int(np.floor(first * RATE)) - 1, int(np.ceil(last * RATE)) + 2):
        values_at = lambda time: [  # noqa: E731
            np.interp(time, *path) for path in paths if path[0][0] <= time <= path[0][-1]
        ]
        now = [value for value in values_at(k / RATE) if not np.isnan(value)]
        if not now:
            continue
        low, high = (k - 1) / RATE, (k + 1) / RATE
        near = [
            value
            for times, values in paths
            for time, value in zip(times, values, strict=True)
            if low <= time <= high
        ]
        near += values_at(low) + values_at(k / RATE) + values_at(high)
        bands[k / RATE] = {
            "count": len(now), "min": np.float32(np.nanmin(near)),
            "max": np.float32(np.nanmax(near)),
            **{f"q{100 * q:g}": np.quantile(np.float32(now).astype(float), q) for q in QUANTILES},
        }  # fmt: skip
    return bands


def show_histories(out):
    """Check that page, view of flights, replay and explorer show the returned histories."""
    page = build_report(out)
    text = shown_text(page)
    assert f"flights 0 to {BANDED - 1}" in text and "sink rate (ft/s)" in text
    assert 'id="plot"' in page.read_text("utf-8")
    data, arrays = make_flights_view(
        read_flown(out), {"v1": "v1", "v2": "v2"}, {"v1": "", "v2": ""}
    )
    assert [(channel["label"], channel["unit"]) for channel in data["channels"]] == [
        ("Altitude", "ft"),
        ("Sink rate", "ft/s"),
    ]
    opened = Results(out)
    groups = opened.histories.groupby(["controller", "flight"])
    assert data["criteria"][0]["channel"] == "altitude"
    assert len(arrays["history:altitude"]) == len(groups) == max(data["rows"]["history"]) + 1
    (_, flight), history = next(iter(groups))
    again = opened.replay(flight, "v1")
    assert again["altitude"].to_numpy() == pytest.approx(
        history["altitude"].to_numpy(), rel=0, nan_ok=True
    )
    with open_flights(out) as table, ExploreServer(out, table) as server:
        assert [channel["name"] for channel in table.view["channels"]] == ["altitude", "sink_rate"]
        opened_history = server.open_flight("v2", flight)["history"]
        assert (
            opened_history is not None
            and opened_history["time"].size
            and set(opened_history["channels"]) == {"altitude", "sink_rate"}
        )


@pytest.mark.usefixtures("few_banded")
def test_resumed_and_merged_campaigns_have_the_same_tables(tmp_path):
    flown, own, out = tmp_path / "flown", tmp_path / "own", tmp_path / "whole"
    source = DIVE_HISTORY + (
        f"\nonce = fly\ndef fly(inputs, settings):\n    open({str(flown)!r}, 'a').write('x')\n"
        "    return once(inputs, settings)\n"
    )
    changes = {"source": source} | HISTORIES | {"keep": KEEP | {"histories": {"flights": "none"}}}
    path = dive_campaign(own, **changes)
    reference = run_campaign(Request(path, out)).manifest
    bands = pq.read_table(out / "envelopes.parquet")
    run_campaign(Request(path, tmp_path / "grown", runs=25, controllers=("v1",)))
    run_campaign(Request(path, tmp_path / "grown", runs=25))
    before = flown.stat().st_size
    grown = run_campaign(Request(path, tmp_path / "grown")).manifest
    again = 4  # stored flights of each system
    assert flown.stat().st_size - before == 2 * (35 + again)
    shards = [tmp_path / "a", tmp_path / "b"]
    for i, shard in enumerate(shards, 1):
        run_campaign(Request(path, shard, shard=(i, 2)))
    joined = merge_campaign(shards, tmp_path / "joined").manifest
    assert reference.digest == grown.digest == joined.digest
    for name in ("grown", "joined"):
        assert pq.read_table(tmp_path / name / "envelopes.parquet").equals(bands)
    for other, pattern in (
        ({"systems": {"v1": {"pull": 5.5}, "v2": {"pull": 6.0}}}, r"systems\.v1\.pull"),
        ({"source": source + "\n"}, r"dive\.py: different content"),
    ):
        with pytest.raises(InputError, match=pattern):
            run_campaign(Request(dive_campaign(own, **changes | other), out))


@pytest.mark.parametrize(("seconds", "is_tried"), [(None, True), (0.99, True), (1.0, False)])
def test_dispersions_of_slow_flights_are_not_tried(tmp_path, monkeypatch, seconds, is_tried):
    monkeypatch.setattr(ExternalSimulator, "time_of_flight", lambda *_: seconds)
    path = dive_campaign(tmp_path, DIVE.replace('inputs["thrust"]', "1.0"), runs=4)
    campaign = read_campaign(path)
    plans = campaign.simulator.make_plans(campaign.controllers)
    warnings = fly_first(make_ready(campaign, plans), 1, {}).warnings
    assert any("'thrust'" in warning for warning in warnings) is is_tried
