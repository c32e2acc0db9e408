"""Replay of the C++ flight, and of the same flight in files that have other columns."""

import math

import numpy as np
import pandas as pd
import pytest
from verification.test_invariants import ecef_from_geodetic

from abhv_mc.io.input_error import InputError
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.world.earth import WGS84, gravity_ned
from benchmarks.verification.fly_recording import check_times, read_columns
from benchmarks.verification.ghame6 import (
    CADAC_EARTH,
    geodetic_from_ecef,
    read_recording,
    verify_ghame6,
)

NAME = "sturn50_total_h1e-4.csv.gz"


@pytest.fixture(scope="module")
def path(repository):
    return repository / "tests" / "reference" / "cadac-ghame6" / NAME


@pytest.fixture(scope="module")
def frame(path):
    return pd.read_csv(path)


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


def test_the_start_is_the_first_row(path, frame):
    recording = read_recording(path)
    first, start = frame.iloc[0], recording.states[0]
    assert np.degrees(start[s.LONGITUDE]) == pytest.approx(
        first["lonx"], abs=1e-6
    )  # a step of 1e-4 s behind
    assert np.degrees(start[s.LATITUDE]) == pytest.approx(
        first["latx"], abs=3e-4
    )  # CADAC++'s own series
    assert start[s.ALTITUDE] == pytest.approx(first["alt"] + 0.1834, abs=1e-3)
    assert np.linalg.norm(start[s.U : s.W + 1]) == pytest.approx(first["dvbe"], abs=1e-6)
    assert np.degrees(np.arctan2(start[s.W], start[s.U])) == pytest.approx(
        first["alphax"], abs=1e-6
    )
    assert start[s.MASS] == pytest.approx(first["vmass"], rel=1e-12)
    assert recording.controls[0] == pytest.approx(
        [*np.radians(first[["delax", "delrx", "delex"]]), first["throttle"]]
    )


def test_the_meridional_gravity_of_the_reference_has_the_other_sign(frame):
    # What the recorded accelerations leave when the recorded forces are taken out, against the two
    # Earths. The central difference of 100 Hz data is good to 1e-3 m/s2; the two differ by 0.027
    # m/s2.
    some = slice(200, 1200)
    velocity = frame[["vbii1", "vbii2", "vbii3"]].to_numpy()
    acceleration = np.gradient(velocity, 0.01, axis=0)
    body = frame[[f"tbi{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]].to_numpy().reshape(-1, 3, 3)
    force = frame[["fapb1", "fapb2", "fapb3"]].to_numpy() / frame[["vmass"]].to_numpy()
    field = (acceleration - np.einsum("tji,tj->ti", body, force))[some]
    position = frame[["sbii1", "sbii2", "sbii3"]].to_numpy()[some]
    radius = np.linalg.norm(position, axis=1)
    sine = position[:, 2] / radius
    cosine = np.sqrt(1.0 - sine**2)
    outward = position[:, :2] / np.linalg.norm(position[:, :2], axis=1)[:, np.newaxis]
    north = np.concatenate([-sine[:, np.newaxis] * outward, cosine[:, np.newaxis]], axis=1)
    j2_pull = 3.0 * CADAC_EARTH.j2 * CADAC_EARTH.gravitational_parameter / radius**2
    j2_pull *= (CADAC_EARTH.equatorial_radius / radius) ** 2 * sine * cosine
    along = np.einsum("ti,ti->t", field, north)
    assert np.median(along) == pytest.approx(
        np.median(j2_pull), rel=0.01
    )  # northward; J2 pulls to the south
    assert (
        gravity_ned(WGS84._replace(rotation_rate=0.0, flattening=0.0), 0.0, 0.5, np.sqrt(0.75))[0]
        < 0.0
    )


def test_columns_that_are_not_needed_may_go_and_come(frame, tmp_path, rows):
    few = [
        "time",
        *frame.columns[frame.columns.str.match(r"sbii|vbii|tbi|wbib|dela|dele|delr")],
        "throttle",
    ]
    slim = frame[[*few, "fmasse", "alt", "dvbe", "thtvdx", "alphax", "betax"]].assign(note="a word")
    file = tmp_path / "slim.csv"
    slim.to_csv(file, index=False)
    again = verify_ghame6(file)
    assert [row.ok for row in again] == [True] * 10
    # without vmass the mass comes from the fuel expended
    assert [row.difference for row in again] == pytest.approx(
        [row.difference for row in rows], abs=1e-5
    )


def test_a_later_start_and_a_coarser_grid(frame, tmp_path):
    file = tmp_path / "later.csv"
    frame.iloc[1500:2100:2].to_csv(file, index=False)  # 50 Hz from 16 s on, in the second turn
    assert [row for row in verify_ghame6(file) if not row.ok] == []


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


def test_whole_numbers_are_numbers_and_a_mass_is_asked_for(frame, tmp_path):
    file = tmp_path / "whole.csv"
    frame.assign(delex=frame["delex"].round().astype(int)).to_csv(file, index=False)
    assert read_recording(file).controls[:, 2] == pytest.approx(np.radians(frame["delex"].round()))
    frame.drop(columns=["vmass", "fmasse"]).to_csv(file, index=False)
    with pytest.raises(InputError, match=r"\bvmass\b"):
        read_recording(file)


def test_published_point() -> None:
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
