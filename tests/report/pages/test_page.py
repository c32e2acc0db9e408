"""Data, escaping and security policy of the page; test_browser tests it in a browser."""

import base64
import dataclasses
import gzip
import hashlib
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from report.synthetic import write_campaign

from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.report.pages import page as pages
from abhv_mc.report.pages.flights_view import (
    _dispersion,
    _metric,
    _select_rows,
    find_range,
    make_flights_view,
)
from abhv_mc.report.pages.page import (
    LIMIT_POSITION,
    baseline_record,
    chart_position,
    chart_rows,
    make_environment,
    make_page,
    pack_arrays,
)
from abhv_mc.topics.flights.model import listed_worst, worst_flights
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import GlanceCell, GlanceRow
from abhv_mc_vehicle.plant.parameters import OURS


def unpack(layout, text, name):
    steps = (
        np.frombuffer(gzip.decompress(base64.b64decode(text)), np.uint8).astype(int).reshape(2, -1)
    )
    entry = layout[name]
    size = int(np.prod(entry["shape"]))
    table = (steps[0] + 256 * steps[1])[entry["start"] : entry["start"] + size].reshape(
        entry["shape"]
    )
    codes = np.cumsum(table, axis=-1) % 65536
    values = entry["low"] + (entry["high"] - entry["low"]) * codes / 65534
    return np.where(codes == 65535, np.nan, values)


def test_values_come_back_within_half_a_step_and_what_is_missing_is_missing():
    rng = np.random.default_rng(1)
    wave = np.sin(np.linspace(0.0, 20.0, 301)) * rng.uniform(0.1, 5.0, (7, 1))
    wave[3, 200:] = np.nan
    arrays = {
        "a": rng.normal(1e5, 3.0, 50),
        "wave": wave,
        "flat": np.full(4, 2.5),
        "late": np.array([np.inf, 1.0, 3.0]),
    }
    layout, text = pack_arrays(arrays)
    for name, values in arrays.items():
        finite = np.where(np.isfinite(values), values, np.nan)
        step = (np.nanmax(finite) - np.nanmin(finite)) / 65534
        np.testing.assert_allclose(
            unpack(layout, text, name), finite, rtol=1e-12, atol=0.5001 * step
        )
    assert pack_arrays(arrays)[1] == text
    assert len(pack_arrays({"wave": wave})[1]) < 0.6 * len(
        base64.b64encode(gzip.compress(wave.astype("f4").tobytes()))
    )


def test_what_a_campaign_says_is_text_only(tmp_path):
    evil = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"
    results = read_flown(write_campaign(tmp_path / "c", runs=12))
    model = results.campaign.model.model_copy(update={"question": f"{evil} Does it?"})
    results = dataclasses.replace(
        results, campaign=dataclasses.replace(results.campaign, model=model)
    )
    page = make_page(Models(results), [])
    assert evil not in page
    assert "&lt;img src=x onerror=alert(1)&gt;" in page


@pytest.fixture(scope="module")
def packed(report_page):
    """Return the page's data and its arrays as its script reads them."""
    data = json.loads(
        re.search(
            r'<script type="application/json" id="page-data">(.*?)</script>', report_page
        ).group(1)
    )
    packed = re.search(r'id="arrays-packed">([A-Za-z0-9+/=]+)</script>', report_page).group(1)
    return data, {name: unpack(data["places"], packed, name) for name in data["places"]}


def test_the_embedded_data_are_the_envelopes(packed, report_folder):
    data, arrays = packed
    bank = next(c for c in data["envelopes"]["channels"] if c["name"] == "bank_deg")
    assert bank["command"] == "bank_command_deg"
    assert bank["reference"] == "bank_reference_deg"
    envelope = read_flown(report_folder).envelopes["lqr", "bank_deg"]
    drawn = arrays["bank_deg:lqr"][data["envelopes"]["bands"].index("q5")]
    assert len(arrays["time:lqr"]) == len(drawn) == 301
    assert drawn == pytest.approx(envelope.bands["q5"][::2], abs=2e-3)


