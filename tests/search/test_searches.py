import json
import re
from dataclasses import replace

import numpy as np
import pytest
from fake_flight import (
    DENSITY,
    ENGINE,
    LIFT,
    LOST_BELOW,
    interrupted_after,
    prepare,
    write_campaign,
)
from golden import compare_report
from own_simulators import write_study
from scipy import stats
from search.known_flights import LIMIT, LINE, METRIC, fly_line, write_line
from search.methods.known_probabilities import paraboloid

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flights import SampleReader
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError
from abhv_mc.requests import RareRequest, WorstRequest
from abhv_mc.search.methods.second_opinion import ImportanceEstimate
from abhv_mc.search.rare import find_rare, find_requirement
from abhv_mc.search.search_flights import binding_requirements, rank_distinct
from abhv_mc.search.worst import MARGIN_EVALUATIONS, find_worst, find_worst_margins
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX


@pytest.fixture
def line(tmp_path):
    return write_line(tmp_path / "files")


@pytest.mark.parametrize(
    "find, make, options, last",
    [
        (find_rare, RareRequest, {"flights": 8000}, 20),
        (find_rare, RareRequest, {"surrogate": True}, 4),
        (find_worst, WorstRequest, {"flights": 1000}, 8),
    ],
)
def test_an_interrupted_search_goes_on_to_the_same_for_any_number_of_workers(
    tmp_path, line, find, make, options, last
):
    cut = tmp_path / "cut"
    complete, first, second = (
        make(line, folder, METRIC, workers=workers, **options)
        for folder, workers in ((tmp_path / "whole", 1), (cut, 1), (cut, 2))
    )
    complete = find(complete, LINE)
    with pytest.raises(KeyboardInterrupt):
        find(first, interrupted_after(last - 1, LINE))
    assert read_manifest(cut / "manifest.json").state == "interrupted"
    stored = sorted(path.name for path in (cut / "flights").glob("*.parquet"))
    assert stored
    again = find(second, LINE)
    assert again.numbers() == complete.numbers()
    assert (
        read_manifest(cut / "manifest.json").digest
        == read_manifest(tmp_path / "whole/manifest.json").digest
    )
    assert read_manifest(cut / "manifest.json").state == "complete"
    flown = []

    def fly_counted(plan, parameters, record_every=None):
        flown.append(len(parameters))
        return fly_line(plan, parameters, record_every)

    once_more = find(first, Engine(prepare, fly_counted, "line"))
    assert once_more.numbers() == complete.numbers()
    assert (
        sum(flown) <= 4
    )  # of what is complete the nominal flight and the worst, for their histories


def test_early_ends_count_as_failures_where_the_requirement_says_so(tmp_path):
    """The fake flight is lost below a density of which 0.5 % of a normal law lie."""
    sigma = (1.0 - LOST_BELOW) / stats.norm.isf(0.005)
    lift = "aero.lift: {distribution: normal, sigma: 5 %}"
    dispersions = f"{{atmosphere.density: {{distribution: normal, sigma: {sigma}}}, {lift}}}"
    for rule, probability in (("failure", 0.005), ("as_measured", None)):
        limit = f"[{{metric: {METRIC}, below: 1000, probability: 0.9, ended_early: {rule}}}]"
        campaign = write_campaign(tmp_path / rule, dispersions=dispersions, requirements=limit)
        result = find_rare(
            RareRequest(campaign, tmp_path / f"{rule}_out", METRIC, flights=8000),
            ENGINE,
        )
        assert result.includes_unwarned == (rule == "failure")
        assert 0 < result.numbers()["ended_early"] < result.flights.stop
        if probability is None:
            assert result.estimate.refusal is not None
        else:
            assert result.estimate.low <= probability <= result.estimate.high


