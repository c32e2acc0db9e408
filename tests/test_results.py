"""Python interface: campaigns, results as pandas tables, searches, tuning and comparison."""

import pydoc
import re
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fake_flight import ENGINE, write_campaign
from report.synthetic import write_campaign as write_flown
from search.known_flights import METRIC

import abhv_mc
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.compare import compare_results, pair_campaigns
from abhv_mc.topics.formatting import json_data
from abhv_mc_vehicle.vehicle_simulator.keep_out import Zone


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("notebook")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: ENGINE)
        campaign = abhv_mc.Campaign.read(write_campaign(folder / "f"))
        return campaign, campaign.run(output=folder / "out", runs=200, workers=2)


@pytest.fixture
def fake(monkeypatch):
    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: ENGINE)


def test_help_lists_what_is_public_and_no_more(repository):
    """Each name is there, has words, and stands on the page of the reference; an old one warns."""
    public = set(abhv_mc.__all__) - {"__version__"}
    assert set(dir(abhv_mc)) == set(abhv_mc.__all__)
    with pytest.raises(AttributeError, match="'Campaigns'"):
        _ = abhv_mc.Campaigns
    assert all(pydoc.getdoc(getattr(abhv_mc, name)) for name in public)
    listed = {
        name
        for line in pydoc.plaintext.document(abhv_mc).split("PACKAGE CONTENTS")[-1].splitlines()
        for name in re.findall(r"^    (?:class )?(\w+)\(", line)
    }
    assert listed - {"Exception", "ValueError"} == {
        name for name in public if callable(getattr(abhv_mc, name))
    }
    page = (repository / "docs/reference/python.md").read_text("utf-8")
    assert {name for name in public if f"abhv_mc.{name}" not in page} == set()


def test_a_campaign_says_what_it_will_fly(flown):
    campaign, results = flown
    assert (campaign.name, campaign.runs, campaign.controllers) == ("fake", 300, ("one", "two"))
    assert re.fullmatch(r"<Campaign fake: 300 \D* 'one' and 'two', \D* 2>", repr(campaign))
    pd.testing.assert_frame_equal(campaign.draw_samples(200), results.samples)
    with pytest.raises(InputError, match=r"^flights: found -1; "):
        campaign.draw_samples(-1)


def test_tables(flown):
    _, results = flown
    assert results.complete and re.match(r"<Results fake: 200 of 200 \w+, \w+>$", repr(results))
    table = results.flights
    assert list(table.controller) == ["one"] * 200 + ["two"] * 200 and list(
        table.flight[:200]
    ) == list(range(200))
    assert table.attrs["units"]["fuel_used_kg"] == "kg" and table.attrs["units"]["aero.lift"] == "-"
    assert results.samples.attrs["units"]["aero.lift"] == "-"
    np.testing.assert_array_equal(table["aero.lift"][:200], results.samples["aero.lift"])
    assert {"controller", "channel", "time", "q50"} <= set(results.envelopes)
    assert set(results.histories.controller) == {"one", "two"} and len(results.reference) == 21
    assert set(results.nominal.controller) == {"one", "two"}
    assert results.nominal.time.tolist() == 2 * results.reference.time.tolist()
    count = results.query(
        "select controller, count(*) n from flights where outcome <> 'ok' group by 1 order by 1"
    )
    assert list(count.n) == [
        int((group.outcome != "ok").sum()) for _, group in table.groupby("controller")
    ]


def test_numbers(flown):
    _, results = flown
    median = results.quantiles.loc[("fuel_used_kg", "two", "q50")]
    flights = results.flights.query("controller == 'two'")
    values = np.where(flights.outcome == "ok", flights.fuel_used_kg, np.inf)
    assert median.value == pytest.approx(np.quantile(values, 0.5, method="linear"))
    assert median.low < median.value < median.high
    assert results.verdicts.status["altitude_error_max_m", "two"] in ("PASS", "FAIL", "NOT SHOWN")
    labels = [record["label"] for record in results.numbers["summary"]["records"]]
    assert [record.label for record in results.summary.records] == labels and labels[-1] == "Next"


def test_tables_over_time_have_named_axes(flown):
    _, results = flown
    histories = results.to_xarray()
    row = results.histories.iloc[25]
    cell = histories.altitude_m.sel(controller=row.controller, flight=row.flight, time=row.time)
    assert float(cell) == row.altitude_m and histories.altitude_m.attrs["units"] == "m"
    assert int(histories.altitude_m.count()) == int(results.histories.altitude_m.count())
    bands = results.to_xarray("envelopes")
    row = results.envelopes.iloc[40]
    assert (
        float(bands.q50.sel(controller=row.controller, channel=row.channel, time=row.time))
        == row.q50
    )
    with pytest.raises(InputError, match="table: found 'flights'"):
        results.to_xarray("flights")


def test_a_notebook_shows_tables_with_names_escaped(flown):
    campaign, results = flown
    html = results._repr_html_()
    assert "200 of 200 " in html and html.count("<tr>") >= 2
    renamed = abhv_mc.Campaign(campaign.path, campaign._checked)
    renamed.question = "<script>"
    assert (
        "&lt;script&gt;" in renamed._repr_html_() and "atmosphere.density" in renamed._repr_html_()
    )