def test_the_interactive_band_of_all_flights_holds_the_samples_that_it_leaves_out(
    packed, report_folder
):
    """Regression: the band used every other sample, and flights left it in between."""
    data, arrays = packed
    for controller in data["envelopes"]["controllers"]:
        for channel in ("bank_deg", "aileron_deg", "sideslip_deg"):
            envelope = read_flown(report_folder).envelopes[controller["name"], channel]
            curves = arrays[f"{channel}:{controller['name']}"]
            step = np.nanmax(curves) - np.nanmin(curves)
            time, bands = arrays[f"time:{controller['name']}"], data["envelopes"]["bands"]
            drawn = {
                end: np.interp(envelope.time, time, curves[bands.index(end)])
                for end in ("min", "max")
            }
            assert np.all(drawn["min"] <= envelope.bands["min"] + 1e-3 * step)
            assert np.all(drawn["max"] >= envelope.bands["max"] - 1e-3 * step)


def test_every_flight_is_a_point_and_the_worst_that_are_listed_have_their_histories(
    packed, report_folder
):
    data, arrays = packed
    results = read_flown(report_folder)
    rows = data["flights"]["rows"]
    assert len(rows["flight"]) == sum(
        results.flights[name].flight.size for name in results.controllers
    )
    flights = results.flights["lqr"]
    lqr = [
        i
        for i, k in enumerate(rows["controller"])
        if data["flights"]["controllers"][k]["name"] == "lqr"
    ]
    metric = results.asked[0]
    drawn = arrays[f"column:{metric}"][lqr]
    np.testing.assert_allclose(
        drawn, flights.metrics[metric], atol=1e-4 * np.ptp(arrays[f"column:{metric}"])
    )
    with_history = {rows["flight"][i] for i in lqr if rows["history"][i] >= 0}
    assert with_history and with_history <= {
        flight.flight for flight in worst_flights(results)["lqr"]
    }


def test_only_the_pages_own_scripts_may_run(report_page):
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', report_page)[1]
    scripts = re.search(r"script-src ([^;]*);", policy)[1]
    assert (
        "unsafe" not in scripts
        and "default-src 'none'" in policy
        and len(report_page.encode()) < 4_000_000
    )
    digest = base64.b64encode(
        hashlib.sha256(re.search(r"<script>(.*?)</script>", report_page, re.S)[1].encode()).digest()
    )
    assert f"'sha256-{digest.decode()}'" in scripts and scripts.count("sha256-") == 2


@pytest.mark.parametrize(("limit", "is_beyond"), [(1e-9, True), (1e6, False)])
def test_the_arrow_of_values_beyond_the_chart_is_explained(tmp_path, limit, is_beyond):
    requirement = f"{{metric: speed_error_max_mps, below: {limit}, probability: 0.9}}"
    folder = write_campaign(
        tmp_path / "c", runs=12, controllers=["tlc"], requirements=[requirement]
    )
    chart, _, after = make_page(Models(read_flown(folder)), ()).partition('<td class="axis')
    legend = after.partition("</td>")[0]
    assert ("&#9654;" in chart) == is_beyond == ("&#9654;" in legend)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_chart_prints_the_tolerance_limit_and_its_room(failing, sign):
    """Regression: the figure printed the median without a label at its right edge."""
    lost = float("inf")
    values = {
        "tlc": (0.2, 0.4, 0.6, 0.62, 0.65),
        "lqr": (0.5, 0.98, 1.4, 1.5, 1.57),
        "lqr_retuned": (0.5, lost, lost, None),
    }
    cells = {name: GlanceCell(*(v and sign * v for v in row)) for name, row in values.items()}
    names = dict.fromkeys(cells, "")
    row = replace(Models(failing)[VERDICTS].glance[2], below=sign > 0.0, limit=0.7 * sign, size=0.7)
    ((_, bars),) = chart_rows([replace(row, cells=cells)], names, names)
    ends = ["0.650 deg, 7.1\u202f% margin", "1.57 deg, 124\u202f% over", "lost"]
    assert all(bar.edge.endswith(end) for bar, end in zip(bars, ends, strict=True))
    assert bars[0].low == pytest.approx(100.0 * 0.2 / 0.7 / 1.35)  # the limit is at 100 / 1.35
    assert [(bar.median is None, bar.tolerance is None, bar.beyond) for bar in bars] == [
        (False, False, False), (True, True, True), (True, True, True)]  # fmt: skip


