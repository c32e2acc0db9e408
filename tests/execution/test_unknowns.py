"""Campaigns with unknowns: each sample is run and judged at every point of their box."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import DENSITY, DRAG, ENGINE, LIFT, fly, make_plan, run, write_campaign
from own_simulators import dive_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution import unknown_points
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.unknown_points import select_points
from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError
from abhv_mc.statistics.unknowns import judge_points
from abhv_mc.statistics.verdicts import judge, tolerance_limit
from abhv_mc.topics.verdicts.model import compute_verdicts
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX

UNKNOWNS = "{aero.lift: {low: -10 %, high: 10 %}, aero.drag: {low: 0.8, high: 1.15}}"
DISPERSIONS = "{atmosphere.density: {distribution: uniform, half_width: 10 %}}"
REQUIREMENTS = (
    "[{metric: speed_error_max_mps, below: 2.93, probability: 0.9, ended_early: as_measured},"
    " {metric: altitude_error_max_m, below: 50, probability: 0.9, controllers: [two]}]"
)
FILES = ("samples.parquet", "envelopes.parquet", "histories/one-000000.parquet")


def make(folder, **entries):
    entries = {
        "unknowns": UNKNOWNS,
        "dispersions": DISPERSIONS,
        "requirements": REQUIREMENTS,
        "runs": "80",
        **entries,
    }
    return write_campaign(folder, **entries)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unknowns")
    return run(make(folder / "f"), folder / "out")


def test_samples_are_run_at_every_point_of_the_folder(reference):
    points = read_document(reference.folder / "campaign.yaml").data["points"]
    coordinates = np.column_stack([points["at"]["aero.lift"], points["at"]["aero.drag"]])
    corners = {(lift, drag) for lift in (0.9, 1.1) for drag in (0.8, 1.15)}
    assert {tuple(point) for point in coordinates[:4].round(12)} == corners and coordinates[
        4
    ] == pytest.approx([1.0, 0.975])
    assert len(coordinates) > 5 and 4 + 1 + 2 * 32 < points["tried"] <= 4 + 1 + 2 * (32 + 2 * 64)
    samples = pq.read_table(reference.folder / "samples.parquet").to_pandas()
    assert samples.columns.tolist() == [
        "flight",
        "point",
        "atmosphere.density",
        "aero.lift",
        "aero.drag",
    ]
    assert len(samples) == 80 * len(coordinates)
    for _, rows in samples.groupby("point"):
        assert np.array_equal(
            rows["atmosphere.density"], samples["atmosphere.density"][:: len(coordinates)]
        )
    assert np.array_equal(samples[["aero.lift", "aero.drag"]], coordinates[samples["point"]])


def test_the_search_finds_the_worst_point(reference):
    """Compare with a grid of 21 x 21 values by the quantile that ranks the points."""
    results = read_flown(reference.folder)
    number = len(results.campaign.unknowns.points)
    speed = METRIC_INDEX["speed_error_max_mps"]
    grid = [
        (lift, drag) for lift in np.linspace(0.9, 1.1, 21) for drag in np.linspace(0.8, 1.15, 21)
    ]
    rows = nominal_parameters(80)
    rows[:, DENSITY] = results.samples["atmosphere.density"][::number]
    worst = []
    for rows[:, LIFT], rows[:, DRAG] in grid:
        worst.append(np.quantile(fly(make_plan("one"), rows).metrics[:, speed], 0.95))
    flown, point = (
        results.flights["one"].metrics["speed_error_max_mps"],
        results.flights["one"].flight % number,
    )
    largest = max(np.quantile(flown[point == k], 0.95) for k in range(number))
    assert largest > np.quantile(worst, 0.99) and largest > 0.99 * max(worst)


def test_envelopes_span_the_quantiles_of_all_points(tmp_path):
    """Compare with numpy's quantiles of the histories at each point, not of all flights."""
    keep = (
        "{histories: {flights: all, rate: 5 Hz}, envelopes: {rate: 5 Hz, channels: "
        "[bank_deg, speed_mps]}}"
    )
    points = "{at: {aero.lift: [0.9, 1.0, 1.1], aero.drag: [0.8, 1.15, 0.9]}}"
    out = run(make(tmp_path / "f", keep=keep, points=points, runs="20"), tmp_path / "out").folder
    envelope, histories = read_flown(out).envelopes["one", "speed_mps"], read_histories(out, "one")
    assert len(histories) == 60
    values = np.full((20, 3, len(envelope.time)), np.nan)
    for number, flown in histories.items():
        values[number // 3, number % 3, : len(flown["time"])] = flown["speed_mps"][
            : len(envelope.time)
        ]
    flying = ~np.isnan(values).any(axis=(0, 1))
    assert flying.sum() > 3
    for column, level, edge in (
        ("q0.135", 0.00135, np.min),
        ("q5", 0.05, np.min),
        ("q50", 0.5, np.min),
        ("q50_most", 0.5, np.max),
        ("q95", 0.95, np.max),
        ("q99.865", 0.99865, np.max),
    ):
        expected = edge(np.quantile(values[..., flying], level, axis=0), axis=0)
        np.testing.assert_allclose(envelope.bands[column][flying], expected, rtol=1e-12)
    assert envelope.bands["q50_most"][flying][-1] > envelope.bands["q50"][flying][-1]