def test_a_surrogate_learns_the_metric_and_says_what_it_is_not_for(tmp_path, line):
    found = find_rare(RareRequest(line, tmp_path / "out", METRIC, surrogate=True), LINE)
    numbers = found.numbers()
    assert numbers["low"] <= stats.norm.sf(4.0) <= numbers["high"] < 3.0 * numbers["low"]
    assert numbers["flights"] == found.flights.stop == numbers["surrogate"][-1]["runs"] <= 400
    assert numbers["failures"] == numbers["surrogate"][-1]["failures"] > 0
    assert f"{numbers['unwarned_high']:.1e}" in found.unwarned
    last, first = (numbers["surrogate"][k]["probabilities"] for k in (-1, 0))
    assert re.findall(r"\d\S*e\S*", found.second_opinion) == [f"{share:.1e}" for share in last]
    assert last != first
    discrete = "{aero.lift: {distribution: discrete, values: [0.9, 1.1]}}"
    turbulence = "{wind.turbulence: {distribution: uniform, low: 0 m/s, high: 2 m/s}}"
    for dispersions, problem in ((discrete, "'aero.lift'"), (turbulence, "turbulence")):
        campaign = write_campaign(tmp_path / problem, dispersions=dispersions, requirements=LIMIT)
        with pytest.raises(InputError, match=f"^--surrogate: .*{problem}.* without --surrogate"):
            find_rare(RareRequest(campaign, tmp_path / "no", METRIC, surrogate=True), LINE)
    with pytest.raises(InputError, match=r"^--flights: found 79; .* 80$"):
        find_rare(RareRequest(line, tmp_path / "no", METRIC, surrogate=True, flights=79), LINE)
    assert not (tmp_path / "no").exists()


def test_worst_finds_the_corner_and_its_folder_reads_like_a_campaigns(tmp_path, line):
    result = find_worst(WorstRequest(line, tmp_path / "out", METRIC, flights=400, box=2.5), LINE)
    numbers = result.numbers()
    assert numbers["value"] == pytest.approx(2.5)
    assert "aero.lift" in numbers["at_bounds"]
    assert numbers["parameters"]["aero.lift"] == pytest.approx(1.125)
    assert numbers["random_worst"] < numbers["value"]
    failures = numbers["requirements"][0]["failures"]
    values = result.flights.column(METRIC)[: result.searched]
    assert failures == (values >= result.requirements[0].limits.high).sum()
    assert result.severities[result.worst] == result.severities[: result.searched].max()
    reader = SampleReader(tmp_path / "out/samples.parquet")
    assert reader.flights == result.flights.stop
    np.testing.assert_array_equal(reader.rows(0, reader.flights), result.flights.samples)
    smallest = find_worst(
        WorstRequest(line, tmp_path / "low", METRIC, bad="low", flights=400, box=2.5), LINE
    )
    assert smallest.numbers()["value"] == pytest.approx(-2.5)


def test_numbers_of_a_worst_search_leave_out_random_and_failed_flights(tmp_path, line):
    found = find_worst(WorstRequest(line, tmp_path / "out", METRIC, flights=160), LINE)
    (requirement,), rows, searched = found.requirements, found.flights, found.searched
    assert rows.stop == 2 * searched == found.searched + found.random
    values = np.where(np.arange(rows.stop) % 10 < 4, 5.0, 3.0)  # The limit is 4.
    outcome = np.array(rows.outcome, object)
    outcome[[0, 1, 4, searched]] = Outcome.FAILED_TO_RUN.code
    outcome[[5, 6, 7, 11, searched + 1]] = Outcome.SIDESLIP_LIMIT.code
    made = np.where(np.array(rows.columns) == METRIC, values[:, None], rows.values)
    found = replace(found, flights=replace(rows, outcome=tuple(outcome.tolist()), values=made))
    numbers = found.numbers()
    failing = np.sum(values[:searched] >= 4.0) - 2 + 3  # two not computed, three early ends
    assert numbers["requirements"] == [{"below": 4.0, "failures": failing}]
    assert found.failures(requirement) == failing and numbers["ended_early"] == 4
    assert (numbers["value"], numbers["random_worst"]) == (
        values[found.worst],
        values[found.random_worst],
    )
    assert numbers["flight"] == found.worst < searched <= numbers["random_flight"]
    samples = rows.samples[found.worst].tolist()
    assert numbers["parameters"] == dict(zip(rows.names, samples, strict=True))
    assert numbers["outcome"] == outcome[found.worst]
    assert numbers["random_outcome"] == outcome[found.random_worst]
    assert found.severities.argmax() == found.worst and len(found.severities) == rows.stop
    assert found.drawn.numbers[0] == found.worst and max(found.drawn.numbers) < searched
    assert found.random_worst == searched + found.severities[searched:].argmax()
    for bad, limits, sign in (("low", None, -1.0), ("high", None, 1.0), ("low", 1, 1.0)):
        own = limits and requirement.limits
        criterion = found.criterion._replace(bad=bad, limits=own)
        assert replace(found, criterion=criterion).sign == sign
    with pytest.raises(InputError, match=r"^--flights: found 159; .* 160 .* 2 "):
        find_worst(WorstRequest(line, tmp_path / "few", METRIC, flights=159), LINE)