def test_a_chart_without_requirements_has_values_and_a_scale(tmp_path):
    """Regression: bars beside the first median were mostly off the axes."""
    models = Models(read_flown(write_campaign(tmp_path / "c", runs=40, requirements=())))
    names = models.names.controllers
    for _, bars in chart_rows(models[VERDICTS].glance, names, names):
        assert max(bar.high for bar in bars) == pytest.approx(LIMIT_POSITION)
        assert all(bar.low >= 0.0 and not bar.beyond for bar in bars)
        assert all(bar.edge.startswith("median ") for bar in bars)
    for low, size in ((0.4, 1.0), (0.6, 0.4)):  # The scale begins at zero if that is near.
        cells = {"tlc": GlanceCell(low, 0.8, 1.0, 1.0)}
        row = replace(models[VERDICTS].glance[0], below=True, cells=cells)
        ((entry, _),) = chart_rows([row], names, names)
        assert entry.size == pytest.approx(size)
    cells = ({"tlc": GlanceCell(k, k, k, k, status="PASS")} for k in range(10))
    rows = [replace(row, limit=9.0, size=9.0, metric=k, cells=cell) for k, cell in enumerate(cells)]
    assert [entry.metric for entry, _ in chart_rows(rows, names, names)] == [*range(9, 1, -1)]


INF = float("inf")


def glance(cells, **entries):
    """Return a row whose limit is 2 m; the chart ends 0.35 of the size of 4 m beyond it."""
    given = {"metric": "m", "label": "M", "unit": "m", "text": "", "limit": 2.0, "below": True}
    return GlanceRow(**{**given, "size": 4.0, "cells": cells, **entries})


@pytest.mark.parametrize("below", [True, False])
def test_positions_are_distances_from_the_limit_in_units_of_its_size(below):
    row, sense = glance({}, below=below), 1.0 if below else -1.0
    for beyond, position in ((0.0, 1.0), (-2.0, 0.5), (1.0, 1.25), (-9.0, 0.0), (3.0, 1.35)):
        value = 2.0 + sense * beyond
        assert chart_position(value, row) == pytest.approx(100.0 * position / 1.35)
    assert chart_position(None, row) is chart_position(-sense * INF, row) is None
    assert chart_position(2.0, row) == LIMIT_POSITION


@pytest.mark.parametrize(("cell", "positions", "is_beyond", "edge"), [
    # low, high, median, tolerance and worst, each in units of the size with the limit at 1
    (GlanceCell(-1.0, 1.0, 1.5, 2.5, 1.9, "PASS"),
     (0.25, 0.875, 0.75, 0.975, 1.125), False, "1.90 m, 2.5 % margin"),
    (GlanceCell(1.0, 2.0, INF, 3.0, INF, "FAIL"), (0.75, 1.35, 1.0, None, 1.25), True, ""),
    (GlanceCell(0.0, INF, INF, None, 9.0, "FAIL"), (0.5, 1.35, None, None, None), True, "lost"),
    (GlanceCell(INF, INF, INF, None, INF, "FAIL"), (None, None, None, None, None), True, "lost"),
    (GlanceCell(9.0, 9.0, 9.0, 9.0, 41.6, "FAIL"), (1.35, 1.35, None, None, None), True,
     "41.6 m, 990 % over"),
    (GlanceCell(1.0, 1.5, 2.0, 9.0, 46.0, ""), (0.75, 1.0, 0.875, None, None), True,
     "46.0 m, 11 times over"),
    (GlanceCell(-2.0, -1.0, 0.0, 0.0, 0.0, "PASS"), (0.0, 0.5, 0.25, 0.5, 0.5), False,
     "0 m, 50 % margin"),
    (GlanceCell(-1.0, 1.0, 1.5, 1.9, None, "ESTIMATE"), (0.25, 0.875, 0.75, None, 0.975), False,
     ""),
])  # fmt: skip
def test_a_bar_has_the_positions_and_the_margin_of_its_values(cell, positions, is_beyond, edge):
    ((_, (bar,)),) = chart_rows([glance({"a": cell})], {"a": "A"}, {"a": "red"})
    found = bar.low, bar.high, bar.median, bar.tolerance, bar.worst
    for value, position in zip(found, positions, strict=True):
        assert value == (None if position is None else pytest.approx(100.0 * position / 1.35))
    assert (bar.beyond, re.sub(r"\s", " ", bar.edge), bar.status) == (is_beyond, edge, cell.status)
    assert (bar.label, bar.color) == ("A", "red")


