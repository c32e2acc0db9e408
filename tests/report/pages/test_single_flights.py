"""Texts, numbers and figures that explain single flights."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.report.figures.searches import FLIGHT_PANELS
from abhv_mc.report.pages import single_flights
from abhv_mc.report.pages.single_flights import (
    explanation_numbers,
    explanation_records,
    make_explained_figure,
)
from abhv_mc_vehicle.plant.parameters import OURS


def explanation(**entries):
    """Return an explanation of flight 7, whose channel k is 100 (k + 1) + 10 times the flight."""
    channel, flight = np.arange(len(FLIGHT_PANELS)), np.arange(3.0)
    history = (100.0 * (channel + 1) + 10.0 * flight[:, None, None]) * np.ones((3, 61, 1))
    block = SimpleNamespace(
        times=np.arange(61.0),
        history=history,
        end_time=np.array([60, 10, 14]),
        outcome=np.array([0, *entries.pop("ended", (0, 5))]),
    )
    given = {
        "block": block,
        "channels": [SimpleNamespace(name=name) for name, *_ in FLIGHT_PANELS[::-1]],
        "flight": 7,
        "controller": "tlc",
        "causes": ("aero.lift", "aero.drag"),
        "samples": {"aero.lift": 1.1, "aero.drag": 0.9, "aero.moment": 1.2},
        "others": (("aero.lift", "aero.moment"), ("aero.drag",)),
        "smallest": True,
        "tried": 25000,
        "known": OURS,
        "failure": SimpleNamespace(words="failed"),
        "ended": "It ended.",
    }
    return SimpleNamespace(**{**given, **entries})


@pytest.mark.parametrize(("ended", "until"), [([5, 5], 28), ([5, 0], 14), ([0, 5], 14)])
def test_the_axis_ends_at_twice_the_last_early_end_or_with_the_flight(ended, until):
    """The last two flights end at 10 and 14 s, early if their outcome is not 0."""
    curve = make_explained_figure(explanation(ended=ended)).axes[0].lines[0]
    assert curve.get_xdata()[-1] == until


def test_the_figure_shows_the_three_flights_with_the_causes(monkeypatch):
    calls, five = [], {f"aero.{name}": 1.1 for name in "abcde"}
    monkeypatch.setattr(single_flights, "plot_flights", lambda *given: calls.append(given))
    for causes, samples, words in (
        (("aero.lift", "aero.drag"), {}, ["aero.lift +10.0 %", "aero.drag \N{MINUS SIGN}10.0 %"]),
        ((), {}, ["no dispersions"]),
        (tuple(five), {"samples": five}, [f"{name} +10.0 %" for name in list(five)[:4]]),
    ):
        make_explained_figure(explanation(causes=causes, **samples))
        times, panels, labels, title = calls.pop()
        title = re.sub(r"\s", " ", title)
        assert all(word in title for word in words) and "aero.e" not in title
        assert ("and 1 more" in title) == bool(samples)
        assert title.startswith("Flight 7 of TLC failed") and times.size == 15
        of_all = f"only {len(causes)} of {5 if samples else 3} dispersions"
        assert labels == ("nominal", of_all, "all dispersions")
    for k, (_, label, scale) in enumerate(FLIGHT_PANELS):
        levels = scale * (100.0 * (len(FLIGHT_PANELS) - k) + 10.0 * np.arange(3.0))
        np.testing.assert_allclose(panels[label], np.tile(levels[:, None], 15))


def records(**entries):
    found = explanation_records(explanation(**entries)).records
    return {
        record.label: [re.sub(r"\s", " ", entry.text) for entry in record.entries]
        for record in found
    }


def test_the_records_list_the_causes_and_at_most_ten_other_sets():
    found = records()
    assert found["Causes"] == ["aero.lift +10.0 %", "aero.drag \N{MINUS SIGN}10.0 %"]
    assert found["Other sets"] == ["aero.lift, aero.moment", "aero.drag"]
    assert re.findall(r"\d+", found["Fails with"][0].replace(" ", "")) == ["2", "3", "25000"]
    assert "no smaller" in found["Fails with"][0] and found["Flight"][0].startswith("7 of ")
    assert "no smaller" not in records(smallest=False)["Fails with"][0]
    assert "Causes" not in (none := records(causes=())) and "nominal" in none["Fails with"][0]
    sets = [(f"aero.{k}",) for k in range(11)]
    assert records(others=sets)["Other sets"] == [*(f"aero.{k}" for k in range(10)), "..."]
    assert records(others=sets[:10])["Other sets"][-1] == "aero.9"


def test_the_numbers_are_those_of_the_explanation():
    assert explanation_numbers(explanation(smallest=False)) == {
        "flight": 7,
        "controller": "tlc",
        "failure": "failed",
        "causes": {"aero.lift": 1.1, "aero.drag": 0.9},
        "others": [["aero.lift", "aero.moment"], ["aero.drag"]],
        "smallest": False,
        "flights_tried": 25000,
        "dispersions": {"aero.lift": 1.1, "aero.drag": 0.9, "aero.moment": 1.2},
    }
