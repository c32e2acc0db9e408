"""Interactive view of flights in a browser: order, filters, overlay, link, CSV, single flight."""

import csv
import io
import json
from urllib.parse import parse_qs

import numpy as np
import pytest
from own_simulators import dive_campaign
from scipy.spatial.transform import Rotation

from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.pages.build import build_report
from abhv_mc.requests import Request
from abhv_mc.topics.formatting import shown_value, spoken_name
from abhv_mc.topics.missed_requirements import requirement_failures

LABELS = {"tlc": "TLC", "lqr": "LQR", "lqr_retuned": "LQR retuned"}
ROWS = """[...document.querySelectorAll("#flight-rows tr")]
  .map((row) => [row.cells[1].textContent, row.cells[0].textContent])"""
HISTORY = """document.getElementById("flight-history").data
  .map((trace) => ({ name: trace.name, x: [...trace.x], y: [...trace.y] }))"""
SAVED = """(async () => {
  const made = URL.createObjectURL;
  let blob;
  URL.createObjectURL = (given) => { blob = given; return "#flights"; };
  document.getElementById("flights-csv").click();
  await new Promise((done) => setTimeout(done));
  URL.createObjectURL = made;
  return blob.text();
})()"""
SORT = """[...document.querySelectorAll("#flight-heads button")].find((button) => \
button.textContent === %s).click()"""
FROM_ONE = """(() => {
  document.getElementById("flights-low").value = 1;
  document.getElementById("flights-between").click();
})()"""


@pytest.fixture
def view(page, report_folder):
    page.call("Page.navigate", url="about:blank")  # a fragment alone loads nothing
    page.show(report_folder / "report.html")
    return page


def choose(page, name, value):
    page.ask(f"""(() => {{ const box = document.getElementById("{name}"); box.value = \
{json.dumps(value)};
      box.dispatchEvent(new Event("change")); }})()""")


def sort_by(page, head):
    page.ask(SORT % json.dumps(head))


def ranked(results):
    """Return all flights, the worst first: label, number, controller, row."""
    pairs = zip(results.ranking.controller, results.ranking.row, strict=True)
    named = [(results.ranking.controllers[k], row) for k, row in pairs]
    return [
        (LABELS[name], str(results.flights[name].flight[row]), name, row) for name, row in named
    ]


def test_a_click_on_a_head_sorts_and_the_third_restores_the_worst_first(view, models):
    results, metric = models.results, "speed_error_max_mps"
    flights = ranked(results)
    values = np.array([results.flights[name].metrics[metric][row] for *_, name, row in flights])
    orders = [
        np.argsort(-values, kind="stable"),
        np.argsort(values, kind="stable"),
        range(len(flights)),
    ]
    for order in orders:
        sort_by(view, "Speed error, max (m/s)")
        assert [tuple(row) for row in view.ask(ROWS)] == [flights[k][:2] for k in order][:100]
    assert view.ask("document.querySelector('#flight-heads [aria-sort]')") is None


def test_the_filter_and_a_choice_leave_their_flights_in_list_count_and_csv(view, models):
    results = models.results
    item = results.campaign.requirements[1]
    missed = {
        name: requirement_failures(results.flights[name], item) for name in results.controllers
    }
    choose(view, "flights-outcome", "missed 1")
    choose(view, "scatter-x", "aero.drag")
    view.ask(FROM_ONE)
    drag = results.samples["aero.drag"]
    selected = [
        row for row in ranked(results) if missed[row[2]][row[3]] and drag[int(row[1])] >= 1.0
    ]
    assert [tuple(row) for row in view.ask(ROWS)] == [row[:2] for row in selected][:100] != []
    total = sum(results.flights[name].flight.size for name in results.controllers)
    assert view.ask("document.getElementById('flight-count').textContent").startswith(
        f"{len(selected)} of {total} flights"
    )
    saved = list(csv.DictReader(io.StringIO(view.ask(SAVED, wait=True))))
    assert [(row["controller"], row["flight"]) for row in saved] == [
        (name, flight) for _, flight, name, _ in selected
    ]
    for row, (_, flight, name, k) in zip(saved, selected, strict=True):
        assert float(row["aero.drag [factor]"]) == pytest.approx(drag[int(flight)], abs=1e-5)
        speed = results.flights[name].metrics["speed_error_max_mps"][k]
        assert float(row["speed_error_max_mps [m/s]"]) == pytest.approx(speed, rel=1e-3)


def test_a_clicked_flight_opens_at_the_channel_of_its_worst_metric(view, models):
    results = models.results
    label, number, name, row = ranked(results)[0]
    view.ask("document.querySelector('#flight-rows button').click()")
    criterion = results.campaign.criteria[results.ranking.criterion_index[name][row]]
    record = results.campaign.metrics[criterion.metric]
    assert view.ask("document.getElementById('flight-channel').value") == record.of
    traces = {trace["name"]: trace for trace in view.ask(HISTORY)}
    limit = criterion.limits.high
    assert {
        y for trace in view.ask(HISTORY) if trace["name"].startswith("limit") for y in trace["y"]
    } == {
        limit,
        -limit,
    }
    assert {f"{label}, nominal", f"{label}, 5\N{EN DASH}95 %", f"{label} {number}"} <= set(traces)
    dispersions = (
        view.ask("document.getElementById('flight-words').textContent")
        .replace("\N{MINUS SIGN}", "-")
        .split(", ")
    )
    drawn = {key: results.samples[key][int(number)] for key in results.dispersed}
    assert set(dispersions) == {
        f"{spoken_name(key)} {shown_value(key, value, results.campaign.parameters)}".replace(
            "\N{MINUS SIGN}", "-"
        )
        for key, value in drawn.items()
    }
    cells = view.ask(
        "[...document.querySelectorAll('#flight-required tbody td')].map((cell) => "
        "cell.textContent)"
    )
    assert len(cells) == len(results.campaign.requirements)
    for cell, item in zip(cells, results.campaign.requirements, strict=True):
        value = results.flights[name].metrics[item.metric][row]
        assert float(cell.split("\N{NO-BREAK SPACE}")[0]) == pytest.approx(value, rel=2e-3)
        assert ("missed" in cell) == bool(requirement_failures(results.flights[name], item)[row])


