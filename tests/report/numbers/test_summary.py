"""Summary of a campaign with its next step, and chances of PASS of a planned campaign."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import write_campaign as write_fake
from report.synthetic import build_page, write_campaign
from scipy.stats import binom

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.pass_chances import plan_campaign
from abhv_mc.report.numbers.summary import read_summary, summarize
from abhv_mc.topics.comparison.model import make_standings
from abhv_mc.topics.formatting import MINUS, json_data, percent
from abhv_mc.topics.topic import Models

REQUIRED = (
    "{{metric: speed_error_max_mps, below: {limit}, probability: {probability}, "
    "consumer_risk: 0.1}}"
)


def lines_of(models):
    """Return the entries of the summary by label, as lines."""
    records = summarize(models).records
    return {record.label: [entry.line for entry in record.entries] for record in records}


def judged(folder, requirements, **keys):
    keys = {"controllers": ["tlc", "lqr"], **keys}
    models = Models(read_flown(write_campaign(folder, requirements=requirements, **keys)))
    return lines_of(models), models


@pytest.mark.parametrize(
    ("limit", "probability", "label", "command"),
    [
        (1e6, 0.5, "Meets all 1 requirements", "none"),
        (1e6, 0.95, "Meets all 1 requirements", "joint PASS"),
        (1e6, 0.98, "Not shown", "--runs"),
        (1e-9, 0.9, "Misses", "explain DIR --all"),
    ],
)
def test_what_is_met_and_what_would_help(tmp_path, limit, probability, label, command):
    lines, _ = judged(tmp_path / "c", [REQUIRED.format(limit=limit, probability=probability)])
    assert lines[label][0].startswith("LQR, TLC") and command in lines["Next"][0]
    assert ("Risk" in lines) == label.startswith("Meets")  # only of a PASS
    assert ("Flights needed" in lines) == (label == "Not shown")


def test_the_stored_summary_is_the_same_and_fits_a_terminal(tmp_path):
    folder = tmp_path / "c"
    _, models = judged(folder, [REQUIRED.format(limit=1e6, probability=0.99)])
    build_page(folder)
    manifest = read_flown(folder).manifest
    assert read_summary(folder, manifest).records == summarize(models).records
    assert max(map(len, repr(summarize(models)).splitlines())) <= 80
    assert (
        read_summary(folder, replace(manifest, digest="another"))
        is read_summary(tmp_path, manifest)
        is None
    )


def test_early_terminations_name_who_has_fewer_and_alone_nothing_is_compared(tmp_path):
    requirements = [REQUIRED.format(limit=1e6, probability=0.5)]
    lines, _ = judged(tmp_path / "c", requirements, failing=20)
    assert lines["Early terminations"] == ["LQR: 20 of 60, more than TLC"]
    assert not {"Better in", "Not beaten"} & {
        *judged(tmp_path / "one", requirements, controllers=["tlc"])[0]
    }
    assert "No comparison" in judged(tmp_path / "lhs", requirements, sampling="lhs", runs=16)[0]


def test_missed_requirements_name_the_most_exceeded_for_few_controllers(tmp_path):
    """All flights miss two requirements, of which one allows half and the other 10 %."""
    metrics = {"speed_error_max_mps": 1e-9, "sideslip_max_deg": 1e-9, "altitude_error_max_m": 1e9}
    requirements = [
        f"{{metric: {metric}, below: {limit}, probability: {0.5 if 'speed' in metric else 0.9}}}"
        for metric, limit in metrics.items()
    ]
    for count, text in ((2, "2 of 3, max sideslip 60 of 60"), (5, "2 of 3")):
        names = ["tlc", "slow", "c", "b", "a"][:count]
        lines, models = judged(tmp_path / str(count), requirements, controllers=names)
        labels = ", ".join(map(models.names.label, sorted(names))) if count == 2 else "all"
        assert lines["Misses"] == [f"{labels}: {text}"]


@pytest.mark.parametrize("asks", ["drivers", "worst", "{compare: [lqr_retuned, tlc]}"])
def test_the_first_record_answers_the_question(tmp_path, asks):
    controllers = ["tlc", "lqr", "lqr_retuned"]
    requirements = [REQUIRED.format(limit=1e-9, probability=0.9)]
    lines, models = judged(tmp_path / "c", requirements, controllers=controllers, asks=asks)
    first = {"drivers": "Drivers", "worst": "Worst flight"}.get(asks, "Misses")
    assert next(iter(lines)) == first
    compared = " ".join(lines.get("Better in", []) + lines.get("Not beaten", []))
    assert ("LQR:" in compared or "LQR 1" in compared) <= ("compare" not in asks)
    flights = models.results.flights
    tlc, lqr = (flights[name].metrics["speed_error_max_mps"] for name in ("tlc", "lqr_retuned"))
    share = max(np.mean(tlc < lqr), np.mean(lqr < tlc))
    assert f"on {percent(share, 2)} of flights" in compared or "compare" not in asks
    assert f"paired {MINUS}" in compared or "compare" not in asks
    # The median of LQR is farther from that of TLC.
    assert re.search(r"speed error \([^;]*; LQR retuned ", compared)


def pair_of(a, b, winner):
    return SimpleNamespace(a=a, b=b, metrics={"m": SimpleNamespace(winner=winner)})


@pytest.mark.parametrize(
    ("winners", "winner", "not_beaten"),
    [
        (("a", "a", "b"), "a", ("a",)),
        (("a", None, "b"), None, ("a",)),  # a beats b and b beats c: a does not beat c
        (("a", None, None), None, ("a", "c")),
        (("a", "c", "b"), None, ()),  # a cycle
        ((None, None, None), None, ("a", "b", "c")),
    ],
)
def test_a_winner_beats_every_other_controller(winners, winner, not_beaten):
    pairs = [pair_of(*pair, who) for pair, who in zip(("ab", "ac", "bc"), winners, strict=True)]
    for names in ("abc", "cab"):
        standing = make_standings(pairs, list(names))["m"]
        assert (standing.winner, standing.not_beaten) == (winner, not_beaten)


@pytest.mark.parametrize(
    ("compare", "match"),
    [
        ("[tlc, lrq]", "'lrq'"),
        ("[tlc]", "at least 2"),
    ],
)
def test_a_question_about_other_controllers_is_rejected_with_its_place(tmp_path, compare, match):
    with pytest.raises(InputError, match=match):
        read_campaign(
            write_fake(
                tmp_path,
                controllers="{tlc: one.yaml, lqr: two.yaml}",
                asks=f"{{compare: {compare}}}",
            )
        )


TWO = "[{metric: altitude_error_max_m, below: 50, probability: 0.9973}, \
{metric: sideslip_max_deg, below: 1, probability: 0.99}]"


def plan(folder, **entries):
    return json_data(
        plan_campaign(
            read_campaign(write_fake(folder, **{"requirements": TWO, "runs": "1000", **entries}))
        )
    )


def test_flights_for_failures_and_chances(tmp_path):
    numbers = plan(tmp_path)
    first, second = numbers["requirements"]
    assert first["flights_for_failures"] == {"0": 981, "1": 2235, "2": 3086, "3": 3831}
    assert (first["most_failures_at_runs"], second["most_failures_at_runs"]) == (0, 2)
    at_limit, fifth = (numbers["rates_over_allowed"].index(rate) for rate in (1.0, 0.2))
    for entry in (first, second):
        assert [chance["runs"] for chance in entry["pass_chance"]] == [1000, 2000, 4000]
        for chance in entry["pass_chance"]:
            assert chance["at_some_flight"][0] == 1.0 and chance["at_some_flight"][at_limit] <= 0.1
            assert all(
                repeated >= once - 1e-12
                for repeated, once in zip(chance["at_some_flight"], chance["at_runs"], strict=True)
            )
    assert first["pass_chance"][0]["at_runs"][fifth] == pytest.approx(
        binom.cdf(0, 1000, 0.2 * 0.0027)
    )
    low, high = (numbers["together"][0]["at_runs"][end][10] for end in ("low", "high"))
    assert 0.0 <= low <= high <= first["pass_chance"][0]["at_runs"][10] + 1e-12


def test_a_family_needs_more_flights(tmp_path):
    numbers = plan(tmp_path, family="{risk: 0.1}")
    assert (
        numbers["requirements"][0]["flights_for_failures"]["0"] > 981
        and numbers["family_risk"] == 0.1
    )


def test_the_plan_counts_the_flights_of_the_search(tmp_path):
    """Of 2 unknowns, 2 controllers and 2 requirements, with 80 flights at each value."""
    unknowns = "{aero.lift: {low: 0.9, high: 1.1}, aero.drag: {low: 0.8, high: 1.15}}"
    density = "{atmosphere.density: {distribution: uniform, half_width: 10 %}}"
    numbers = plan(tmp_path, unknowns=unknowns, dispersions=density, runs="80")
    assert (numbers["runs"], numbers["most_points"]) == (80, 4 + 1 + 2 * 2 * 2)
    assert numbers["search_flights"] == 2 * 80 * (4 + 1 + 32 + 2 * 64)