def test_a_bar_of_a_lower_limit_is_mirrored_and_described_in_words():
    cell = GlanceCell(1.0, 2.5, 4.0, 0.5, INF, "FAIL")
    cells = {"a": cell, "b": GlanceCell(4.0, 4.0, 4.0, 4.0, -0.4, "FAIL")}
    labels, colors = {"a": "A", "b": "B"}, {"a": "red", "b": "blue"}
    row = glance(cells, below=False, unit="-")
    ((_, (first, second)),) = chart_rows([row], labels, colors)
    assert (first.low, first.high) == pytest.approx((50.0 / 1.35, 125.0 / 1.35))
    assert second.edge == "\N{MINUS SIGN}0.400, 60\u202f% over"
    assert first.mark != second.mark and (second.label, second.color) == ("B", "blue")
    values = dict(text.rsplit(" ", 1) for text in second.words.removeprefix("B: ").split(", "))
    assert values == {
        "median": "4.00",
        "5 % quantile": "4.00",
        "95 % quantile": "4.00",
        "worst flight": "4.00",
        "tolerance limit": "\N{MINUS SIGN}0.400",
    }
    assert first.words.count("(terminated early)") == 1 and "worst flight 0.500" in first.words


def test_the_eight_rows_nearest_to_their_limits_or_beyond_come_first():
    """Of a row, the worst end of all bars counts: the upper, or the lower of a lower limit."""
    rows = [glance({"a": GlanceCell(0, 0, 0.1 * k, 0, status="PASS")}, metric=k) for k in range(7)]
    cells = {"a": GlanceCell(0, 0, 0.0, 0, 0.0), "b": GlanceCell(-1.0, 0, 1.9, 0, 0.0)}
    rows += [glance(cells, metric="second bar"), glance(cells, metric="low", below=False, limit=0)]
    rows += [glance({"a": GlanceCell(0, 0, INF, 0, status="FAIL")}, metric="lost")]
    names = {"a": "", "b": ""}
    order = [entry.metric for entry, _ in chart_rows(rows, names, names)]
    assert order == ["lost", "low", "second bar", 6, 5, 4, 3, 2]
    assert [entry.metric for entry, _ in chart_rows(rows[:8], names, names)][:2] == [0, 1]


