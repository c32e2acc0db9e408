"""A campaign with unknowns: each flight flown at every point of their box, judged at each, however it is flown."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import DENSITY, DRAG, ENGINE, LIFT, fly, make_plan, run, write_campaign
from own_simulators import dive_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.plan import Recording
from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.io.documents import InputError, read_document
from abhv_mc.report.numbers.pass_chances import plan_campaign
from abhv_mc.statistics.unknowns import judge_points
from abhv_mc.statistics.verdicts import judge, tolerance_limit
from abhv_mc.topics.verdicts.model import compute_verdicts

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
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unknowns")
    return run(make(folder / "f"), folder / "out")


def test_a_sample_flies_at_every_point_and_the_folder_names_them(whole):
    points = read_document(whole.folder / "campaign.yaml").data["points"]
    at = np.column_stack([points["at"]["aero.lift"], points["at"]["aero.drag"]])
    corners = {(lift, drag) for lift in (0.9, 1.1) for drag in (0.8, 1.15)}
    assert {tuple(point) for point in at[:4].round(12)} == corners and at[4] == pytest.approx(
        [1.0, 0.975]
    )
    assert len(at) > 5 and 4 + 1 + 2 * 32 < points["tried"] <= 4 + 1 + 2 * (32 + 2 * 64)
    samples = pq.read_table(whole.folder / "samples.parquet").to_pandas()
    assert samples.columns.tolist() == [
        "flight",
        "point",
        "atmosphere.density",
        "aero.lift",
        "aero.drag",
    ]
    assert len(samples) == 80 * len(at)
    for _, each in samples.groupby("point"):
        assert np.array_equal(each["atmosphere.density"], samples["atmosphere.density"][:: len(at)])
    assert np.array_equal(samples[["aero.lift", "aero.drag"]], at[samples["point"]])


def test_the_search_finds_what_is_worst(whole):
    """Beside a brute grid of 21 x 21 values, of the quantile by which points are ranked."""
    results = read_flown(whole.folder)
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
    found = max(np.quantile(flown[point == k], 0.95) for k in range(number))
    assert found > np.quantile(worst, 0.99) and found > 0.99 * max(worst)


def test_a_band_goes_from_the_least_to_the_most_quantile_over_the_points(tmp_path):
    """Beside numpy's, of every kept history; not those of all flights together, which no vehicle flies."""
    keep = "{histories: {flights: all, rate: 5 Hz}, envelopes: {rate: 5 Hz, channels: [bank_deg, speed_mps]}}"
    points = "{at: {aero.lift: [0.9, 1.0, 1.1], aero.drag: [0.8, 1.15, 0.9]}}"
    out = run(make(tmp_path / "f", keep=keep, points=points, runs="20"), tmp_path / "out").folder
    found, kept = read_flown(out).envelopes["one", "speed_mps"], read_histories(out, "one")
    assert len(kept) == 60
    values = np.full((20, 3, len(found.time)), np.nan)
    for number, flown in kept.items():
        values[number // 3, number % 3, : len(flown["time"])] = flown["speed_mps"][
            : len(found.time)
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
        wanted = edge(np.quantile(values[..., flying], level, axis=0), axis=0)
        np.testing.assert_allclose(found.bands[column][flying], wanted, rtol=1e-12)
    assert found.bands["q50_most"][flying][-1] > found.bands["q50"][flying][-1]


def test_verdicts_are_of_every_point(whole):
    results = read_flown(whole.folder)
    number = len(results.campaign.unknowns.points)
    found = compute_verdicts(results).requirements
    for entry in found:
        for name, verdict in entry.controllers.items():
            flights = results.flights[name]
            values, point = flights.metrics[entry.asked.metric], flights.flight % number
            failed = ~(values < entry.asked.limits.high) | (
                flights.failed & entry.asked.early_is_failure
            )
            each = [judge(int(failed[point == k].sum()), 80, 0.9) for k in range(number)]
            expected, worst = judge_points(each)
            assert (verdict.status, verdict.failures, verdict.flights) == (
                expected.status,
                expected.failures,
                80,
            )
            at = f"worst of {number} values of the unknowns ({results.campaign.unknowns.words(worst)})"
            assert (at if verdict.failures else f"each of {number} values") in verdict.note
            worse = np.where(flights.failed & entry.asked.early_is_failure, np.inf, values)
            limits = [tolerance_limit(worse[point == k], 0, 0.9, 0.1) for k in range(number)]
            assert verdict.tolerance_limit == (None if max(limits) == np.inf else max(limits))
    shown = {
        (v.metric, v.controller): v
        for v in (*results.manifest.requirements, *results.manifest.requirements_shown)
    }
    for entry in found:
        for name, verdict in entry.controllers.items():
            held = shown[entry.asked.metric, name]
            assert (held.verdict, held.words, held.failures) == (
                verdict.status,
                verdict.words,
                verdict.failures,
            )
            assert held.failures_ended_early + held.failures_measured == held.failures
    assert len({v.verdict for v in shown.values()}) > 1


def same(a, b):
    assert (
        a.manifest.digest == b.manifest.digest
        and a.manifest.requirements == b.manifest.requirements
    )
    assert a.manifest.campaign_hash == b.manifest.campaign_hash
    for name in FILES:
        assert pq.read_table(a.folder / name).equals(pq.read_table(b.folder / name))


def test_interrupted_and_resumed_it_is_the_same(whole, tmp_path):
    campaign = make(tmp_path / "f", execution="{workers: 1, batch: 33}")
    calls = iter(range(6))

    def fly_until(plan, parameters, recorded=None):
        if (
            isinstance(recorded, Recording) and next(calls, None) is None
        ):  # the search's flights record nothing
            raise KeyboardInterrupt
        return fly(plan, parameters, recorded)

    first = run(campaign, tmp_path / "out", replace(ENGINE, fly=fly_until), workers=1)
    assert not first.complete and first.manifest.runs_done
    same(whole, run(campaign, tmp_path / "out"))


def test_in_shards_or_extended_it_keeps_its_points(whole, tmp_path):
    campaign = make(tmp_path / "f")
    parts = [run(campaign, tmp_path / f"part{i}", shard=(i, 2)).folder for i in (1, 2)]
    same(whole, merge_campaign(parts, tmp_path / "merged", ENGINE))
    searched = read_flown(run(campaign, tmp_path / "out", runs=30).folder).campaign.unknowns
    extended = read_flown(run(campaign, tmp_path / "out").folder).campaign
    assert np.array_equal(extended.unknowns.points, searched.points)
    assert {entry.flights for entry in extended.unknowns.most_failures} == {32}
    assert extended.runs == 80 * len(searched.points)


def test_it_stops_when_proven(tmp_path):
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


def test_what_does_not_go_together_is_refused(whole, tmp_path):
    campaign = make(tmp_path / "f")
    run(campaign, tmp_path / "out", controllers=("one",), runs=5)
    with pytest.raises(InputError, match="found without two"):
        run(campaign, tmp_path / "out", runs=5)
    other = run(make(tmp_path / "g", seed="6"), tmp_path / "other")
    with pytest.raises(InputError, match="campaign differs"):
        merge_campaign([whole.folder, other.folder], tmp_path / "merged", ENGINE)


@pytest.mark.parametrize(
    ("entries", "line", "words"),
    [
        ({"unknowns": "{atmosphere.density: {low: 1, high: 2}}"}, "unknowns", "a dispersion, too"),
        ({"unknowns": "{aero.lift: {low: 1.1, high: 0.9}}"}, "unknowns", "an empty range"),
        ({"unknowns": "{aero.left: {low: 0.9, high: 1.1}}"}, "unknowns", "unknown parameter"),
        ({"unknowns": "{aero.lift: {low: 5 m, high: 1.1}}"}, "unknowns", "5 m"),
        ({"sampling": "sobol"}, "unknowns", "the design 'sobol'"),
        ({"points": "{at: {aero.lift: [1.0]}}"}, "points", "points of aero.lift"),
        (
            {"points": "{at: {aero.lift: [1.0], aero.drag: [1.0]}, shared: 2}"},
            "points",
            "more than the 1 points",
        ),
        ({"pooled": "[{seed: 5, runs: 80}]"}, "pooled", "80 pooled flights"),
    ],
)
def test_what_is_wrong_has_its_place(tmp_path, entries, line, words):
    path = make(tmp_path, **entries)
    with pytest.raises(InputError, match=words) as refused:
        read_campaign(path)
    assert path.read_text().splitlines()[refused.value.line - 1].startswith(line)


def test_bounds_in_percent_of_an_input_in_percent_are_no_change(tmp_path):
    inputs = {
        name: {"unit": "-", "nominal": 1.0}
        for name in ("altitude", "speed", "dive", "delay", "thrust")
    }
    inputs["fill"] = {"unit": "%", "nominal": 50.0}
    unknowns = {"fill": {"low": "40 %", "high": 60.0}}
    found = read_campaign(
        dive_campaign(tmp_path, inputs=inputs, dispersions={}, unknowns=unknowns)
    ).unknowns
    assert (found.low.tolist(), found.high.tolist()) == ([40.0], [60.0])


def test_plan_tells_the_flights(tmp_path):
    planned = plan_campaign(read_campaign(make(tmp_path)))
    assert planned.runs == 80 and planned.most_points == 4 + 1 + 2 * 2 * 2
    assert planned.search_flights == 2 * 80 * (4 + 1 + 32 + 2 * 64)


def test_a_point_of_the_most_failures_is_judged_for_its_requirement_alone(tmp_path):
    """Only at the third point both metrics exceed their limits; the second requirement is not judged there."""
    requirements = (
        "[{metric: speed_error_max_mps, below: 1.8, probability: 0.99, ended_early: as_measured},"
        " {metric: altitude_error_max_m, below: 1.8, probability: 0.99, ended_early: as_measured}]"
    )
    points = (
        "{tried: 7, at: {aero.lift: [0.9, 0.9, 1.1], aero.drag: [0.8, 1.15, 1.15]}, shared: 2, most_failures:"
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
        assert f"{len(judged)} values of the unknowns" in verdict.note
        if entry is speed:
            said = f"most failures were 9 of 256 at lift +10 %, drag +15 %, there {counts[2]} of 20 flights"
            assert said in verdict.note
        else:
            assert "of 7 values tried none failed in 256 flights" in verdict.note
    held = {(v.metric, v.controller): v for v in results.manifest.requirements}
    for entry in (speed, altitude):
        shown = held[entry.asked.metric, "one"]
        assert (shown.verdict, shown.words) == (
            entry.controllers["one"].status,
            entry.controllers["one"].words,
        )
