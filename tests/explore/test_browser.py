"""The explorer in a real browser: flights brushed, filtered and clicked, and none of it without the token."""

import json

import pytest
from report.browser import open_browser

pytestmark = pytest.mark.thorough

DRAWN = "Number(document.body?.dataset.drawn ?? 0)"
COUNT = "document.getElementById('flight-count').textContent"
CHANGE = """((id, value) => { const box = document.getElementById(id); box.value = value;
  box.dispatchEvent(new Event("change")); })("flights-outcome", "%s")"""
FLOWN = """({ title: document.getElementById("flight-title").textContent,
  lines: document.querySelectorAll("#flight-history .scatterlayer .trace, #flight-track .scatterlayer .trace").length,
  same: document.getElementById("flight-note").textContent })"""
BOX = """(() => { const box = document.querySelector(%s).getBoundingClientRect();
  return [box.left, box.top, box.width, box.height]; })()"""


@pytest.fixture
def page(server, tmp_path):
    with open_browser(tmp_path / "profile") as page:
        page.call("Emulation.setDeviceMetricsOverride", width=1400, height=900, deviceScaleFactor=1, mobile=False)
        page.call("Page.navigate", url=server.url)
        page.wait_for(f"{DRAWN} > 0")
        yield page


def shown(page, action):
    """How many flights are within all brushes after an action that counts them anew."""
    before = page.ask(DRAWN)
    action()
    page.wait_for(f"{DRAWN} > {before}")
    return int(page.ask(COUNT).split()[0])


def drag(page, selector, start, end):
    """Over a canvas, from and to shares of its size."""
    left, top, width, height = page.ask(BOX % json.dumps(selector))
    (x0, y0), (x1, y1) = ((left + width * x, top + height * y) for x, y in (start, end))
    page.drag(x0, y0, x1, y1)


def test_flights_are_brushed_filtered_and_chosen_again(page, server):
    assert page.ask(COUNT).startswith("200 of 200 flights")
    lost = server.table.cursor().execute("select count(*) from shown where outcome <> 'ok'").fetchone()[0]
    assert 0 < shown(page, lambda: page.ask(CHANGE % "failed")) == lost < 200
    assert shown(page, lambda: page.ask(CHANGE % "all")) == 200
    name = server.table.view["strips"][0]
    low, high = server.table.ranges[name]
    values = server.table.cursor().execute("select * exclude (controller, outcome) from shown").fetchnumpy()[name]
    half = int((values < (low + high) / 2).sum())
    brushed = shown(page, lambda: drag(page, "#flights-strips canvas", (0.001, 0.5), (0.5, 0.5)))
    assert abs(brushed - half) <= 4 and 0 < brushed < 200
    upper = shown(page, lambda: drag(page, "#scatter", (0.1, 0.05), (0.9, 0.4)))
    assert upper < brushed
    assert shown(page, lambda: page.ask("document.getElementById('flights-clear').click()")) == 200
    assert shown(page, lambda: page.ask("document.querySelector('#flights-controllers input').click()")) == 100


@pytest.mark.parametrize("way", ["point", "table"])
def test_a_click_flies_the_flight_again_and_draws_it(page, server, way):
    if way == "table":
        page.ask("document.querySelector('#flight-rows button').click()")
    else:
        x, y, named = next(page.find_flights())
        page.click(x, y)
    page.wait_for("document.body.dataset.opened !== undefined")
    found = page.ask(FLOWN)
    number = page.ask("document.body.dataset.opened")
    assert f", flight {number}: " in found["title"] and found["lines"] >= 2
    assert way == "table" or found["title"].startswith(f"{named}: ")
    assert found["same"].endswith("Its metrics equal the stored ones bit for bit.")
    if way == "table":
        assert number == page.ask("document.querySelector('#flight-rows button').textContent")