def test_verdicts_hold_at_every_point(reference):
    results = read_flown(reference.folder)
    number = len(results.campaign.unknowns.points)
    requirements = compute_verdicts(results).requirements
    for entry in requirements:
        for name, verdict in entry.controllers.items():
            flights = results.flights[name]
            values, point = flights.metrics[entry.asked.metric], flights.flight % number
            failed = ~(values < entry.asked.limits.high) | (
                flights.failed & entry.asked.early_is_failure
            )
            verdicts = [judge(int(failed[point == k].sum()), 80, 0.9) for k in range(number)]
            expected, worst = judge_points(verdicts)
            assert (verdict.status, verdict.failures, verdict.flights) == (
                expected.status,
                expected.failures,
                80,
            )
            note = (
                rf"\bof {number} [^(]*\({re.escape(results.campaign.unknowns.words(worst))}\)"
                if verdict.failures
                else rf"\beach of {number}\b"
            )
            assert re.search(note, verdict.note)
            worse = np.where(flights.failed & entry.asked.early_is_failure, np.inf, values)
            limits = [tolerance_limit(worse[point == k], 0, 0.9, 0.1) for k in range(number)]
            assert verdict.tolerance_limit == (None if max(limits) == np.inf else max(limits))
    stored = {
        (v.metric, v.controller): v
        for v in (*results.manifest.requirements, *results.manifest.requirements_shown)
    }
    for entry in requirements:
        for name, verdict in entry.controllers.items():
            summary = stored[entry.asked.metric, name]
            assert (summary.verdict, summary.words, summary.failures) == (
                verdict.status,
                verdict.words,
                verdict.failures,
            )
            assert summary.failures_ended_early + summary.failures_measured == summary.failures
    assert len({v.verdict for v in stored.values()}) > 1


def same(a, b):
    assert (
        a.manifest.digest == b.manifest.digest
        and a.manifest.requirements == b.manifest.requirements
    )
    assert a.manifest.campaign_hash == b.manifest.campaign_hash
    for name in FILES:
        assert pq.read_table(a.folder / name).equals(pq.read_table(b.folder / name))


def test_resuming_gives_the_same_result(reference, tmp_path):
    campaign = make(tmp_path / "f", execution="{workers: 1, batch: 33}")
    calls = iter(range(6))

    def fly_until(plan, parameters, recorded=None):
        if (
            isinstance(recorded, Recording) and next(calls, None) is None
        ):  # flights of the search have no recording
            raise KeyboardInterrupt
        return fly(plan, parameters, recorded)

    first = run(campaign, tmp_path / "out", replace(ENGINE, fly=fly_until), workers=1)
    assert not first.complete and first.manifest.runs_done
    same(reference, run(campaign, tmp_path / "out"))


def test_shards_and_extensions_keep_the_points(reference, tmp_path):
    campaign = make(tmp_path / "f")
    parts = [run(campaign, tmp_path / f"part{i}", shard=(i, 2)).folder for i in (1, 2)]
    same(reference, merge_campaign(parts, tmp_path / "merged", ENGINE))
    searched = read_flown(run(campaign, tmp_path / "out", runs=30).folder).campaign.unknowns
    extended = read_flown(run(campaign, tmp_path / "out").folder).campaign
    assert np.array_equal(extended.unknowns.points, searched.points)
    assert {entry.flights for entry in extended.unknowns.most_failures} == {32}
    assert extended.runs == 80 * len(searched.points)


def test_a_campaign_with_unknowns_stops_when_proven(tmp_path):
    requirements = (
        "[{metric: speed_error_max_mps, below: 50, probability: 0.9, ended_early: as_measured}]"
    )
    result = run(
        make(tmp_path / "f", stop="when proven", runs="500", requirements=requirements),
        tmp_path / "out",
    )
    number = len(read_flown(result.folder).campaign.unknowns.points)
    (verdict,) = result.manifest.requirements
    assert (
        verdict.verdict == "PASS"
        and result.manifest.stopped_at == number * verdict.flights < number * 500
    )


