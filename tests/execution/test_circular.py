"""Angles in envelopes, bands and the comparison with test flights do not depend on the seam."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fake_flight import ENGINE, fly, record, write_campaign
from fake_flight import run as run_flights
from own_simulators import shown_text, write_study

from abhv_mc.execution.runner import run_campaign
from abhv_mc.flights.blocks import make_recording
from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.channel_curves import channel_curves
from abhv_mc.requests import Request
from abhv_mc.search.place import find_band, place_flights
from abhv_mc.topics.envelopes import NO_BAND
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX

HEADING = CHANNEL_INDEX["heading_deg"]


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """Function that returns the numbers of a campaign of turning flights.

    The numbers are envelopes, the simultaneous band, p-values of test flights, and the folder.
    """
    root = tmp_path_factory.mktemp("circular")
    channels = "channels: [altitude_m, heading_deg]"
    keep = f"{{histories: {{flights: all, {channels}}}, envelopes: {{{channels}}}}}"
    path = write_campaign(root, runs="60", controllers="{one: one.yaml}", keep=keep)

    @cache
    def run(heading, low=0.0, spread=0.0):
        def fly_turned(plan, parameters, recorded=None):
            block = fly(plan, parameters, 1)
            turn = 3.0 * block.history[:, :, HEADING] + 4.0 * block.times
            turn += spread * np.arange(len(turn))[:, None]
            block.history[:, :, HEADING] = (heading + turn) % 360.0
            return record(block, make_recording(recorded, plan))

        out, engine = root / f"{heading} {spread}", replace(ENGINE, fly=fly_turned)
        results = read_flown(run_flights(path, out, engine).folder)
        history, p_values = read_histories(out, "one")[7], []
        names = ["altitude_m", "heading_deg"]
        envelopes = [results.envelopes["one", name] for name in names]
        _, band = find_band(results, "one", names, envelopes[0].time)
        for turn in (0.0, 180.0):
            tested = (history["heading_deg"] + turn - low) % 360.0 + low
            table = np.column_stack([*(history | {"heading_deg": tested}).values()])
            np.savetxt(
                root / "flight.csv", table, delimiter=",", header=",".join(history), comments=""
            )
            placement = place_flights(out, [root / "flight.csv"], sets=60, engine=engine)
            p_values.append(placement.flights[0].p_value)
        bands = np.stack([[*envelope.bands.values()] for envelope in envelopes], axis=2)
        return np.vstack([bands, band.edges]), p_values, out, placement

    return run


@pytest.mark.parametrize("heading", range(0, 360, 45))
@pytest.mark.parametrize("low", [0.0, -180.0])
def test_headings_do_not_matter(turned, heading, low):
    expected, p_values, *_ = turned(90)
    bands, turned_p_values, out, _ = turned(heading, low)
    assert turned_p_values == p_values and p_values[0] > 0.1 > p_values[1]
    turns = (bands - expected - np.array([0.0, heading - 90.0])) / 360.0
    assert turns == pytest.approx(np.broadcast_to(np.round(turns[0, 0]), turns.shape), abs=1e-5)
    _, curves = channel_curves(read_flown(out), "one", "heading_deg")
    assert np.ptp(curves[:-1], axis=0).max() < 30.0


def test_flights_that_spread_over_the_circle_have_no_band(turned):
    bands, _, out, placement = turned(0, spread=6.0)
    assert np.isnan(bands).all(axis=(0, 1)).tolist() == [False, True]
    assert [*placement.bands] == ["altitude_m"] and placement.spread == ("heading_deg",)
    assert NO_BAND in shown_text(build_report(out))


BEARING = """
def fly(inputs, settings):
    bearing = [(inputs["a"] + k) % 6.283185307179586 - settings["low"] for k in range(9)]
    return {"total": 1.0, "history": {"time": list(range(9)), "bearing": bearing}}
"""


def test_circular_histories_of_custom_simulators(tmp_path):
    changes = {
        "systems": {"east": {"low": 0.0}, "signed": {"low": np.pi}},
        "histories": {"bearing": {"unit": "rad", "circular": "yes"}},
        "dispersions": {"a": {"distribution": "normal", "sigma": "0.1 m"}},
        "keep": {"histories": {"rate": "2 Hz"}, "envelopes": {"rate": "2 Hz"}},
    }
    path = write_study(tmp_path / "own", BEARING, **changes)
    results = read_flown(run_campaign(Request(path, tmp_path / "out")).folder)
    for system, low in (("east", 0.0), ("signed", np.pi)):
        envelope = results.envelopes[system, "bearing"]
        turns = np.median(results.samples["a"]) + envelope.time - low - envelope.median
        turns /= 2.0 * np.pi
        assert turns == pytest.approx(np.full_like(turns, round(turns[0])), abs=1e-6)