@pytest.mark.parametrize(
    ("cell", "below", "limit", "size", "text"),
    [
        (GlanceCell(3.0, 4.0, 8.0, 8.0), True, 8.0, 8.0, "0 to 8.00 m"),
        (GlanceCell(5.0, 6.0, 8.0, 8.0), True, 8.0, 3.0, "5.00 to 8.00 m"),
        (GlanceCell(-1.0, 6.0, 8.0, 8.0), True, 8.0, 9.0, "-1.00 to 8.00 m"),
        (GlanceCell(5.0, 6.0, 8.0, 8.0), False, 5.0, 3.0, "8.00 to 5.00 m"),
        (GlanceCell(7.0, 7.0, 7.0, 7.0), True, 7.0, 7.0, "7.00 to 7.00 m"),
        (GlanceCell(-7.0, -7.0, -7.0, -7.0), True, -7.0, 7.0, "-7.00 to -7.00 m"),
        (GlanceCell(0.0, 0.0, 0.0, 0.0), True, 0.0, 1.0, "0 to 0 m"),
        (GlanceCell(5.0, INF, INF, 8.0), True, 5.0, 5.0, "5.00 to 5.00 m"),
        (GlanceCell(INF, INF, INF, None), True, 2.0, 4.0, ""),
    ],
)
def test_a_row_without_requirement_is_scaled_to_its_values(cell, below, limit, size, text):
    row = glance({"a": cell}, below=below)
    ((entry, (bar,)),) = chart_rows([row], {"a": ""}, {"a": ""})
    assert (entry.limit, entry.size) == (limit, size)
    assert entry.text.replace("\N{MINUS SIGN}", "-") == text
    assert bar.edge.replace("\N{MINUS SIGN}", "-") == (
        f"median {cell.median:.2f} m".replace("0.00", "0") if cell.median < INF else "lost"
    )


def pair(a, b, winners, pairs=12000):
    entries = {k: SimpleNamespace(winner=w, compared=k > 0) for k, w in enumerate(winners)}
    failures = SimpleNamespace(only_a=11, only_b=22)
    return SimpleNamespace(
        a=f"x: {a}", b=f"y: {b}", controllers=(a, b), metrics=entries, any_failure=failures,
        pairs=pairs,
    )  # fmt: skip


def test_the_record_of_the_baseline_counts_metrics_and_failures():
    names = SimpleNamespace(label=str.upper)
    pairs = [pair("p", "q", ["x: p", "x: p", "y: q", "x: p", None]), *[pair("r", "s", [])] * 2]
    for count, more in ((2, []), (3, ["and 1 more"])):
        baseline = SimpleNamespace(paired=pairs[:count], folder="some/where/")
        record = baseline_record(baseline, names)
        assert record.label == "Compared with 'where'"
        assert [entry.names for entry in record.entries[:2]] == [("P",), ("R",)]
        text = re.sub(r"(?<=\d)\s(?=\d{3})", "", record.entries[0].text)
        assert re.findall(r"\d+", text) == ["2", "1", "4", "11", "22", "12000"]
        assert [entry.text for entry in record.entries[2:]] == more
    assert baseline_record(None, names) is None


def test_only_text_between_backticks_is_a_command():
    typed = make_environment().filters["typed"]
    assert typed("a `b <c>` d `e`") == (
        'a <code class="command">b &lt;c&gt;</code> d <code class="command">e</code>'
    )


@pytest.fixture
def rendered(monkeypatch):
    """Make pages as the entries that their template is given."""
    template = SimpleNamespace(render=lambda **entries: entries)
    monkeypatch.setattr(
        pages, "make_environment", lambda: SimpleNamespace(get_template=lambda _: template)
    )
    monkeypatch.setattr(pages, "envelope_data", lambda *_: ({}, {}))
    monkeypatch.setattr(pages, "make_flights_view", lambda *_: ({}, {}))
    return make_page


def test_the_head_of_a_page_has_the_facts_of_the_campaign(failing, rendered, monkeypatch):
    bars = [SimpleNamespace(beyond=k > 0, tolerance=[None, 0.5][k]) for k in (0, 1)]
    monkeypatch.setattr(pages, "chart_rows", lambda *_: [(None, bars)])
    failing = replace(failing, manifest=replace(failing.manifest, started="2014-05-06T07:08:09"))
    entries = rendered(Models(failing), [], ["a warning"])
    facts = entries["kicker"].split(" \N{MIDDLE DOT} ")
    assert facts[0] == "synthetic_s" and facts[-2] == "2014-05-06"
    assert facts[-3] == "flights of each: 100, seed 2014"
    assert facts[-1] == f"abhv-mc {failing.manifest.versions['abhv_mc']}"
    assert (entries["title"], entries["state"]) == ("synthetic_s", "complete")
    assert entries["question"] == failing.campaign.question != ""
    assert entries["required"] and entries["beyond"] and entries["with_tolerance"]
    assert not entries["many"] and entries["more_rows"] == 0
    assert entries["limit_position"] == LIMIT_POSITION
    assert entries["comparison"] == entries["sections"]["comparison"].tables()[0]
    notes = [
        name
        for name, section in entries["sections"].items()
        if any("a warning" in str(item) for item in section.items)
    ]
    assert notes == ["convergence"]