def test_an_early_end_is_worse_than_any_value(tmp_path):
    campaign = write_campaign(tmp_path / "files")
    result = find_worst(WorstRequest(campaign, tmp_path / "out", METRIC, flights=400), ENGINE)
    assert result.numbers()["outcome"] == Outcome.SIDESLIP_LIMIT.code
    assert result.numbers()["parameters"]["atmosphere.density"] < LOST_BELOW


def test_flights_that_cannot_be_computed_are_flown_again(tmp_path, line):
    def fly_weak(plan, parameters, record_every=None):
        block = fly_line(plan, parameters, record_every)
        block.outcome[parameters[:, LIFT] > 1.1] = int(Outcome.FAILED_TO_RUN)
        return block

    request = WorstRequest(line, tmp_path / "out", METRIC, flights=400, box=2.5)
    weak = find_worst(request, Engine(prepare, fly_weak, "line"))
    assert weak.failed_to_run > 0
    assert weak.numbers()["value"] <= 2.0 + 1e-9  # never the worst
    healed = find_worst(request, LINE)
    assert healed.failed_to_run == 0
    assert healed.numbers()["value"] == pytest.approx(2.5)


def test_all_combinations_of_discrete_parameters_are_tried_at_the_best_point(tmp_path):
    """Two of five values each, worst only together: no slope leads there."""
    values = "{distribution: discrete, values: [0.9, 0.95, 1.0, 1.05, 1.1]}"
    campaign = write_campaign(
        tmp_path / "files", dispersions=f"{{aero.lift: {values}, atmosphere.density: {values}}}"
    )

    def fly_pair(plan, parameters, record_every=None):
        block = fly_line(plan, parameters, record_every)
        together = (parameters[:, LIFT] == 0.95) & (parameters[:, DENSITY] == 1.05)
        block.metrics[:] = np.where(together, 50.0, parameters[:, LIFT] + parameters[:, DENSITY])[
            :, None
        ]
        return block

    request = WorstRequest(campaign, tmp_path / "out", METRIC, flights=200)
    result = find_worst(request, Engine(prepare, fly_pair, "pair"))
    assert result.numbers()["value"] == 50.0 and result.other_seeds is None


def test_seeds_are_common_in_worst_and_each_flights_own_in_rare(tmp_path):
    turbulence = "wind.turbulence: {distribution: uniform, low: 0 m/s, high: 2 m/s}"
    dispersions = f"{{aero.lift: {{distribution: normal, sigma: 5 %}}, {turbulence}}}"
    campaign = write_campaign(tmp_path / "files", dispersions=dispersions, requirements=LIMIT)

    def fly_turbulence(plan, parameters, record_every=None):
        block = fly_line(plan, parameters, record_every)
        block.metrics[:] += 0.01 * parameters[:, [PARAMETER_INDEX["wind.turbulence"]]]
        return block

    engine = Engine(prepare, fly_turbulence, "line")
    rare = find_rare(RareRequest(campaign, tmp_path / "rare", METRIC, flights=8000), engine)
    seeds = rare.flights.samples[:, rare.flights.names.index("wind.turbulence_seed")]
    assert len(np.unique(seeds)) == len(seeds)
    assert stats.kstest(seeds, "uniform").pvalue > 1e-3
    worst = find_worst(WorstRequest(campaign, tmp_path / "worst", METRIC, flights=400), engine)
    rows = worst.flights
    seeds = rows.samples[:, rows.names.index("wind.turbulence_seed")]
    assert len(np.unique(seeds[:-64])) == 1 and worst.names == ("aero.lift", "wind.turbulence")
    # 64 flights of the worst point follow with seeds of their own; the random ones stay as many as
    # the search's.
    assert len(np.unique(seeds[-64:])) == 64 and worst.random == worst.searched
    assert np.all(rows.samples[-64:, :2] == rows.samples[worst.worst, :2])
    value = worst.value(worst.worst)
    assert worst.other_seeds == (64, 0, (value, value, value))  # this flight has no noise
    assert worst.numbers()["other_seeds"]["range"] == (value, value, value)
    assert rare.noise_share == 0.0 and rare.includes_unwarned
    assert rare.estimate.high >= rare.estimate.unwarned_high
    assert f"{rare.estimate.unwarned_high:.1e}" in rare.unwarned


