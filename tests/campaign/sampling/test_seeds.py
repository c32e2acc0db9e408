"""Flights with turbulence or sensor noise meet other gusts and other noise each."""

import numpy as np
import pytest
from fake_flight import write_campaign

from abhv_mc.campaign.file.check import read_campaign

WIND = "{wind.turbulence: {distribution: uniform, low: 1 m/s, high: 2 m/s}, \
sensor.altitude_noise: {distribution: discrete, values: [1 m, 2 m]}}"
COLUMNS = ("wind.turbulence", "sensor.altitude_noise", "wind.turbulence_seed", "sensor.noise_seed")


def samples(folder, **entries):
    return read_campaign(write_campaign(folder, **{"dispersions": WIND, "keep": "{}", **entries})).make_samples()


def test_seeds_are_columns_behind_the_dispersions(tmp_path):
    source = samples(tmp_path)
    values = source.draw(0, 300)
    assert source.names == COLUMNS
    assert len(np.unique(values[:, 2])) == len(np.unique(values[:, 3])) == 300
    assert abs(np.corrcoef(values[:, 2], values[:, 3])[0, 1]) < 0.2
    np.testing.assert_array_equal(source.draw(100, 200), values[100:200])


def test_without_noise_there_is_no_seed(tmp_path):
    calm = "{aero.lift: {distribution: uniform, half_width: 10 %}}"
    assert samples(tmp_path, dispersions=calm).names == ("aero.lift",)


def test_a_seed_that_is_dispersed_stays_as_it_is_declared(tmp_path):
    own = WIND[:-1] + ", wind.turbulence_seed: {distribution: uniform, low: 0, high: 0.5}}"
    source = samples(tmp_path, dispersions=own)
    assert sorted(source.names) == sorted(COLUMNS) and source.draw(0, 300)[:, 2].max() < 0.5


@pytest.mark.parametrize("design", ["corners", "{design: grid, levels: 3}", "{design: one_at_a_time, levels: 2}"])
def test_factorial_designs_have_one_common_seed(tmp_path, design):
    source = samples(tmp_path, sampling=design, runs="null")
    assert len(np.unique(source.draw(0, source.flights)[:, 2:], axis=0)) == 1
    assert source.flights in (4, 9, 5)  # the seeds are no dimension of the design


def test_samples_from_a_file_get_seeds(tmp_path):
    path = write_campaign(tmp_path, dispersions="{}", keep="{}", sampling="{design: file, path: s.csv}", runs="null")
    (tmp_path / "s.csv").write_text("wind.turbulence\n1.0\n2.0\n", encoding="utf-8")
    source = read_campaign(path).make_samples()
    assert source.names == ("wind.turbulence", "wind.turbulence_seed") and source.draw(0, 2).shape == (2, 2)
