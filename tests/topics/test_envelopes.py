"""Ranges of channels over all flights."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.topics.envelopes import ENVELOPES, _ends, compute_envelopes
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