def test_a_page_of_one_controller_without_requirements_compares_nothing(tmp_path, rendered):
    folder = write_campaign(
        tmp_path / "c", runs=12, controllers=["tlc"], requirements=(), author="A. N. Other"
    )
    results = read_flown(folder)
    model = results.campaign.model.model_copy(update={"question": ""})
    manifest = replace(results.manifest, started=None, versions={})
    results = replace(results, campaign=replace(results.campaign, model=model), manifest=manifest)
    entries = rendered(Models(results), [])
    assert entries["kicker"].endswith("seed 2014 \N{MIDDLE DOT} A. N. Other")
    assert "synthetic_s" in entries["question"]
    assert entries["comparison"] is None and not entries["required"]
    assert not entries["with_tolerance"]
    assert entries["more_rows"] == max(0, len(Models(results)[VERDICTS].glance) - 8)


def test_of_too_many_flights_half_are_the_worst_and_half_the_first(failing):
    """The listed flights, which have histories, are among the worst."""
    rows = _select_rows(failing, "lqr", 30).tolist()
    listed, ranked = listed_worst(failing, "lqr"), failing.ranking.rows_of("lqr").tolist()
    worst = list(dict.fromkeys([*listed, *ranked]))[:15]
    first = [k for k in range(100) if k not in worst][:15]
    assert rows == sorted([*worst, *first])


@pytest.mark.parametrize(("limit", "ends"), [(30.0, (0.0, 30.0)), (31.0, (0.0, 10.0))])
def test_an_axis_extends_to_limits_within_three_times_the_range(failing, limit, ends):
    record = failing.campaign.metrics["sideslip_max_deg"]
    assert _metric(record, [5.0, limit], (0.0, 10.0))["ends"] == ends


def test_the_view_has_each_flight_and_five_samples_per_second(failing):
    words = dict.fromkeys(failing.controllers, "")
    data, arrays = make_flights_view(failing, words, words)
    assert np.diff(arrays["history-time"]) == pytest.approx(0.2)
    rows = {name: np.array(column) for name, column in data["rows"].items()}
    assert rows["failed"].reshape(3, 100).sum(axis=1).tolist() == [0, 12, 12]
    assert rows["failed"][data["order"]][:24].all() and (rows["history"] >= 0).sum() == 60


def test_a_dispersion_is_described_in_its_shown_unit():
    ends = find_range(np.array([np.inf, 0.3, -0.1, np.nan]))
    assert (ends, find_range(np.array([np.nan]))) == ((-0.1, 0.3), (0.0, 0.0))
    bank = _dispersion("initial.bank", ends, (np.radians(3.0), np.radians(2.0)), OURS)
    assert (bank["label"], bank["head"], bank["factor"]) == (
        "Initial bank",
        "initial.bank [deg]",
        False,
    )
    assert (bank["mean"], bank["sigma"]) == (pytest.approx(3.0), pytest.approx(2.0))
    failure = _dispersion("failure.rudder.loss_time", ends, (np.inf, np.inf), OURS)
    assert (failure["mean"], failure["sigma"], failure["never"]) == (None, None, "never")
    assert _dispersion("aero.lift", ends, (1.0, 0.1), OURS)["factor"]


