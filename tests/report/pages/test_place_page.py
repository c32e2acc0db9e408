"""Page of `abhv-mc compare` for test flights: results, ranks, bands."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abhv_mc.report.pages.place_page import make_place_answer
from abhv_mc.search.place import Departure, PlacedFlight, Placement, RankedMetric

METRICS = tuple(
    RankedMetric(f"m{k}", rank=k + 3, value=k + 0.5, low=k - 1.0, median=99.0, high=k + 2.0,
                 p_value=0.01 * (k + 1))
    for k in range(14)
)  # fmt: skip


def placed(name, p_value, leaves=None, covers=(1.0, 59.0), metrics=METRICS):
    return PlacedFlight(name, "v", metrics, p_value, leaves, 0.25, covers)


FLIGHTS = (
    placed("first", 0.05, Departure("speed", 31.0)),
    placed("second", 0.051),
    placed("third", 0.3, covers=None, metrics=METRICS[1:3]),
)
TIMES = np.array([0.0, 1.0, 2.0])


@pytest.fixture
def placement():
    bands = {
        name: (TIMES - k - 1.0, TIMES + k + 1.0, np.stack([TIMES, TIMES + 0.1 * k]))
        for k, name in enumerate(("speed", "altitude", "bank"))
    }
    return Placement(
        controller="tlc",
        simulated=1999,
        vehicles=2,
        by_vehicle=("mass", "lift"),
        measured=("wind",),
        noise={"wind": 0.5, "mass": 2.0},
        sensed=(),
        ignored=("note",),
        spread=("heading",),
        flights=FLIGHTS,
        together_p_value=0.02,
        times=TIMES,
        bands=bands,
    )


def texts(placement):
    records = make_place_answer(placement, Path("c")).section.items[0].records
    return {
        record.label: [re.sub(r"\s", " ", entry.text) for entry in record.entries]
        for record in records
    }


def test_a_flight_is_not_covered_at_a_p_value_of_5_percent(placement):
    found = texts(placement)
    assert (found["Covered"], found["Not covered"]) == (["second, third"], ["first"])
    assert found["All test flights"] == ["p = 0.020"]
    assert "All test flights" not in texts(replace(placement, together_p_value=None))
    assert found["Not covered if"][0].startswith("p <= 5 %,")


def test_each_flight_has_its_p_values_its_band_and_its_record(placement):
    found = texts(placement)
    ranks, left, record = found["first"]
    assert re.findall(r"p = (\S+)", ranks) == ["0.050", "0.010,"]
    assert " 14 metrics" in ranks and ranks.endswith(" m0, rank 3 of 2000")
    assert "speed at 31 s" in left
    assert re.findall(r"[\d.]+", record) == ["1", "59", "0.25"]
    assert "speed" not in found["second"][1] and "not left" in found["second"][1]
    (ranks,) = found["third"]
    assert " 2 metrics" in ranks and ranks.endswith(" m1, rank 4 of 2000")


def test_the_basis_of_the_comparison_is_listed(placement):
    found = texts(placement)
    assert [found[label] for label in ("Simulated sets", "Test flights", "Vary by vehicle")] == [
        ["1999"], ["3 flights of 2 vehicles"], ["mass, lift"]]  # fmt: skip
    assert found["Measured inputs"] == ["wind"] and found["Columns ignored"] == ["note"]
    assert found["Noise added (sigma)"] == ["wind 0.5, mass 2"] and ["heading"] in found.values()
    assert "Sensor errors added" not in found
    assert "none" in texts(replace(placement, noise={}))["Noise added (sigma)"][0]
    found = texts(replace(placement, noise={}, sensed=("speed",)))
    assert "Noise added (sigma)" not in found and found["Sensor errors added"] == ["speed"]


def test_the_tables_rank_the_metrics_of_each_flight(placement):
    tables = make_place_answer(placement, Path("c")).section.items[2:]
    rows = [table.plain_rows() for table in tables]
    assert [len(table) for table in rows] == [12, 12, 2] and "third" in tables[2].title
    for row, k in ((rows[0][0], 0), (rows[0][11], 11), (rows[2][0], 1)):
        name, value, ends, rank, p_value = (re.sub(r"\s", " ", cell) for cell in row)
        numbers = [float(text.replace("\N{MINUS SIGN}", "-")) for text in (*ends.split(" to "),)]
        assert (name, float(value), numbers) == (f"m{k}", k + 0.5, [k - 1.0, k + 2.0])
        assert (rank, float(p_value)) == (f"{k + 3} of 2000", pytest.approx(0.01 * (k + 1)))


def test_the_figure_shows_each_channel_with_its_band_and_flights(placement):
    answer = make_place_answer(placement, Path("c"))
    ((text, figure),) = answer.figures
    assert text.name == "placement" and answer.title.endswith(" TLC")
    shown = [axes for axes in figure.axes if axes.get_visible()]
    for axes, (name, (low, high, flights)) in zip(shown, placement.bands.items(), strict=True):
        x, y = axes.collections[0].get_paths()[0].vertices.T
        for k, time in enumerate(TIMES):
            assert (y[x == time].min(), y[x == time].max()) == (low[k], high[k])
        for line, history in zip(axes.lines, flights, strict=True):
            assert line.get_xydata().tolist() == np.column_stack([TIMES, history]).tolist()
        assert name in [words.get_text() for words in axes.texts]
    assert [axes.get_xlabel() for axes in shown] == ["", "time (s)", "time (s)"]
    legend = [words.get_text() for words in figure.legends[0].get_texts()]
    assert legend == ["band", "test flight"]
    assert not list(make_place_answer(replace(placement, bands={}), Path("c")).figures)