def test_incompatible_requests_are_rejected(reference, tmp_path):
    campaign = make(tmp_path / "f")
    run(campaign, tmp_path / "out", controllers=("one",), runs=5)
    with pytest.raises(InputError, match=r"/out: .*\btwo\b"):
        run(campaign, tmp_path / "out", runs=5)
    other = run(make(tmp_path / "g", seed="6"), tmp_path / "other")
    with pytest.raises(InputError, match=rf"/other: .* {reference.folder};"):
        merge_campaign([reference.folder, other.folder], tmp_path / "merged", ENGINE)


@pytest.mark.parametrize(
    ("entries", "line", "pattern"),
    [
        ({"unknowns": "{atmosphere.density: {low: 1, high: 2}}"}, "unknowns", "atmosphere.density"),
        ({"unknowns": "{aero.lift: {low: 1.1, high: 0.9}}"}, "unknowns", r"\b1\.1\b.*\b0\.9\b"),
        ({"unknowns": "{aero.left: {low: 0.9, high: 1.1}}"}, "unknowns", "'aero.left'"),
        ({"unknowns": "{aero.lift: {low: 5 m, high: 1.1}}"}, "unknowns", "5 m"),
        ({"sampling": "sobol"}, "unknowns", "'sobol'"),
        ({"points": "{at: {aero.lift: [1.0]}}"}, "points", r"aero\.lift"),
        (
            {"points": "{at: {aero.lift: [1.0], aero.drag: [1.0]}, shared: 2}"},
            "points",
            r"\b1 point\b",
        ),
        ({"pooled": "[{seed: 5, runs: 80}]"}, "pooled", r"\b80\b"),
    ],
)
def test_errors_have_a_location(tmp_path, entries, line, pattern):
    path = make(tmp_path, **entries)
    with pytest.raises(InputError, match=pattern) as refused:
        read_campaign(path)
    assert path.read_text().splitlines()[refused.value.line - 1].startswith(line)


def test_bounds_in_percent_of_an_input_in_percent_are_no_change(tmp_path):
    inputs = {
        name: {"unit": "-", "nominal": 1.0}
        for name in ("altitude", "speed", "dive", "delay", "thrust")
    }
    inputs["fill"] = {"unit": "%", "nominal": 50.0}
    unknowns = {"fill": {"low": "40 %", "high": 60.0}}
    box = read_campaign(
        dive_campaign(tmp_path, inputs=inputs, dispersions={}, unknowns=unknowns)
    ).unknowns
    assert (box.low.tolist(), box.high.tolist()) == ([40.0], [60.0])


def test_points_of_a_baseline_are_added_up_to_the_bounds(tmp_path):
    campaign = read_campaign(make(tmp_path, requirements="[]"))
    points = np.array([[0.9, 1.0], [1.02, 0.9], [0.89, 1.0]])
    unknowns = replace(campaign.unknowns, points=points)
    chosen = select_points(campaign, {"one": None}, 1, unknowns).unknowns.points
    found = [np.isclose(chosen, point).all(axis=1).any() for point in points]
    assert found == [True, True, False]


def test_a_point_of_the_most_failures_is_judged_for_its_requirement_alone(tmp_path):
    """Both metrics exceed their limits only at the third point, of the first requirement."""
    requirements = (
        "[{metric: speed_error_max_mps, below: 1.8, probability: 0.99, ended_early: as_measured},"
        " {metric: altitude_error_max_m, below: 1.8, probability: 0.99, ended_early: as_measured}]"
    )
    points = (
        "{tried: 7, at: {aero.lift: [0.9, 0.9, 1.1], aero.drag: [0.8, 1.15, 1.15]}, shared: 2, "
        "most_failures:"
        " [{controller: one, requirement: 0, point: 2, failures: 9, tried: 7},"
        " {controller: one, requirement: 1, point: 1, failures: 0, tried: 7}]}"
    )
    campaign = make(tmp_path / "f", points=points, requirements=requirements, runs="20")
    results = read_flown(run(campaign, tmp_path / "out").folder)
    flights = results.flights["one"]
    speed, altitude = compute_verdicts(results).requirements
    for entry, judged in ((speed, (0, 1, 2)), (altitude, (0, 1))):
        failed = entry.asked.limits.failures(flights.metrics[entry.asked.metric])
        counts = [int(failed[flights.flight % 3 == k].sum()) for k in range(3)]
        verdict = entry.controllers["one"]
        assert verdict.failures == max(counts[k] for k in judged)
        assert counts[2] > max(counts[:2])
        assert f" {len(judged)} values " in verdict.note
        if entry is speed:
            most = rf"\b9 in 256 .*\blift \+10\s%, drag \+15\s% .*\b{counts[2]} of 20 "
            assert re.search(most, verdict.note)
        else:
            assert re.search(r"\b7 .*\b256 ", verdict.note) and " in 256 " in verdict.note
    stored = {(v.metric, v.controller): v for v in results.manifest.requirements}
    for entry in (speed, altitude):
        summary = stored[entry.asked.metric, "one"]
        assert (summary.verdict, summary.words) == (
            entry.controllers["one"].status,
            entry.controllers["one"].words,
        )


