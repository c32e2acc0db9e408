"""Angles in envelopes, bands and the comparison with test flights do not depend on the seam."""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import ENGINE, fly, record, write_campaign
from fake_flight import run as run_flights
from own_simulators import shown_text, write_study

from abhv_mc.analysis.place import find_band, place_flights
from abhv_mc.execution.runner import run_campaign
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.plan import make_recording
from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.channel_curves import channel_curves
from abhv_mc.report.pages.place_page import make_place_answer
from abhv_mc.requests import Request
from abhv_mc.topics.envelopes import NO_BAND, compute_envelopes

HEADING = CHANNEL_INDEX["heading_deg"]


@pytest.fixture(scope="module")
def fly_heading(tmp_path_factory):
    """Function that runs a campaign whose flights turn by ``rate`` deg/s from a heading."""
    root = tmp_path_factory.mktemp("circular")
    channels = "channels: [altitude_m, heading_deg]"
    keep = f"{{histories: {{flights: all, {channels}}}, envelopes: {{{channels}}}}}"
    path = write_campaign(root, runs="60", controllers="{one: one.yaml}", keep=keep)

    def run(heading, spread=0.0):
        def fly_turned(plan, parameters, recorded=None):
            block = fly(plan, parameters, 1)
            turn = 3.0 * block.history[:, :, HEADING] + 4.0 * block.times
            turn += spread * np.arange(len(turn))[:, None]
            block.history[:, :, HEADING] = (heading + turn) % 360.0
            return record(block, make_recording(recorded, plan))

        out = root / f"{heading:g} {spread:g}"
        return run_flights(path, out, replace(ENGINE, fly=fly_turned)).folder

    return run


def numbers_of(folder, tmp_path, convention):
    """Return the envelopes, edges of the simultaneous band and p-values of two test flights."""
    results, history = read_flown(folder), read_histories(folder, "one")[7]
    names, band = find_band(results, "one", ["altitude_m", "heading_deg"], history["time"])
    p_values, file = [], tmp_path / "flight.csv"
    for turn in (0.0, 180.0):
        heading = (history["heading_deg"] + turn - convention) % 360.0 + convention
        table = np.column_stack([*(history | {"heading_deg": heading}).values()])
        np.savetxt(file, table, delimiter=",", header=",".join(history), comments="")
        (flight,) = place_flights(folder, [file]).flights
        p_values += [flight.joint_p_value, flight.band_p_value]
    return (
        {name: np.stack([*results.envelopes["one", name].bands.values()]) for name in names},
        dict(zip(names, np.moveaxis(band.edges, 2, 0), strict=True)),
        p_values,
    )


@pytest.mark.parametrize("heading", range(0, 360, 45))
@pytest.mark.parametrize("convention", [0.0, -180.0])
def test_headings_do_not_matter(fly_heading, tmp_path, heading, convention):
    expected = numbers_of(fly_heading(90), tmp_path, 0.0)
    folder = fly_heading(heading)
    numbers = numbers_of(folder, tmp_path, convention)
    for bands, bands_of_90 in zip(numbers[:2], expected[:2], strict=True):
        turn = np.round((np.median(bands["heading_deg"] - bands_of_90["heading_deg"])), 2)
        assert turn % 360.0 == (heading - 90) % 360
        assert bands["heading_deg"] - turn == pytest.approx(bands_of_90["heading_deg"], abs=1e-3)
        assert bands["altitude_m"] == pytest.approx(bands_of_90["altitude_m"], abs=1e-4)
    assert numbers[2] == expected[2]
    _, curves = channel_curves(read_flown(folder), "one", "heading_deg")
    assert np.ptp(curves[:-1], axis=0).max() < 30.0


def test_flights_that_spread_over_the_circle_have_no_band(fly_heading, tmp_path):
    folder = fly_heading(0, spread=6.0)
    results = read_flown(folder)
    assert np.isnan([*results.envelopes["one", "heading_deg"].bands.values()]).all()
    assert results.envelopes["one", "heading_deg"].count.max() == 60
    _, edges, _ = numbers_of(folder, tmp_path, 0.0)
    assert np.isnan(edges["heading_deg"]).all() and np.isfinite(edges["altitude_m"]).any()
    placement = place_flights(folder, [tmp_path / "flight.csv"])
    assert [*placement.bands] == ["altitude_m"] and placement.spread == ("heading_deg",)
    assert compute_envelopes(results).spread == ("heading_deg",)
    pages = shown_text(build_report(folder)), str(make_place_answer(placement, folder).section)
    assert all("heading_deg" in page and NO_BAND in page for page in pages)


BEARING = """
def fly(inputs, settings):
    bearing = [(inputs["a"] + 8.0 * t) % 360.0 - settings["low"] for t in range(-4, 5)]
    return {"total": 1.0, "history": {"time": [0.5 * k for k in range(9)], "bearing": bearing}}
"""


def test_circular_histories_of_custom_simulators(tmp_path):
    """Histories are interpolated across the seam, and systems begin on the same turn."""
    changes = {
        "systems": {"east": {"low": 0.0}, "signed": {"low": 180.0}},
        "histories": {"bearing": {"unit": "deg", "circular": "yes"}},
        "keep": {"histories": {"flights": "all", "rate": "4 Hz"}, "envelopes": {"rate": "4 Hz"}},
    }
    path = write_study(tmp_path / "own", BEARING, **changes)
    results = read_flown(run_campaign(Request(path, tmp_path / "out")).folder)
    for system, low in (("east", 0.0), ("signed", 180.0)):
        envelope = results.envelopes[system, "bearing"]
        median = np.median(results.samples["a"]) + 16.0 * envelope.time - 32.0 - low
        assert envelope.median % 360.0 == pytest.approx(median % 360.0, abs=1e-4)
        assert np.ptp([*envelope.bands.values()], axis=0).max() < 10.0
    changes["histories"]["bearing"]["unit"] = "m"
    with pytest.raises(InputError, match=r"study.yaml:\d+:\d+: .*'m'"):
        run_campaign(Request(write_study(tmp_path / "m", BEARING, **changes), tmp_path / "m out"))