def test_numbers_of_a_rare_search_are_those_of_its_flights_and_combinations(tmp_path):
    switch = "atmosphere.density: {distribution: uniform, half_width: 2 %, probability: 40 %}"
    laws = f"{{aero.lift: {{distribution: normal, sigma: 5 %}}, {switch}}}"
    limit = "[{metric: altitude_error_max_m, below: 1.0, probability: 0.9}]"
    campaign = write_campaign(tmp_path / "files", dispersions=laws, requirements=limit)
    found = find_rare(RareRequest(campaign, tmp_path / "out", METRIC, flights=1600), LINE)
    numbers, estimate = found.numbers(), found.estimate
    values = found.flights.column(METRIC)
    np.testing.assert_array_equal(found.severities, values - 1.0)
    assert found.failures == numbers["failures"] == np.sum(values >= 1.0) > 0
    assert numbers["low"] <= stats.norm.sf(1.0) <= numbers["high"]
    for key in ("probability", "low", "high", "flights", "cov", "unwarned_high", "refusal"):
        assert numbers[key] == getattr(estimate, key)
    assert numbers["worst_flights"] == rank_distinct(found.severities, found.flights.samples, 20)
    assert numbers["below"] == 1.0 and numbers["confidence"] == 0.95 and not numbers["repetitions"]
    assert (numbers["ended_early"], numbers["failed_to_run"]) == (0, 0)
    combinations = numbers["combinations"]
    assert [own["weight"] for own in combinations] == pytest.approx([0.6, 0.4])
    for own, stratum in zip(combinations, found.strata, strict=True):
        assert own | {"on": stratum.on} == vars(stratum)
    words = [own["on"] for own in combinations]
    words.append(found.words(replace(found.strata[0], on=None)))
    assert [text == "'atmosphere.density'" for text in words] == [False, True, False]
    assert len({*words}) == 3
    refused = replace(found, estimate=replace(estimate, refusal="no")).numbers()
    assert [refused[key] for key in ("probability", "low", "high", "cov")] == [None] * 4
    assert refused["refusal"] == "no" and found.unwarned == ""