def test_a_figure_of_the_report(flown):
    _, results = flown
    assert "distribution_asked" in results.figure_names
    assert results.figure("distribution_asked", dpi=72).get_dpi() == 72


def test_flights_again(flown, fake):
    _, results = flown
    history = results.replay(17, "two")
    assert list(history.columns[:2]) == ["time", "altitude_m"] and len(history) == 21
    lost = int(results.flights.query("outcome != 'ok'").flight.iloc[0])
    explanation = results.explain(lost)
    assert explanation.causes == ("atmosphere.density",)
    assert results.explained_figure(explanation, dpi=50).get_dpi() == 50


def test_other_dispersions(flown):
    _, results = flown
    table = results.whatif({"aero.lift.sigma": "4 %"})
    assert {"before", "after_low"} <= set(table) and table.attrs["effective_flights"]["one"] > 100

    for wrong in ("x", 5, [("aero.lift.sigma", "4 %")]):
        with pytest.raises(InputError, match=r"settings: .*; expected a mapping"):
            results.whatif(wrong)


def test_another_working_folder_changes_no_meaning_of_a_path(tmp_path, monkeypatch, flown):
    """Regression: a run was reported as a change of the tables, and ran a file of the same name."""
    (tmp_path / "there").mkdir()
    monkeypatch.chdir(tmp_path)
    shutil.copytree(flown[1].folder, "out")
    write_campaign(tmp_path / "f")
    campaign, results = abhv_mc.Campaign.read("f/campaign.yaml"), abhv_mc.open_results("out")
    monkeypatch.chdir(tmp_path / "there")
    assert len(results.flights) == 400
    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: ENGINE)
    assert campaign.run("again", runs=20).folder == tmp_path / "there" / "again"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda file, out: abhv_mc.worst(file, out, METRIC, bad="big"),
            "bad: found 'big'; expected 'high', 'low'",
        ),
        (
            lambda file, out: abhv_mc.worst(file, out, METRIC, box=9),
            "box: 9 ",
        ),
        (
            lambda file, out: abhv_mc.worst(file, out, METRIC, flights=0),
            "flights: found 0",
        ),
        (lambda file, out: abhv_mc.worst(file, out, "speed"), "unknown metric 'speed'"),
        (
            lambda file, out: abhv_mc.rare(file, out, METRIC, target_cov="300 %"),
            "target_cov: 3 ",
        ),
        (
            lambda file, out: abhv_mc.rare(file, out, METRIC, flights=1.5),
            "flights: found 1.5",
        ),
        (lambda file, out: abhv_mc.tune(file, out / "new.yaml"), "tune"),
        (lambda file, out: abhv_mc.worst("no_such", out, METRIC), "no_such"),
    ],
)
def test_what_is_wrong_is_refused_and_nothing_written(tmp_path, call, message):
    file = write_campaign(tmp_path / "files")
    with pytest.raises(InputError) as refused:
        call(file, tmp_path / "out")
    assert message in str(refused.value) and not (tmp_path / "out").exists()


def test_a_comparison_has_the_numbers_and_the_page_of_the_command(tmp_path):
    a, b = (
        write_flown(tmp_path / name, runs=20, failing=lost) for name, lost in (("a", 1), ("b", 3))
    )
    gates = {"altitude_error_max_m": "5 %"}
    comparison = abhv_mc.compare(
        abhv_mc.open_results(a), b, ("lqr", "lqr"), gates, tmp_path / "page"
    )
    numbers = comparison.numbers()
    both = pair_campaigns(read_flown(a), read_flown(b))
    assert numbers == json_data(
        compare_results(*both, ("lqr", "lqr"), {"altitude_error_max_m": 0.05})
    )
    assert (
        numbers["paired"][0]["ended_early"]["only_b"] == 2
        and (tmp_path / "page/report.html").is_file()
    )
    entry = numbers["paired"][0]["metrics"]["altitude_error_max_m"]["median_difference"]
    rows = comparison.table.set_index(["metric", "quantity"])
    row = rows.loc[("altitude_error_max_m", "median over flights")]
    assert [row["difference"], row["low"], row["high"]] == [*entry.values()]
    assert comparison.figure().axes and comparison.page == tmp_path / "page/report.html"
    with pytest.raises(InputError, match="fail_if_worse"):
        abhv_mc.compare(a, b, fail_if_worse="altitude_error_max_m=5%")


def test_zones_and_ground_tracks_are_exported_and_drawn(tmp_path):
    results = abhv_mc.open_results(write_flown(tmp_path / "c", runs=20))
    zone = Zone.model_construct(center=(0.5114, -1.3474), radius=4e3)
    campaign = results._results.campaign
    contents = replace(campaign.contents, zones={"island": zone.outline()})
    object.__setattr__(campaign, "contents", contents)
    features = results.to_geojson()["features"]
    assert features[0]["properties"] == {"zone": "island"}
    longitude, latitude = np.array(features[0]["geometry"]["coordinates"][0]).T
    assert np.mean(latitude) == pytest.approx(29.3, abs=2e-3) and max(longitude) < -77.1
    stored = results.histories.groupby(["controller", "flight"], observed=True).ngroups
    assert len(features) == 1 + stored
    assert {feature["geometry"]["type"] for feature in features[1:]} == {"LineString"}
    assert features[1]["properties"].keys() == {"controller", "flight", "outcome"}
    assert "ground_tracks" in results.figure_names
