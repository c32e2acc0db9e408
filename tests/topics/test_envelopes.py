"""Ranges of channels over all flights."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.topics.envelopes import ENVELOPES, Curve, Envelopes, _ends, compute_envelopes
from abhv_mc.topics.envelopes.figures import flight_curve, panel_of
from abhv_mc.topics.topic import Models


@pytest.mark.parametrize(
    ("ends", "text"),
    [
        ((2.0, 2.0), "2.00 to 2.00"),
        ((-0.5, 0.4), "−0.500 to 0.400"),
        ((0.0, 1.0), "0.0 to 1.0"),
        ((0.0, 9.96), "0.0 to 10.0"),
        ((0.0, 12.4), "0 to 12"),
        ((19000.0, 20000.4), "19\u202f000 to 20\u202f000"),
    ],
)
def test_ranges_have_the_digits_of_their_width(ends, text):
    assert _ends(*ends) == text


def test_a_range_is_of_all_flights_and_times(flown):
    results = flown(80)

    def envelope(low, high):
        return SimpleNamespace(bands={"min": low, "max": high}, time=np.array([0.0, 0.25, 0.5]))

    nan = np.full(3, np.nan)
    envelopes = {
        ("tlc", "bank_deg"): envelope(np.array([1.0, -3.0, np.nan]), np.array([2.0, 7.0, np.nan])),
        ("tlc", "rudder_deg"): envelope(nan, nan),
    }
    found = compute_envelopes(replace(results, envelopes=envelopes))
    assert found.ranges == {"tlc": {"bank_deg": (-3.0, 7.0)}}
    assert (found.step_s, found.flights) == (0.25, 80)
    models = Models(results)
    bank = models[ENVELOPES].ranges["lqr"]["bank_deg"]
    stored = results.envelopes["lqr", "bank_deg"].bands
    assert bank == (stored["min"].min(), stored["max"].max())
    (table,) = models.section(ENVELOPES).tables()
    assert len(table.heads) == 4 and ["bank (deg)", _ends(*bank)] in [
        [row[0], row[2]] for row in table.plain_rows()
    ]


def test_panels_are_of_the_channel_or_its_error():
    """The reference's ticks are not those of the bands; moving references have no extremes."""
    time, clock = np.arange(4.0), np.arange(0.0, 3.5, 0.5)
    bands = {name: k + time**2 for k, name in enumerate(("min", "q5", "q50", "q95", "max"))}
    reference = {"time": clock, "moving": 10.0 * clock, "constant": np.full(7, 5.0)}
    for name, less in (("moving", 10.0 * time), ("constant", 5.0)):
        curve = Curve("y", "error", name, off_reference=True)
        panel = panel_of((time, bands), curve, reference)
        kept = bands if name == "constant" else {k: bands[k] for k in ("q5", "q50", "q95")}
        assert list(panel.bands) == list(kept)
        for key, band in panel.bands.items():
            assert band == pytest.approx(kept[key] - less)
        assert panel.reference[0].tolist() == clock.tolist() and not panel.reference[1].any()
        found = flight_curve({"time": time, "y": bands["q5"]}, curve, reference)
        assert found[1] == pytest.approx(bands["q5"] - less)
    beside = Curve("y", "value", "moving")
    panel = panel_of((time, bands), beside, reference)
    assert panel.bands.keys() == bands.keys()
    assert all(np.array_equal(panel.bands[key], bands[key]) for key in bands)
    assert panel.reference[1].tolist() == (10.0 * clock).tolist()
    assert flight_curve({"time": time, "y": bands["q5"]}, beside, reference)[1] is bands["q5"]
    assert panel_of((time, bands), Curve("y", "value"), {}).reference is None


@pytest.mark.parametrize("band", [True, False])
def test_simultaneous_bands_are_drawn_around_each_channel(failing, monkeypatch, band):
    asked = []

    def find(results, controller, recorded, times):
        asked.append((controller, *recorded))
        edges = np.arange(1202.0).reshape(601, 2)
        shared = SimpleNamespace(edges=(-edges, edges))
        return (("speed_mps", "sideslip_deg"), shared) if band and controller == "lqr" else None

    monkeypatch.setattr("abhv_mc.topics.envelopes.figures.find_band", find)
    ((_, figure),) = Models(failing).figures(ENVELOPES)
    drawn = {
        axes.texts[-1].get_text(): [
            line
            for line in axes.lines
            if line.get_linestyle() == ":" and line.get_linewidth() == 0.8
        ]
        for axes in figure.axes
        if axes.texts
    }
    count = {title: len(lines) for title, lines in drawn.items() if lines}
    assert count == ({"speed (m/s)": 2, "sideslip (deg)": 2} if band else {})
    for title, k in (("speed (m/s)", 0), ("sideslip (deg)", 1)) if band else ():
        low, high = (line.get_ydata() for line in drawn[title])
        assert high.tolist() == (-low).tolist() == np.arange(k, 1202.0, 2).tolist()
    assert [name for name, *_ in asked] == ["tlc", "lqr", "lqr_retuned"]
    assert {len(recorded) for _, *recorded in asked} == {10}


@pytest.mark.parametrize(("flights", "among"), [(80, False), (50, True)])
def test_the_section_says_how_many_flights_and_which_spacing(flown, flights, among):
    names = Models(flown(80)).names
    ranges = {"tlc": {"altitude_m": (19950.0, 20040.0), "bank_deg": (-3.2, 7.4)}}
    found = Envelopes(ranges, 0.1, flights)
    section = ENVELOPES.section(found, names)
    lines = {record.label: record.line for record in section.items[0].records}
    assert ("flights 0 to 49" in lines["Bands"]) is among and "0.1 s" in lines["All flights"]
    assert "Unknowns" not in lines
    (table,) = section.tables()
    assert table.plain_rows() == [
        ["altitude (m)", "19\u202f950 to 20\u202f040", "", ""],
        ["bank (deg)", "−3 to 7", "", ""],
    ]
    model = names.campaign.model.model_copy(update={"figures": "paper"})
    unknowns = replace(names.campaign.unknowns, points=np.zeros((4, 1)))
    campaign = replace(names.campaign, model=model, unknowns=unknowns)
    section = ENVELOPES.section(found, replace(names, campaign=campaign))
    lines = {record.label: record.line for record in section.items[0].records}
    assert "4 points" in lines["Unknowns"] and f"with {flights // 4} flights" in lines["Unknowns"]
    assert [row[4] for row in section.tables()[0].plain_rows()] == ["Fig. 3", "Fig. 7"]
    empty = replace(found, step_s=None)
    records = ENVELOPES.section(empty, names).items[0].records
    assert records == ()


def test_channels_without_a_median_are_named(flown):
    """Where flights spread over the circle, the band is missing though flights are airborne."""
    results = flown(80)

    def envelope(*medians):
        return SimpleNamespace(count=np.array([3, 3, 0]), median=np.array(medians))

    envelopes = {
        ("tlc", "bank_deg"): envelope(1.0, 2.0, np.nan),
        ("lqr", "heading_deg"): envelope(1.0, np.nan, np.nan),
    }
    results = replace(results, envelopes=envelopes)
    section = ENVELOPES.section(Envelopes({}, 0.1, 80), Models(results).names)
    lines = [record.line for record in section.items[0].records]
    assert any("heading_deg" in line for line in lines)
    assert not any("bank_deg" in line for line in lines)