def test_the_view_lists_each_flight_with_its_columns(failing, monkeypatch):
    words = {name: name.upper() for name in failing.controllers}
    data, arrays = make_flights_view(failing, words, words)
    rows = data["rows"]
    names = [failing.controllers[k] for k in rows["controller"]]
    flights = [(name, number) for name, number in zip(names, rows["flight"], strict=True)]
    assert flights == [(name, k) for name in failing.controllers for k in range(100)]
    assert (data["total"], data["left"]) == (300, "")
    assert set(data["outcomes"].values()) == {"ok", "sideslip limit"}
    lift = failing.samples["aero.lift"]
    assert arrays["column:aero.lift"].tolist() == np.tile(lift, 3).tolist()
    speed = "speed_error_max_mps"
    values = np.concatenate([failing.flights[name].metrics[speed] for name in failing.controllers])
    assert arrays[f"column:{speed}"].tolist() == values.tolist()
    failed = np.concatenate([failing.flights[name].failed for name in failing.controllers])
    missed = np.array(rows["missed"])
    assert missed[1].tolist() == (~(values < 5.0) | failed).astype(int).tolist()
    worst = failing.ranking
    best = [
        (worst.controllers[c], int(r)) for c, r in zip(worst.controller, worst.row, strict=True)
    ]
    assert [flights[k] for k in data["order"]] == best
    for name in failing.controllers:
        stored = read_histories(failing.folder, name)
        for number, columns in list(stored.items())[:2]:
            row = rows["history"][flights.index((name, number))]
            drawn = arrays["history:bank_deg"][row]
            expected = np.interp(arrays["history-time"], columns["time"], columns["bank_deg"],
                                 np.nan, np.nan)  # fmt: skip
            np.testing.assert_allclose(drawn, expected)
    monkeypatch.setattr("abhv_mc.report.pages.flights_view.MOST_FLIGHTS", 90)
    few, arrays = make_flights_view(failing, words, words)
    assert few["total"] == len(few["rows"]["flight"]) == arrays[f"column:{speed}"].size == 90
    assert "300" in few["left"]


def test_the_view_is_described_by_columns_requirements_and_criteria(failing, monkeypatch):
    monkeypatch.setattr("abhv_mc.report.pages.flights_view._STRIPS", 2)
    words = {name: name.upper() for name in failing.controllers}
    data, arrays = make_flights_view(failing, words, words)
    speed = "speed_error_max_mps"
    columns = {column["name"]: column for column in data["columns"]}
    assert list(columns) == [*failing.dispersed, *failing.metrics]
    assert columns[speed]["head"] == f"{speed} [m/s]" and columns[speed]["limits"] == [5.0]
    values = arrays[f"column:{speed}"]
    assert columns[speed]["ends"][1] == pytest.approx(max(values.max(), 5.0))
    assert data["strips"] == list(failing.dispersed[:2]) and data["x"] == failing.dispersed[0]
    assert tuple(data["headed"]) == failing.asked and data["y"] == failing.asked[0]
    assert [(item["metric"], item["low"], item["high"]) for item in data["requirements"]] == [
        ("altitude_error_max_m", None, 50.0),
        (speed, None, 5.0),
        ("sideslip_max_deg", None, 0.7),
    ]
    criteria = {item["metric"]: item for item in data["criteria"]}
    assert criteria["sideslip_max_deg"]["channel"] == "sideslip_deg"
    assert sorted(criteria["sideslip_max_deg"]["sides"]) == [-1.0, 1.0]
    assert criteria[speed]["to"] is None and criteria[speed]["from"] == 0.0
    assert [entry["label"] for entry in data["controllers"]] == list(words.values())
    assert len({entry["mark"] for entry in data["controllers"]}) == 3
    assert data["kind"] == "Controller" and data["flies"] and data["histories"] and data["banded"]
    lift = columns["aero.lift"]
    drawn = failing.samples["aero.lift"]
    assert (lift["mean"], lift["sigma"]) == pytest.approx((drawn.mean(), drawn.std()), rel=0.01)
    factor = columns["equivalence_ratio_max"]
    assert (factor["head"], factor["unit"]) == ("equivalence_ratio_max [-]", "")
