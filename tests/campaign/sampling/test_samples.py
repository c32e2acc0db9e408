"""Rows of samples: files, seeds of noise, and derived inputs."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_flight import write_campaign
from scipy import stats

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.derived_parameters import compile_derived
from abhv_mc.campaign.sampling.samples import draw_seeds, read_sample_file
from abhv_mc.flights.expressions import sine
from abhv_mc.flights.parameters import Parameter
from abhv_mc.io.messages import InputError, Refusal
from abhv_mc.search.space import make_space
from abhv_mc_vehicle.kernel.numerics.lane_math import sincos
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.plant.parameters import OURS

WIND = "{wind.turbulence: {distribution: uniform, low: 1 m/s, high: 2 m/s}, \
sensor.altitude_noise: {distribution: discrete, values: [1 m, 2 m]}}"
COLUMNS = ("wind.turbulence", "sensor.altitude_noise", "wind.turbulence_seed", "sensor.noise_seed")


def samples(folder, **entries):
    return read_campaign(
        write_campaign(folder, **{"dispersions": WIND, "keep": "{}", **entries})
    ).make_samples()


def test_seeds_are_columns_behind_the_dispersions(tmp_path):
    source = samples(tmp_path)
    values = source.draw(0, 300)
    assert source.names == COLUMNS
    assert len(np.unique(values[:, 2])) == len(np.unique(values[:, 3])) == 300
    assert abs(np.corrcoef(values[:, 2], values[:, 3])[0, 1]) < 0.2
    np.testing.assert_array_equal(source.draw(100, 200), values[100:200])
    numbers = draw_seeds(Parameter("s", "-", 0.0, "", of_user=True, seed=True), 5, 0, 99)
    assert (numbers % 1.0 == 0.0).all() and 2.0**51 < numbers.max() < 2.0**52


def test_dispersed_seeds_stay_and_samples_of_files_and_derived_noise_get_seeds(tmp_path):
    own = WIND[:-1] + ", wind.turbulence_seed: {distribution: uniform, low: 0, high: 0.5}}"
    source = samples(tmp_path, dispersions=own)
    assert sorted(source.names) == sorted(COLUMNS) and source.draw(0, 300)[:, 2].max() < 0.5
    (tmp_path / "s.csv").write_text("wind.turbulence\n1.0\n2.0\n", encoding="utf-8")
    source = samples(
        tmp_path, dispersions="{}", sampling="{design: file, path: s.csv}", runs="null"
    )
    assert source.names == ("wind.turbulence", "wind.turbulence_seed") and source.draw(
        0, 2
    ).shape == (2, 2)
    campaign = read_campaign(
        write_campaign(tmp_path, derived="{wind.turbulence: 3 * abs(aero.lift - 1)}")
    )
    assert campaign.make_samples().names[-1] == "wind.turbulence_seed"
    assert make_space(campaign).seeds == ("wind.turbulence_seed",)


@pytest.mark.parametrize(
    "design", ["corners", "{design: grid, levels: 3}", "{design: one_at_a_time, levels: 2}"]
)
def test_factorial_designs_have_one_common_seed(tmp_path, design):
    source = samples(tmp_path, sampling=design, runs="null")
    assert len(np.unique(source.draw(0, source.flights)[:, 2:], axis=0)) == 1
    assert source.flights in (4, 9, 5)  # the seeds are no dimension of the design


LIFT, DRAG, BANK = (PARAMETER_INDEX[name] for name in ("aero.lift", "aero.drag", "initial.bank"))
_BOTH = (
    "{aero.lift: {distribution: normal, sigma: 5 %}, aero.drag: {distribution: normal, sigma: 2 %}}"
)


def drawn(folder, **entries):
    campaign = read_campaign(write_campaign(folder, **entries))
    values = campaign.make_samples().draw(0, campaign.runs)
    return campaign, values, campaign.rows(values)


def test_what_is_dispersed_may_stand_on_its_own_right_side_and_correlates_as_it_must(tmp_path):
    """Drag is lift's share and its own scatter: r = 0.5 s_l / sqrt(0.25 s_l^2 + s_d^2)."""
    formula = "{aero.drag: aero.drag + 0.5 * (aero.lift - 1)}"
    campaign, values, rows = drawn(tmp_path, dispersions=_BOTH, derived=formula, runs="20000")
    assert np.array_equal(rows[:, DRAG], values[:, 1] + 0.5 * (values[:, 0] - 1.0))
    expected = 0.025 / np.hypot(0.025, 0.02)
    assert np.corrcoef(rows[:, LIFT], rows[:, DRAG])[0, 1] == pytest.approx(expected, abs=0.01)
    assert stats.kstest(rows[:, DRAG], stats.norm(1.0, np.hypot(0.025, 0.02)).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(values.T)[0, 1]) < 0.02  # the table holds what is drawn
    assert np.array_equal(campaign.rows(values[7:8])[0], rows[7])
    assert np.array_equal(make_space(campaign).rows(values), rows)