def test_the_band_behind_an_error_holds_the_flight(view):
    """The band of the speed error follows from that of the speed; the folder does not store it."""
    view.ask("document.querySelector('#flight-rows button').click()")
    choose(view, "flight-channel", "speed_error_mps")
    traces = view.ask(HISTORY)
    band = [trace for trace in traces if trace["name"].endswith(", all flights")]
    (flown,) = [
        trace
        for trace in traces
        if "," not in trace["name"] and not trace["name"].startswith("limit")
    ]
    low, high = (np.interp(flown["x"], trace["x"], trace["y"]) for trace in band)
    assert np.all(np.array(flown["y"]) >= low - 0.05) and np.all(
        np.array(flown["y"]) <= high + 0.05
    )


def test_two_flights_lie_over_one_another_and_a_link_restores_all_of_it(
    view, report_folder, models
):
    number = ranked(models.results)[0][1]
    sort_by(view, "Flight")
    choose(view, "flights-outcome", "missed 1")
    view.ask("document.querySelectorAll('#flight-rows button')[0].click()")
    first = view.ask("document.getElementById('flight-title').textContent")
    choose(view, "over-controller", "lqr_retuned")
    view.ask(f"document.getElementById('over-flight').value = {number}")
    view.ask("document.querySelector('#flight-over button').click()")
    choose(view, "flight-channel", "bank_deg")
    title = view.ask("document.getElementById('flight-title').textContent")
    flights, _, ended = title.rpartition(": ")
    assert flights.startswith(f"{first}, ")
    assert flights.endswith(f" LQR retuned, flight {number}")
    assert ended.startswith("completed")
    flown = [trace["name"] for trace in view.ask(HISTORY) if trace["name"].split()[-1].isdecimal()]
    assert len(flown) == 2
    assert view.ask("document.querySelectorAll('#flight-required thead th').length") == 3
    address = view.ask("document.getElementById('flights-link').href")
    assert parse_qs(address.partition("#flights?")[2])["show"] == ["missed 1"]
    rows = view.ask(ROWS)
    view.call("Page.navigate", url="about:blank")
    view.call("Page.navigate", url=address)
    view.wait_for("document.body?.dataset.opened && document.getElementById('flight-history').data")
    assert view.ask("document.getElementById('flight-title').textContent") == title
    assert view.ask("document.getElementById('flight-channel').value") == "bank_deg"
    assert (
        view.ask("document.getElementById('flights-outcome').value") == "missed 1"
        and view.ask(ROWS) == rows
    )


PLACE = 'flightPath(document.createElement("div"), {}).attitude(%s)'


@pytest.mark.parametrize("angles", [(90, 0, 0, 0, 0), (100, 5, -50, 3, 0), (-170, -20, 65, 12, -4)])
def test_body_axes_are_those_of_the_angles(view, angles):
    """Heading, path angle and bank give wind axes; sideslip and angle of attack give body axes."""
    names = (
        "heading_deg",
        "flight_path_angle_deg",
        "bank_deg",
        "angle_of_attack_deg",
        "sideslip_deg",
    )
    heading, climb, bank, attack, slip = angles
    wind = Rotation.from_euler("ZYX", [heading, climb, bank], degrees=True)
    body = wind * Rotation.from_euler("ZY", [-slip, attack], degrees=True)
    axes = view.ask(PLACE % json.dumps(dict(zip(names, angles, strict=True))))
    np.testing.assert_allclose(axes, body.as_matrix().T, atol=1e-12)


def test_flights_of_a_users_simulator_are_shown_in_its_words(page, tmp_path, own_list):
    """Regression: without histories and bands, nothing of the page was drawn."""
    run_campaign(Request(dive_campaign(tmp_path / "own"), tmp_path / "out", workers=1))
    results = read_flown(tmp_path / "out")
    page.call("Page.navigate", url=build_report(tmp_path / "out").as_uri())
    page.wait_for("Boolean(document.querySelector('#flight-rows button'))")
    page.ask("document.querySelector('#flight-rows button').click()")
    name = results.controllers[results.ranking.controller[0]]
    row = results.ranking.row[0]
    number = results.flights[name].flight[row]
    assert (
        page.ask("document.getElementById('flight-title').textContent")
        == f"{name}, flight {number}: ground"
    )
    dispersions = page.ask("document.getElementById('flight-words').textContent")
    assert f"speed {results.samples['speed'][number]:.3g}\N{NO-BREAK SPACE}ft/s" in dispersions
    assert page.ask("document.getElementById('flight-plots').hidden")
    cell = page.ask("document.querySelector('#flight-required tbody td').textContent").replace(
        "\N{MINUS SIGN}", "-"
    )
    low = results.flights[name].metrics["altitude_min"][row]
    assert (
        float(cell.split("\N{NO-BREAK SPACE}")[0]) == pytest.approx(low, rel=1e-3)
        and "missed" in cell
    )
