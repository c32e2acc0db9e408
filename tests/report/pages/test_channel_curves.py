"""Curves of channels for the interactive views."""

from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.flights.signals import Signal
from abhv_mc.report.pages.channel_curves import (
    _thinned,
    channel_curves,
    describe_channel,
    envelope_data,
)


@pytest.mark.parametrize(
    ("band", "expected"), [("min", [0, -7, -7]), ("max", [9, 9, 4]), ("q50", [0, 2, 4])]
)
def test_extremes_cover_the_samples_that_are_skipped(band, expected):
    curve = np.array([0.0, 9.0, 1.0, 2.0, -7.0, 3.0, 4.0])
    assert _thinned(curve, band, 3).tolist() == expected


SIGNALS = (
    Signal("altitude_m", "m", "height"),
    Signal("bank_deg", "deg", "bank"),
    Signal("bank_command_deg", "deg", "command"),
    Signal("mach", "-", "Mach number"),
)
TIMES = np.arange(4.0)


def envelope(level, size=4):
    bands = {name: level + k + np.arange(float(size)) for k, name in enumerate(("min", "max"))}
    return SimpleNamespace(time=np.arange(float(size)), bands=bands)


@pytest.fixture
def flown():
    """Return results of two controllers, of which only the first has bands of bank."""
    envelopes = {("a", "altitude_m"): envelope(10.0), ("b", "altitude_m"): envelope(20.0),
                 ("a", "bank_deg"): envelope(30.0)}  # fmt: skip
    reference = {"time": TIMES, "altitude_reference_m": np.full(4, 4.0)}
    return SimpleNamespace(
        controllers=("a", "b"),
        envelopes=envelopes,
        nominal={"a": {"time": TIMES[:3], "altitude_m": np.array([1.0, 2.0, 4.0])}},
        reference=reference,
        align=lambda name, columns: columns,
        campaign=SimpleNamespace(
            channels=SIGNALS, contents=SimpleNamespace(stems={"bank_deg": "bank"})
        ),
    )


def test_curves_are_the_bands_and_the_nominal_flight(flown):
    time, curves = channel_curves(flown, "a", "altitude_m")
    assert time.tolist() == TIMES.tolist()
    ramp, nan = np.arange(4.0), np.nan
    np.testing.assert_equal(curves, [10.0 + ramp, 11.0 + ramp, [1.0, 2.0, 4.0, nan]])
    _, curves = channel_curves(flown, "b", "bank_deg")
    assert np.isnan(curves).all() and curves.shape == (3, 4)


def test_an_error_without_bands_is_its_channel_minus_the_reference(flown):
    _, derived = channel_curves(flown, "a", "altitude_error_m")
    np.testing.assert_allclose(derived[:2], [6.0 + np.arange(4.0), 7.0 + np.arange(4.0)])
    flown.envelopes["a", "altitude_error_m"] = envelope(50.0)
    _, stored = channel_curves(flown, "a", "altitude_error_m")
    np.testing.assert_allclose(stored[:2], [50.0 + np.arange(4.0), 51.0 + np.arange(4.0)])


@pytest.mark.parametrize(("size", "every"), [(301, 1), (302, 2), (602, 2), (603, 3)])
def test_at_most_301_samples_are_kept(flown, size, every):
    flown.envelopes = {("a", "altitude_m"): envelope(0.0, size)}
    time, curves = channel_curves(flown, "a", "altitude_m")
    assert time.tolist() == np.arange(float(size))[::every].tolist()
    ends = np.arange(float(size))[::every]
    assert curves[0].tolist() == np.maximum(ends - every + 1, 0.0).tolist()
    assert curves[1].tolist() == np.minimum(ends + every, size).tolist()
    flown.controllers, ticks = ("a",), np.arange(float(size))
    flown.reference = {"time": ticks, "altitude_reference_m": ticks + 5.0}
    _, arrays = envelope_data(flown, {"a": "A"}, {"a": "red"})
    assert arrays["reference:time"].tolist() == ends.tolist()
    assert arrays["reference:altitude_reference_m"].tolist() == (ends + 5.0).tolist()


def test_the_view_has_the_channels_that_all_controllers_recorded(flown):
    words = {"a": "A", "b": "B"}
    data, arrays = envelope_data(flown, words, words)
    (channel,) = data["channels"]
    assert (channel["name"], channel["reference"]) == ("altitude_m", "altitude_reference_m")
    assert data["bands"] == ["min", "max", "nominal"] and data["nominal"]
    assert [entry["label"] for entry in data["controllers"]] == ["A", "B"]
    assert arrays.keys() == {"reference:time", "reference:altitude_reference_m", "time:a",
                             "altitude_m:a", "time:b", "altitude_m:b"}  # fmt: skip
    assert arrays["altitude_m:b"][0].tolist() == [20.0, 21.0, 22.0, 23.0]
    flown.reference = {}
    data, arrays = envelope_data(flown, words, words)
    assert data["channels"][0]["reference"] is None and arrays["reference:time"].size == 0


def test_a_channel_is_described_by_its_label_unit_and_command(flown):
    recorded = ("bank_deg", "bank_command_deg", "mach", "x_y")
    bank, mach, other = (
        describe_channel(name, recorded, flown.campaign) for name in ("bank_deg", "mach", "x_y")
    )
    assert (bank["label"], bank["unit"], bank["command"]) == ("Bank", "deg", "bank_command_deg")
    assert (mach["label"], mach["unit"], mach["command"]) == ("Mach", "", None)
    assert (other["label"], other["unit"], other["doc"]) == ("X y", "", "")
    assert describe_channel("bank_deg", ("bank_deg",), flown.campaign)["command"] is None
