"""Tests of the explorer's server: access, re-run flights and a real browser."""

import csv
import http.client
import json
import threading
from pathlib import Path
from urllib.parse import quote, urlsplit

import pytest
from fake_flight import ENGINE, run, write_campaign
from programs import invoke
from report.browser import open_browser

from abhv_mc.analysis.replay import EQUAL_BITS
from abhv_mc_explore.counts import open_flights
from abhv_mc_explore.server import ExploreServer


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """100 flights of two controllers, served until the end."""
    folder = tmp_path_factory.mktemp("explore")
    run(write_campaign(folder / "f"), folder / "out", runs=100, workers=1)
    with (
        open_flights(folder / "out") as table,
        ExploreServer(folder / "out", table, ENGINE.fly) as served,
    ):
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        yield served
        served.shutdown()
        thread.join()


def ask(server, path, data=None, token=None, host=None):
    connection = http.client.HTTPConnection(*server.server_address)
    token = server.token if token is None else token
    body = None if data is None else json.dumps(data)
    headers = {} if host is None else {"Host": host}
    connection.request("GET" if data is None else "POST", f"{path}?token={token}", body, headers)
    reply = connection.getresponse()
    content = reply.read()
    connection.close()
    return reply.status, content


def asked(server):
    view = json.loads(ask(server, "/view")[1])
    order = {"fit": False, "sort": "rank", "down": False}
    return {
        "x": view["x"],
        "y": view["y"],
        "controllers": ["one", "two"],
        "outcome": "all",
        "brushes": {},
        **order,
    }


def test_only_this_machine_and_only_with_the_token_is_answered(server):
    assert server.server_address[0] == "127.0.0.1" and len(server.token) >= 32
    for path, data in (
        ("/", None),
        ("/view", None),
        ("/plotly.js", None),
        ("/counts", {}),
        ("/flight", {}),
    ):
        for wrong in ({"token": ""}, {"token": server.token[:-1]}, {"host": "example.org"}):
            assert ask(server, path, data, **wrong)[0] == 403
    assert ask(server, "/")[0] == 200 and server.token.encode() in ask(server, "/")[1]
    assert ask(server, "/../manifest.json")[0] == 404


def test_other_users_do_not_see_the_token_among_the_arguments_of_the_browser(server, monkeypatch):
    opened = []

    def read(address):
        opened.extend([address, Path(urlsplit(address).path).read_text()])

    monkeypatch.setattr("webbrowser.open", read)
    monkeypatch.setattr(ExploreServer, "serve_forever", lambda _: None)
    printed = invoke("explore", server.root)
    token = printed.stdout.strip().partition("token=")[2]
    assert token and token not in opened[0] and token in opened[1]


def test_flights_are_counted_and_the_nearest_is_flown_again(server):
    status, content = ask(server, "/counts", asked(server))
    answer = json.loads(content)
    assert status == 200 and answer["count"] == 200 == len(answer["points"])
    k, x, y, flight, _ = answer["points"][30]
    near = json.loads(ask(server, "/nearest", {**asked(server), "at": [x, y]})[1])
    assert near == [k, flight]
    flown = json.loads(
        ask(server, "/flight", {"controller": ("one", "two")[k], "flight": flight})[1]
    )
    history = flown["history"]
    assert "equal" in flown["note"] and len(history["time"]) == 21 == len(
        history["channels"]["altitude_m"]
    )


def test_what_stands_behind_a_flight_are_the_bands_of_its_controller(server):
    answer = json.loads(ask(server, "/behind", {"controller": "two", "channel": "altitude_m"})[1])
    envelope = server.table.results.envelopes["two", "altitude_m"]
    assert (
        answer["time"] == envelope.time.tolist() and answer["q5"] == envelope.bands["q5"].tolist()
    )
    assert len(answer["nominal"]) == len(answer["time"])


def test_the_chosen_flights_are_saved_as_csv(server):
    connection = http.client.HTTPConnection(*server.server_address)
    selection = {**asked(server), "controllers": ["two"], "sort": "flight", "down": True}
    connection.request("GET", f"/csv?token={server.token}&asked={quote(json.dumps(selection))}")
    reply = connection.getresponse()
    rows = list(csv.DictReader(reply.read().decode().splitlines()))
    connection.close()
    assert [row["flight"] for row in rows] == [str(k) for k in range(99, -1, -1)]
    values = server.table.results.flights["two"].metrics["altitude_error_max_m"]
    assert float(rows[0]["altitude_error_max_m [m]"]) == values[99]
    assert ask(server, "/csv")[0] == 400


