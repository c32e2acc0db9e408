"""Replay of the C++ flight, and of the same flight in files that have other columns."""

import math

import pytest
from verification.test_invariants import ecef_from_geodetic

from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.kernel.world.earth import WGS84
from benchmarks.verification.fly_recording import check_times, read_columns
from benchmarks.verification.ghame6 import (
    geodetic_from_ecef,
    verify_ghame6,
)

NAME = "sturn50_total_h1e-4.csv.gz"


@pytest.fixture(scope="module")
def path(repository):
    return repository / "tests" / "reference" / "cadac-ghame6" / NAME


@pytest.fixture(scope="module")
def rows(path):
    return verify_ghame6(path)


def test_the_flight_is_met(rows):
    assert [row for row in rows if not row.ok] == []
    assert len(rows) == 10


def test_it_is_met_as_well_as_by_an_integration_a_thousand_times_finer(rows):
    # The reference's note gives the differences of a DOP853 replay; ours at 10 ms are no larger
    # than its digits.
    assert [row.quantity for row in rows if row.difference > 1.1 * row.tolerance / 3.0] == []


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("time,b\n0,1\n0.1,2\n0.2,3\n0.4,4\n", 5, "spaced"),
        ("time,b\n0,1\n0.1,2\n0.1,3\n", 4, "times"),
        ("time,b\n0,1\n\n0.1,word\n", 4, "'word'"),
        ("time,c\n0,1\n0.1,2\n", 1, "b"),
        ("time,b\n0,1,\n0.1,2,\n", 2, "3 cells"),
        ("# time, b\ntime , b\n0,1\n", None, "1 row"),
        (None, None, "a.csv"),
    ],
)
def test_a_recording_that_is_none_is_refused(tmp_path, text, line, message):
    file = tmp_path / "a.csv"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        check_times(file, read_columns(file, ["time", "b"])["time"].to_numpy(), uniform=True)
    assert refused.value.line == line


def test_published_point():
    # EPSG guidance note 7-2 (geographic/geocentric conversions): WGS-84
    # 53 deg 48' 33.820" N, 2 deg 07' 46.380" E,
    # 73.0 m is X = 3771793.968, Y = 140253.342, Z = 5124304.349 m
    latitude = math.radians(53 + 48 / 60 + 33.820 / 3600)
    longitude = math.radians(2 + 7 / 60 + 46.380 / 3600)
    position = ecef_from_geodetic(WGS84, latitude, longitude, 73.0)
    assert position == pytest.approx([3771793.968, 140253.342, 5124304.349], abs=0.02)
    assert geodetic_from_ecef(WGS84, position) == pytest.approx(
        (latitude, longitude, 73.0), abs=2e-9
    )