def test_functions_and_infinite_values(tmp_path):
    text = "max(sin(initial.heading), -0.5, cos(0) - 2) / sqrt(4) + abs(-0.25) - 0.25"
    derived = compile_derived("initial.bank", text, OURS)
    rows = np.zeros((3, 1 + max(PARAMETER_INDEX.values())))
    rows[:, PARAMETER_INDEX["initial.heading"]] = 0.3, -1.0, 0.0
    assert derived.program.evaluate(rows) == pytest.approx([np.sin(0.3) / 2, -0.25, 0.0], abs=1e-16)
    _, _, rows = drawn(
        tmp_path,
        dispersions="{failure.aileron.stuck_time: {distribution: uniform, low: 5 s, high: 50 s, "
        "probability: 5 %}}",
        derived="{failure.rudder.stuck_time: failure.aileron.stuck_time + 2}",
    )
    times = rows[
        :, [PARAMETER_INDEX[f"failure.{name}.stuck_time"] for name in ("aileron", "rudder")]
    ]
    assert (
        np.array_equal(times[:, 1], times[:, 0] + 2.0)
        and 0 < np.isfinite(times).all(axis=1).sum() < 30
    )


@pytest.mark.parametrize(
    "entry, message",
    [
        ("{aero.darg: aero.lift}", "'aero.darg'.*'aero.drag'"),
        ("{aero.drag: 2 * aero.lfit}", "'aero.lfit'.*'aero.lift'"),
        ("{aero.drag: 1 + lift}", "'lift'"),
        ("{aero.drag: aero.lift ** 2}", r"aero\.lift \*\* 2"),
        ("{aero.drag: aero.lift + 0.05}", r"\b1\.05\b"),
        (
            "{aero.drag: aero.lift, aero.side_force: aero.drag}",
            "'aero.drag'",
        ),
        ("{wind.turbulence_seed: aero.lift}", " seed"),
    ],
)
def test_derived_inputs_refused(tmp_path, entry, message):
    with pytest.raises((InputError, Refusal), match=message):
        read_campaign(write_campaign(tmp_path, derived=entry))


def test_csv_and_parquet_give_the_same(tmp_path):
    (tmp_path / "s.csv").write_text("flight,aero.lift,aero.drag\n0,0.9,1.1\n1,1.0,1.2\n")
    pq.write_table(
        pa.table({"aero.lift": [0.9, 1.0], "aero.drag": [1.1, 1.2]}), tmp_path / "s.parquet"
    )
    from_csv, from_parquet = (
        read_sample_file(tmp_path / name, OURS) for name in ("s.csv", "s.parquet")
    )
    assert from_csv.names == from_parquet.names == ("aero.lift", "aero.drag")
    assert from_csv.values.tolist() == from_parquet.values.tolist() == [[0.9, 1.1], [1.0, 1.2]]
    (tmp_path / "s.parquet").write_text("not Parquet")
    with pytest.raises(InputError, match="Parquet"):
        read_sample_file(tmp_path / "s.parquet", OURS)


@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("aero.lift\n1.0\nx\n", 3, 1, "'x'"),
        ("aero.lift,aero.drag\n1.0,inf\n", 2, 5, "'inf'"),
        ("aero.lft\n1.0\n", 1, 1, "column 'aero.lft'"),
        ("flight,aero.lift\n1,1.0\n", 2, None, "flight"),
    ],
)
def test_bad_files_are_refused_in_place(tmp_path, text, line, column, message):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_sample_file(tmp_path / "s.csv", OURS)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert message in caught.value.found


def test_sines_have_the_bits_of_the_compiled_code():
    draw = np.random.default_rng(1)
    x = np.concatenate([draw.normal(0.0, 9.0, 999), draw.uniform(-1e6, 1e6, 999), [0.0, -0.0]])
    for quarter, values in enumerate(zip(*map(sincos, x.tolist()), strict=True)):
        assert sine(x, quarter).tobytes() == np.array(values).tobytes()
    assert np.isnan(sine(np.array([1.1e6, np.inf, np.nan]))).all()