def test_trials_rank_points_by_a_quantile_and_count_failures(tmp_path, monkeypatch):
    """At each of two points, 32 flights have the values 0 to 31; one is lost, one has no value."""
    requirements = (
        "[{metric: speed_error_max_mps, below: 30, probability: 0.9, ended_early: as_measured},"
        " {metric: speed_error_max_mps, above: 2, probability: 0.9}]"
    )
    campaign = read_campaign(make(tmp_path, runs="20", requirements=requirements))
    column = [metric.name for metric in campaign.measured].index("speed_error_max_mps")
    metrics = np.full((64, len(campaign.measured)), -99.0)
    metrics[:, column] = np.tile(np.arange(32.0), 2)
    metrics[63, column] = np.nan
    outcome = np.where(np.arange(64) == 40, Outcome.SIDESLIP_LIMIT, Outcome.OK)
    block = SimpleNamespace(metrics=metrics, outcome=outcome)
    monkeypatch.setattr(unknown_points, "simulate", lambda *_, **__: block)
    stub, added = SimpleNamespace(fly_parallel=None), []
    progress = SimpleNamespace(add=added.append)
    trial = unknown_points._evaluate(campaign, "one", stub, progress, np.zeros((2, 2)))
    assert added == [64]
    # The 95 % quantile of 32 flights is the 31st of them, and all failures are counted.
    assert trial.severity.tolist() == [[30.0, -1.0], [30.0, np.inf]]
    assert trial.failures.tolist() == [[2, 3], [2, 5]]
    assert trial.largest.tolist() == [[31.0, 0.0], [np.inf, np.inf]]


def test_severities_of_a_search_are_order_statistics_at_each_point(monkeypatch):
    """Four flights at each of two points; NaN fails, and an early end if it is a failure."""
    values = np.array([[1.0, 5.0, 2.0, 3.0, 7.0, np.nan, 6.0, 8.0], [9.0, *[1.0] * 7]]).T
    outcome = np.array([0, 0, 0, 3, 0, 0, 0, 0])

    def simulate(campaign, name, rows, recording, fly, *, margins):
        flown.append((name, rows, fly, margins))
        return SimpleNamespace(metrics=values, outcome=outcome)

    def requirement(metric, limit, early):
        limits = Bounds(high=limit)
        return SimpleNamespace(metric=metric, limits=limits, early_is_failure=early)

    flown, added = [], []
    campaign = SimpleNamespace(
        runs_at_point=4,
        unknowns=SimpleNamespace(values=lambda points: points + 1.0),
        search_rows=lambda size, points: np.arange(8),
        margin_flights=0,
        measured=[SimpleNamespace(name=name) for name in ("a", "b")],
        requirements=[
            requirement("a", 6.5, True), requirement("a", 2.5, False), requirement("b", 3.0, True)
        ],
    )  # fmt: skip
    monkeypatch.setattr(unknown_points, "simulate", simulate)
    monkeypatch.setattr(unknown_points, "SEARCH_QUANTILE", 0.5)
    executor = SimpleNamespace(fly_parallel="fly")
    progress = SimpleNamespace(add=added.append)
    trial = unknown_points._evaluate(campaign, "one", executor, progress, np.zeros((2, 1)))
    ((name, _, fly, margins),) = flown
    assert (name, fly, margins, added) == ("one", "fly", False, [8])
    inf = np.inf
    severities = [
        [[1.0, 5.0, 2.0, inf], [7.0, inf, 6.0, 8.0]],
        [[1.0, 5.0, 2.0, 3.0], [7.0, inf, 6.0, 8.0]],
        [[9.0, 1.0, 1.0, inf], [1.0] * 4],
    ]
    for k, (severity, limit) in enumerate(zip(severities, (6.5, 2.5, 3.0), strict=True)):
        ordered = np.sort(severity, axis=1)
        np.testing.assert_array_equal(trial.severity[:, k], ordered[:, 2])  # the higher median
        np.testing.assert_array_equal(trial.largest[:, k], ordered[:, 3])
        assert trial.failures[:, k].tolist() == (ordered >= limit).sum(axis=1).tolist()