DRAWN = "Number(document.body?.dataset.drawn ?? 0)"
COUNT = "document.getElementById('flight-count').textContent"
CHANGE = """((id, value) => { const box = document.getElementById(id); box.value = value;
  box.dispatchEvent(new Event("change")); })("flights-outcome", "%s")"""
FLOWN = """({ title: document.getElementById("flight-title").textContent,
  lines: document.querySelectorAll("#flight-history .scatterlayer .trace, #flight-track \
.scatterlayer .trace").length,
  same: document.getElementById("flight-note").textContent })"""
BOX = """(() => { const box = document.querySelector(%s).getBoundingClientRect();
  return [box.left, box.top, box.width, box.height]; })()"""


@pytest.fixture
def page(server, tmp_path):
    with open_browser(tmp_path / "profile") as page:
        page.call(
            "Emulation.setDeviceMetricsOverride",
            width=1400,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        page.call("Page.navigate", url=server.url)
        page.wait_for(f"{DRAWN} > 0")
        yield page


def shown(page, action):
    """Return the number of flights within all brushes after an action."""
    before = page.ask(DRAWN)
    action()
    page.wait_for(f"{DRAWN} > {before}")
    return int(page.ask(COUNT).split()[0])


def drag(page, selector, start, end):
    """Over a canvas, from and to shares of its size."""
    left, top, width, height = page.ask(BOX % json.dumps(selector))
    (x0, y0), (x1, y1) = ((left + width * x, top + height * y) for x, y in (start, end))
    page.drag(x0, y0, x1, y1)


@pytest.mark.thorough
def test_flights_are_brushed_filtered_and_chosen_again(page, server):
    assert page.ask(COUNT).startswith("200 of 200 flights")
    lost = (
        server.table.cursor()
        .execute("select count(*) from shown where outcome <> 'ok'")
        .fetchone()[0]
    )
    assert 0 < shown(page, lambda: page.ask(CHANGE % "failed")) == lost < 200
    assert shown(page, lambda: page.ask(CHANGE % "all")) == 200
    name = server.table.view["strips"][0]
    low, high = server.table.ranges[name]
    values = (
        server.table.cursor()
        .execute("select * exclude (controller, outcome) from shown")
        .fetchnumpy()[name]
    )
    half = int((values < (low + high) / 2).sum())
    brushed = shown(page, lambda: drag(page, "#flights-strips canvas", (0.001, 0.5), (0.5, 0.5)))
    assert abs(brushed - half) <= 4 and 0 < brushed < 200
    upper = shown(page, lambda: drag(page, "#scatter", (0.1, 0.05), (0.9, 0.4)))
    assert upper < brushed
    assert shown(page, lambda: page.ask("document.getElementById('flights-clear').click()")) == 200
    assert (
        shown(
            page, lambda: page.ask("document.querySelector('#flights-controllers input').click()")
        )
        == 100
    )


def find_flights(page, across=40, up=20):
    """Places in the scatter at which it names a flight below the mouse, with what it says."""
    for k in range(across * up):
        left, top, width, height = page.ask(BOX % json.dumps("#scatter"))
        x, y = left + width * (k % across + 0.5) / across, top + height * (k // across + 0.5) / up
        page.move(x, y)
        named = page.ask("document.getElementById('scatter-at').textContent").strip()
        if named:
            yield x, y, named.rpartition(":")[0]


@pytest.mark.thorough
@pytest.mark.parametrize("way", ["point", "table"])
def test_a_click_flies_the_flight_again_and_draws_it(page, server, way):
    if way == "table":
        page.ask("document.querySelector('#flight-rows button').click()")
    else:
        x, y, named = next(find_flights(page))
        page.click(x, y)
    page.wait_for("document.body.dataset.opened !== undefined")
    answer = page.ask(FLOWN)
    number = page.ask("document.body.dataset.opened")
    assert f", flight {number}: " in answer["title"] and answer["lines"] >= 2
    assert way == "table" or answer["title"].startswith(f"{named}: ")
    assert EQUAL_BITS in answer["same"]
    if way == "table":
        assert number == page.ask("document.querySelector('#flight-rows button').textContent")