def test_second_opinions_and_bounds_are_printed_where_they_apply(tmp_path):
    line = write_line(tmp_path / "files", requirements=LIMIT.replace("4.0", "2.0"))
    found = find_rare(RareRequest(line, tmp_path / "out", METRIC, flights=4000), LINE)
    estimate, numbers = found.estimate, found.numbers()
    assert numbers["levels"] == [
        {
            "repetition": own.number,
            "limit": level.threshold,
            "probability": level.probability,
            "cov": level.cov,
            "acceptance": level.acceptance,
        }
        for own in estimate.repetitions
        for level in own.levels
    ]
    shares = [own.probability for own in estimate.repetitions]
    assert numbers["repetitions"] == shares and len(shares) < len(numbers["levels"])
    check = ImportanceEstimate(3.4e-5, np.inf, 12.3, 640)

    def replaced(check=None, names=2, high=1.0, included=False, **state):
        space = replace(found.space, names=found.space.names * (names // 2))
        made = replace(estimate, check=check, high=high, **state)
        return replace(found, estimate=made, space=space, includes_unwarned=included)

    assert replaced(check).numbers()["importance_sampling"] == vars(check) | {"cov": None}
    assert replaced().numbers()["importance_sampling"] is None
    assert re.findall(r"\d\S*", replaced(check).second_opinion) == ["3.4e-05", "12"]
    assert re.findall(r"\d+", replaced().second_opinion) == ["20"]  # most dimensions
    bound = f"{estimate.unwarned_high:.1e}"
    shown = {
        key: replaced(**options).unwarned
        for key, options in {
            "looked": {"check": check},
            "unchecked": {},
            "many": {"check": check, "names": 12},
            "by the bound": {"check": check, "included": True, "high": estimate.unwarned_high},
            "by levels": {"check": check, "included": True},
            "no flights": {"repetitions": ()},
        }.items()
    }
    assert shown.pop("looked") == shown.pop("no flights") == ""
    assert all(bound in text for text in shown.values())
    assert shown["many"] == shown["unchecked"] and len({*shown.values()}) == 3
    assert [key for key, text in shown.items() if "levels" in text] == ["by levels"]


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_noise_above_one_half_is_reported(tmp_path, capsys, share):
    turbulence = "wind.turbulence: {distribution: uniform, low: 0 m/s, high: 2 m/s}"
    campaign = write_campaign(
        tmp_path / "files", dispersions=f"{{{turbulence}}}", requirements=LIMIT
    )

    def fly_noise(plan, parameters, record_every=None):
        block = fly_line(plan, parameters, record_every)
        seeds = parameters[:, PARAMETER_INDEX["wind.turbulence_seed"]]
        level = parameters[:, PARAMETER_INDEX["wind.turbulence"]] / 2.0
        block.metrics[:] = (share * seeds + (1.0 - share) * level)[:, None]
        return block

    def find(flights):
        request = RareRequest(campaign, tmp_path / "out", METRIC, flights=flights)
        return find_rare(request, Engine(prepare, fly_noise, "noise"))

    with pytest.raises(InputError, match=r"1407\b.* 1408$"):  # 4 * 320 + 2 * 64
        find(1407)
    found = find(1600)
    expected = share**2 / (share**2 + (1.0 - share) ** 2)
    assert found.noise_share == pytest.approx(expected, abs=0.15) and found.includes_unwarned
    printed = re.findall(r"warning: (\d+) %", capsys.readouterr().err)
    assert printed == ([f"{100.0 * found.noise_share:.0f}"] if share > 0.5 else [])


def test_requirements_bind_the_controllers_that_they_name(tmp_path):
    entry = "{{metric: {}, below: 5, probability: 0.9{}}}"
    rows = [(METRIC, ""), ("sideslip_max_deg", ", controllers: [two]")]
    requirements = f"[{', '.join(entry.format(*row) for row in rows)}]"
    campaign = read_campaign(write_campaign(tmp_path, requirements=requirements))
    bound = {
        name: [item.metric for item in binding_requirements(campaign, name)]
        for name in ("one", "two")
    }
    assert bound == {"one": [METRIC], "two": [METRIC, "sideslip_max_deg"]}


def test_another_search_in_the_same_folder_is_refused(tmp_path, line):
    request = WorstRequest(line, tmp_path / "out", METRIC, flights=400)
    find_worst(request, LINE)
    before = (tmp_path / "out/manifest.json").read_bytes()
    with pytest.raises(InputError, match=r"\bflights: 400 -> 500\b"):
        find_worst(replace(request, flights=500), LINE)
    with pytest.raises(InputError, match=r"\bkind: worst -> rare\b"):
        find_rare(RareRequest(line, tmp_path / "out", METRIC, flights=8000), LINE)
    with pytest.raises(InputError, match=r"\bsource .*\bnewer\b"):
        find_worst(request, Engine(prepare, fly_line, "newer"))
    assert (tmp_path / "out/manifest.json").read_bytes() == before
    laws = "atmosphere.density: {distribution: uniform, half_width: 2 %}, "
    laws += "aero.lift: {distribution: normal, sigma: 5 %}"
    write_line(tmp_path / "files", dispersions=f"{{{laws}}}")  # in another order
    with pytest.raises(InputError, match="another campaign"):
        find_worst(request, LINE)


def test_new_limits_need_a_new_rare_search_but_no_new_worst_case(tmp_path):
    campaign = write_line(tmp_path / "files")
    worst = WorstRequest(campaign, tmp_path / "worst", METRIC, flights=160)
    rare = RareRequest(campaign, tmp_path / "rare", METRIC, flights=8000)
    before = find_worst(worst, LINE).numbers()
    find_rare(rare, LINE)
    write_line(tmp_path / "files", requirements=LIMIT.replace("4.0", "3.0"))
    after = find_worst(worst, LINE).numbers()
    assert after["value"] == before["value"] and after["requirements"] != before["requirements"]
    with pytest.raises(InputError, match=r"other requirements .*4.* -> .*3"):
        find_rare(rare, LINE)


def test_flights_of_other_seeds_have_a_range(tmp_path):
    turbulence = "wind.turbulence: {distribution: uniform, low: 0 m/s, high: 2 m/s}"
    discrete = "atmosphere.density: {distribution: discrete, values: [0.95, 1.05]}"
    laws = f"{{{turbulence}, {discrete}}}"  # All combinations have the seed of the search.
    campaign = write_campaign(tmp_path / "files", dispersions=laws)

    def fly_noise(plan, parameters, record_every=None):
        block = fly_line(plan, parameters, record_every)
        seeds = parameters[:, PARAMETER_INDEX["wind.turbulence_seed"]]
        turbulence = parameters[:, PARAMETER_INDEX["wind.turbulence"]]
        block.metrics[:, :-1] = (turbulence + seeds)[:, None]
        block.outcome[seeds > 0.9] = Outcome.SIDESLIP_LIMIT
        return block

    request = WorstRequest(campaign, tmp_path / "out", METRIC, flights=160)
    worst = find_worst(request, Engine(prepare, fly_noise, "noise"))
    seeds = worst.flights.samples[-64:, worst.flights.names.index("wind.turbulence_seed")]
    assert len({*worst.flights.samples[:-64, 2]}) == 1
    lasting = np.sort(seeds[seeds <= 0.9]) + worst.flights.samples[worst.worst, 0]
    number, early, ends = worst.other_seeds
    assert (number, early) == (64, 64 - len(lasting)) and early > 0
    assert ends == pytest.approx((lasting[0], np.median(lasting), lasting[-1]))


def test_a_metric_that_the_campaign_declares_is_searched_like_any_other(tmp_path):
    campaign = write_line(
        tmp_path / "files",
        metrics="{swing: {of: bank_deg, statistic: peak_to_peak}}",
        requirements="[{metric: swing, below: 3 deg, probability: 0.9}]",
    )
    result = find_rare(RareRequest(campaign, tmp_path / "out", "swing", flights=8000), LINE)
    assert result.estimate.low <= stats.norm.sf(3.0) <= result.estimate.high
    worst = find_worst(
        WorstRequest(campaign, tmp_path / "worst", "swing", flights=400, box=2.5),
        LINE,
    )
    assert worst.numbers()["value"] == pytest.approx(2.5)


@pytest.mark.parametrize("kind", ["dispersions", "unknowns"])
def test_a_hidden_corner_is_found_and_what_is_off_the_middle_is_named(monkeypatch, tmp_path, kind):
    """Return the margins of a synthetic loop.

    They are least at the maximum of density and at a lift of 0.94; drag has no effect.
    """
    law = "{low: -10 %, high: 10 %}"
    if kind == "dispersions":
        law = "{distribution: uniform, half_width: 10 %}"
    laws = f"{{atmosphere.density: {law}, aero.lift: {law}, aero.drag: {law}}}"
    campaign = read_campaign(write_campaign(tmp_path, **{"dispersions": "{}", kind: laws}))
    assert bool(campaign.unknowns.names) == (kind == "unknowns")

    def margins(rows):
        density, lift = (
            rows[:, PARAMETER_INDEX["atmosphere.density"]],
            rows[:, PARAMETER_INDEX["aero.lift"]],
        )
        least = 10.0 - 20.0 * (density - 1.0) + 1000.0 * (lift - 0.94) ** 2
        faults = ["unstable" if row > 1.09 else "" for row in density]
        return least[:, None] * np.arange(1.0, 5.0), faults

    monkeypatch.setattr(campaign.simulator, "trim_margins", lambda _: {"tlc": margins})
    found = find_worst_margins(campaign, ("tlc",))
    assert [(own.controller, own.metric) for own in found] == [("tlc", m) for m in MARGIN_NAMES]
    for factor, own in enumerate(found, 1):
        assert (own.nominal, own.found) == pytest.approx((13.6 * factor, 8.0 * factor), abs=4e-3)
        assert own.fault == "unstable" and 256 < own.evaluations <= MARGIN_EVALUATIONS
    gain = found[0]
    assert gain.nominal == pytest.approx(13.6)
    assert gain.found == pytest.approx(8.0, abs=1e-3)
    assert gain.parameters["atmosphere.density"] == pytest.approx(1.1)
    assert gain.parameters["aero.lift"] == pytest.approx(0.94, abs=1e-3)
    assert gain.moved[0] == "atmosphere.density" and "aero.lift" in gain.moved


def test_searches_of_a_users_simulator_find_what_is_known_of_its_function(tmp_path, own_list):
    body = "return {'total': inputs['a'] + 0.5 * inputs['b'] * inputs['b']}"
    path = write_study(
        tmp_path,
        f"def fly(inputs, settings):\n    {body}\n",
        inputs={"a": {}, "b": {}},
        dispersions={name: {"distribution": "normal", "sigma": 1.0} for name in "ab"},
        requirements=[{"metric": "total", "below": 7.0, "probability": 0.999}],
        seed=3,
    )
    worst = find_worst(WorstRequest(path, tmp_path / "worst", "total", flights=400)).numbers()
    assert worst["value"] == pytest.approx(3.0 + 0.5 * 9.0)
    assert np.abs([*worst["parameters"].values()]) == pytest.approx([3.0, 3.0])
    result = find_rare(RareRequest(path, tmp_path / "rare", "total", flights=8000)).estimate
    assert (
        result.refusal is None and result.low <= paraboloid(2, 7.0, 0.5).probability <= result.high
    )


def test_a_search_warns_of_what_the_first_flights_show(tmp_path, own_list, capsys):
    source = (
        "import random\ndef fly(inputs, settings):\n"
        "    return {'total': inputs['a'] + random.random()}\n"
    )
    path = write_study(tmp_path, source)
    find_worst(WorstRequest(path, tmp_path / "worst", "total", flights=160, workers=1))
    prefix = "not repeatable: "
    assert f"warning: {prefix}" in capsys.readouterr().err
    manifest = json.loads((tmp_path / "worst" / "manifest.json").read_text())
    assert [text.startswith(prefix) for text in manifest["warnings"]] == [True]


def test_a_requirement_is_named_by_its_id_or_by_its_metric(tmp_path):
    entry = "{{id: {}, metric: {}, below: {}, probability: 0.9}}"
    rows = [("R-1", METRIC, 2), ("R-2", METRIC, 3), ("R-3", "sideslip_max_deg", 4)]
    requirements = f"[{', '.join(entry.format(*row) for row in rows)}]"
    campaign = read_campaign(write_campaign(tmp_path, requirements=requirements))
    (controller, *_) = campaign.controllers
    assert find_requirement(campaign, controller, "R-2").limits.as_entry() == {"below": 3.0}
    assert find_requirement(campaign, controller, "sideslip_max_deg").traced["id"] == "R-3"
    with pytest.raises(InputError, match="'id'"):
        find_requirement(campaign, controller, METRIC)
    with pytest.raises(InputError, match="'R-4'"):
        find_requirement(campaign, controller, "R-4")


def test_the_numbers_of_searches_are_the_stored_ones(tmp_path):
    assert not compare_report("searches", tmp_path)
