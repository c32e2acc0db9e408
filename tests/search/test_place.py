"""Tests of the comparison of test flights with simulated sets, with a fake flight."""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import DENSITY, ENGINE, LIFT, fly, make_plan, run, write_campaign
from search.known_flights import LINE

from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.io.messages import InputError
from abhv_mc.search.flight_records import Programme, sample
from abhv_mc.search.place import find_band, place_flights
from abhv_mc.statistics.placement import simultaneous_band
from abhv_mc.topics.envelopes import ENVELOPES
from abhv_mc.topics.topic import Models
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.plant.parameters import OURS

METRIC = "altitude_error_max_m"
LAWS = "atmosphere.density: {distribution: uniform, half_width: 8 %}"
CHANNELS = "time,altitude_m,speed_mps\n0,1,1\n1,1,1\n2,1,1\n"


def write_table(folder, text, **entries):
    """Return the campaign and the file of test flights with content `text`."""
    file = folder / "flights.csv"
    file.write_text(text, encoding="utf-8")
    return write_campaign(folder, controllers="{one: one.yaml}", **entries), [file]


def predict(density, lift):
    """Return the metric of a flight with these factors."""
    rows = OURS.nominal[np.newaxis].copy()
    rows[0, [DENSITY, LIFT]] = density, lift
    return fly(make_plan("one"), rows).metrics[0, [m.name for m in METRICS].index(METRIC)]


@pytest.mark.parametrize("error", [0.0, 12.0])
def test_measured_inputs_condition_the_simulated_flights(tmp_path, error):
    rows = [
        f"{density},{lift},{predict(density, lift) + error * (k == 1)}\n"
        for k, (density, lift) in enumerate([(0.95, 1.02), (1.05, 0.98), (1.02, 1.0)])
    ]
    text = f"atmosphere.density,aero.lift,{METRIC}\n{''.join(rows)}"
    path, files = write_table(tmp_path, text, measured=f"{{{METRIC}: 3 m}}")
    placement = place_flights(path, files, engine=ENGINE)
    assert placement.measured == ("atmosphere.density", "aero.lift")
    assert placement.noise == {METRIC: 3.0}
    assert (placement.simulated, placement.vehicles, placement.bands) == (199, 3, {})
    assert (placement.together_p_value <= 0.05) == (error > 0.0)
    outside = [flight.name for flight in placement.flights if flight.p_value <= 0.05]
    assert outside == (["flights.csv:3"] if error else [])
    low, high = (getattr(placement.flights[0].metrics[0], name) for name in ("low", "high"))
    assert high - low == pytest.approx(4.0 * 3.0, rel=0.25)


def test_flights_of_a_vehicle_share_parameters_given_measurements(tmp_path):
    text = f"vehicle,atmosphere.density,atmosphere.density_error,{METRIC}\n"
    path, files = write_table(tmp_path, f"{text}A,1.05,0.01,1\nA,,,1\nB,,,1\n")
    programme = Programme(path, files, engine=ENGINE)
    rows = programme.draw(2000)
    density, lift = rows[:, :, 0], rows[:, :, 1]
    assert (lift[:, 0] == lift[:, 1]).all() and (lift[:, 0] != lift[:, 2]).all()
    assert np.std(lift) == pytest.approx(0.05, rel=0.05)
    assert density[:, 0].mean() == pytest.approx(1.0485, abs=1e-3)  # shrunk to 1
    assert density[:, 0].std() == pytest.approx(0.01, rel=0.1)
    assert np.corrcoef(density[:, 1], density[:, 2])[0, 1] == pytest.approx(0.0, abs=0.1)


def test_priors_are_combined_with_measurements_by_their_variances(tmp_path):
    discrete = "aero.drag: {distribution: discrete, values: [0.9, 1.1]}"
    laws = f"{{{LAWS}, aero.lift: {{distribution: normal, mean: 1.1, sigma: 5 %}}, {discrete}}}"
    heads = "atmosphere.density,atmosphere.density_error,aero.side_force,aero.side_force_error"
    rows = "1.05,0.01,1.2,0.03,1\n,,,,2\n"
    path, files = write_table(tmp_path, f"{heads},{METRIC}\n{rows}", dispersions=laws)
    programme = Programme(path, files, engine=ENGINE)
    density, lift, drag, side = (
        programme.columns.index(f"{name}")
        for name in ("atmosphere.density", "aero.lift", "aero.drag", "aero.side_force")
    )
    assert programme.measured == ("atmosphere.density", "aero.side_force")
    assert programme.by_vehicle == ("aero.lift", "aero.drag") and programme.vehicles == [0, 1]
    center, scale = programme.priors
    sigma = 0.16 / 12**0.5
    weight = 1.0 / (1.0 + (0.01 / sigma) ** 2)
    assert center[:, density] == pytest.approx([1.0 + 0.05 * weight, 1.0])
    assert scale[:, density] == pytest.approx([0.01 * weight**0.5, sigma])
    assert scale[0, density] == pytest.approx((0.01**-2 + sigma**-2) ** -0.5)
    assert center[:, side] == pytest.approx([1.2, 1.0]) and scale[:, side].tolist() == [0.03, 0.0]
    assert center[:, lift] == pytest.approx([1.1] * 2) and scale[:, lift] == pytest.approx(
        [0.05] * 2
    )
    assert scale[:, drag].tolist() == [0.0, 0.0]
    drawn = programme.draw(500)
    assert {*drawn[:, 0, drag]} == {0.9, 1.1} and drawn[:, 0, side].std() == pytest.approx(
        0.03, rel=0.1
    )
    assert (drawn[:, 1, side] == 1.0).all()


def test_samples_are_interpolated_at_times_of_the_simulation():
    record = {"time": np.array([0.0, 1.0, 3.0]), "x": np.array([0.0, 2.0, 4.0])}
    record["angle"] = np.array([170.0, -170.0, -150.0])
    times = np.array([-0.5, 0.5, 2.0, 2.5, 3.5])
    sampled = sample(record, ["x", "angle", "none"], times, {"angle": 360.0, "x": 0.0}, offset=0.5)
    assert sampled.T.tolist()[0][:4] == [0.0, 2.0, 3.5, 4.0]
    assert sampled[:4, 1].tolist() == [170.0, 190.0, 205.0, 210.0]
    assert np.isnan(sampled[4]).all() and np.isnan(sampled[:, 2]).all()
    metrics = sample({"x": np.array([7.0])}, ["x", "y"], np.zeros(1), {})
    assert metrics[0, 0] == 7.0 and np.isnan(metrics[0, 1])


def test_histories_are_compared_at_most_at_500_times_of_the_longest(tmp_path):
    path, files = write_table(tmp_path, CHANNELS.replace("2,1,1", "1.3,1,1"))
    text = "".join(f"{k / 1000},1,2\n" for k in range(1501))
    (tmp_path / "long.csv").write_text(f"time,altitude_m,x\n{text}", encoding="utf-8")
    programme = Programme(path, [*files, tmp_path / "long.csv"], engine=ENGINE)
    assert programme.times == pytest.approx(np.arange(0, 1501, 4) / 1000)
    assert (programme.names, programme.ignored) == (("altitude_m", "speed_mps"), ("x",))


def test_the_band_is_of_the_39_random_histories_alone(tmp_path, monkeypatch):
    """Of 78 flights, those with even numbers are stored at random, others because they are bad."""
    keep = "{histories: {flights: [worst 5, every 2], channels: [altitude_m], rate: 2 Hz}}"
    entries = {"controllers": "{one: one.yaml}", "execution": "{workers: 1, batch: 78}"}
    path = write_campaign(tmp_path, runs="78", keep=keep, **entries)
    results, times = read_flown(run(path, tmp_path / "out").folder), np.array([0.0, 1.0])
    names, band = find_band(results, "one", ["mach", "altitude_m"], times)
    stored = read_histories(tmp_path / "out", "one")
    assert len(stored) > 39 and names == ["altitude_m"]
    expected = simultaneous_band(
        np.stack([sample(stored[k], names, times, {}) for k in range(0, 78, 2)])
    )
    assert band.factor == pytest.approx(expected.factor)
    np.testing.assert_allclose(band.edges, expected.edges)
    assert find_band(results, "one", ["mach"], times) is None
    monkeypatch.setattr("abhv_mc.search.place.FEWEST_FLIGHTS", 40)
    assert find_band(results, "one", names, times) is None


def test_correlated_parameters_follow_a_measured_one(tmp_path):
    text = f"atmosphere.density,{METRIC}\n1.08,1\n"
    laws = "aero.lift: {distribution: normal, sigma: 5 %, varies_by: flight}"
    pairs = "[{between: [atmosphere.density, aero.lift], normal: 0.9}]"
    path, files = write_table(tmp_path, text, dispersions=f"{{{LAWS}, {laws}}}", correlations=pairs)
    rows = Programme(path, files, engine=ENGINE).draw(1000)[:, 0]
    assert (rows[:, 0] == 1.08).all()
    assert rows[:, 1].mean() > 1.1 and rows[:, 1].std() == pytest.approx(0.05 * 0.19**0.5, rel=0.1)
    path, files = write_table(
        tmp_path,
        text,
        dispersions=f"{{{LAWS}, aero.lift: {{distribution: normal, sigma: 5 %}}}}",
        correlations=pairs,
    )
    assert not Programme(path, files, engine=ENGINE).by_vehicle


def test_errors_of_the_sensors_are_added(tmp_path):
    laws = ", ".join(
        f"sensor.{name}: {{distribution: normal, {law}}}"
        for name, law in {
            "altitude_bias": "mean: 100 m, sigma: 1 mm",
            "speed_scale": "mean: 1.5, sigma: 0.001 %",
            "speed_noise": "mean: 20 m/s, sigma: 1 mm/s",
            "sideslip_bias": "mean: 5 deg, sigma: 0.001 deg",
            "sideslip_noise": "mean: 2 deg, sigma: 0.001 deg",
        }.items()
    )
    text = "time,altitude_m,speed_mps,sideslip_deg\n0,1,1,1\n1,1,1,1\n2,1,1,1\n"
    path, files = write_table(tmp_path, text, dispersions=f"{{{laws}}}")
    programme = Programme(path, files, engine=ENGINE)
    rows = programme.draw(400)
    with programme.open() as simulate:
        measured, exact = simulate(rows, True)[:, 0], simulate(rows)[:, 0]
    history = fly(make_plan("one"), OURS.nominal[np.newaxis], 1).history[0, ::10]
    from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX

    true = history[:, [CHANNEL_INDEX[name] for name in programme.names]]
    expected = true * [1.0, 1.5, 1.0] + [100.0, 0.0, 5.0]
    assert exact.mean(axis=0) == pytest.approx(expected, rel=1e-4, abs=1e-3)
    assert (measured - exact).mean(axis=0) == pytest.approx(np.zeros((3, 3)), abs=3.0)
    assert measured.std(axis=0)[:, 1] == pytest.approx([20.0] * 3, rel=0.15)
    assert (measured - exact).std(axis=0)[:, 2] == pytest.approx([2.0] * 3, rel=0.15)
    assert (measured == exact)[:, :, 0].all()
    assert [*programme.sensors["speed_mps"]] == ["scale", "noise"]
    shared = "sensor.altitude_bias", "sensor.speed_scale", "sensor.sideslip_bias"
    assert programme.by_vehicle == shared


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time,length\n0,1\n1,1\n", "no column can be compared"),
        ("time,altitude_m\n1,1\n0,1\n", "flights.csv:3:"),
        ("time,altitude_m\n0,1\n1,x\n", "'x'"),
        ("time,altitude_m\n9000,1\n9001,1\n", "flights.csv:2:1: "),
        ("history\nnone.csv\n", "none.csv"),
    ],
)
def test_flights_that_cannot_be_compared_are_rejected(tmp_path, text, problem):
    path, files = write_table(tmp_path, text)
    with pytest.raises(InputError) as refused:
        place_flights(path, files, sets=20, engine=ENGINE)
    assert problem in str(refused.value)


def test_histories_and_metrics_cannot_be_mixed(tmp_path):
    path, files = write_table(tmp_path, f"{METRIC},x\n1,1\n")
    (tmp_path / "history.csv").write_text(CHANNELS, encoding="utf-8")
    with pytest.raises(InputError, match=r"history\.csv:1: no column"):
        place_flights(path, [*files, tmp_path / "history.csv"], engine=ENGINE)


@pytest.mark.parametrize("measured", ["{altitude: 1 m}", "{altitude_m: 1 s}"])
def test_noise_of_an_unknown_channel_or_unit_is_rejected(tmp_path, measured):
    path, files = write_table(tmp_path, CHANNELS, measured=measured)
    with pytest.raises(InputError, match=r"campaign.yaml:\d+:\d+: "):
        place_flights(path, files, engine=ENGINE)


def test_the_report_draws_the_simultaneous_band(tmp_path):
    keep = "{histories: {flights: all, channels: [altitude_m, speed_mps], rate: 2 Hz}}"
    path = write_campaign(tmp_path, runs="60", controllers="{one: one.yaml}", keep=keep)
    models = Models(read_flown(run(path, tmp_path / "out").folder))
    (_, caption), *_ = [(figure, text) for text, figure in models.figures(ENVELOPES)]
    assert "dotted lines" in caption.caption
    _, band = find_band(models.results, "one", ["altitude_m", "mach"], np.array([0.0, 1.0]))
    inside = [
        band.deviations(history["altitude_m"][[0, 2], None]).max() <= band.factor
        for history in read_histories(tmp_path / "out", "one").values()
    ]
    assert np.mean(inside) >= 0.95


def test_a_history_is_ranked_and_leaves_the_band(tmp_path):
    """The altitude is the density in each flight, and that of the test flight grows at the end."""
    history = "".join(f"{k / 10},{1.01 if k < 16 else 1.2}\n" for k in range(3, 20))
    keep = "{histories: {flights: all, rate: 10 Hz}}"
    path, files = write_table(
        tmp_path, f"time,altitude_m\n{history}", keep=keep, dispersions=f"{{{LAWS}}}"
    )
    placement = place_flights(path, files, engine=LINE)
    drawn = Programme(path, files, engine=LINE).draw(199)[:, 0, 0].astype(np.float32)
    (flight,) = placement.flights
    assert placement.together_p_value is None and placement.vehicles == 1
    ranks = {entry.metric.partition(", ")[2]: entry for entry in flight.metrics}
    mean = (13 * 1.01 + 4 * 1.2) / 17
    for summary, value in (("smallest", 1.01), ("largest", 1.2), ("last", 1.2), ("mean", mean)):
        entry = ranks[summary]
        rank = 1 + np.sum(drawn < value)
        numbers = value, *np.quantile(drawn, [0.025, 0.5, 0.975])
        assert (entry.value, entry.low, entry.median, entry.high) == pytest.approx(numbers)
        tail = 2.0 * min(rank, 201 - rank) / 200
        assert (entry.rank, entry.p_value) == (rank, pytest.approx(min(tail, 1.0)))
    assert (flight.leaves.channel, flight.leaves.time_s) == ("altitude_m", pytest.approx(1.6))
    assert flight.covers == pytest.approx((0.3, 1.9))
    low, high, test = placement.bands["altitude_m"]
    assert (low[0], high[0], test[0, 0]) == pytest.approx((0.92, 1.08, 1.01), abs=0.008)


def test_angles_over_the_whole_circle_have_no_band_and_are_named(tmp_path):
    """The density turns the heading by up to a whole turn after 1 s, and the bank not at all."""
    from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX

    def fly_turn(plan, parameters, record_every=None):
        block = LINE.fly(plan, parameters, record_every)
        history = block.history.copy()
        early, turn = 10.0 * history[:, :, 0], 360.0 * (history[:, :, 0] - 0.92) / 0.16
        history[:, :, CHANNEL_INDEX["heading_deg"]] = np.where(block.times > 1.0, turn, early)
        history[:, :, CHANNEL_INDEX["bank_deg"]] = 179.0 + 2.0 * (history[:, :, 0] > 1.0)
        return replace(block, history=history)

    text = "".join(f"{k / 10},1.0,10,-179.5,7\n" for k in range(2, 19))
    heads = "time,altitude_m,heading_deg,bank_deg,unknown"
    path, files = write_table(tmp_path, f"{heads}\n{text}", dispersions=f"{{{LAWS}}}")
    placement = place_flights(path, files, sets=59, engine=replace(LINE, fly=fly_turn))
    assert placement.spread == ("heading_deg",) and placement.ignored == ("unknown",)
    low, high, test = placement.bands["heading_deg"]
    late = placement.times > 1.05
    assert np.isnan([low[late], high[late], test[0, late]]).all()
    assert ((low > 9.0) & (high < 11.0) & (test == 10.0))[:, ~late].all()
    low, high, test = placement.bands["bank_deg"]
    assert ((low < 179.1) & (high > 180.9) & (test == 180.5)).all()
    (flight,) = placement.flights
    assert flight.leaves is None and flight.vehicle == "flights.csv"
    assert flight.covers == pytest.approx((0.2, 1.8))


@pytest.mark.parametrize("ahead", [0.0, 0.15])
def test_a_record_with_another_clock_is_moved_onto_the_simulated_flights(tmp_path, ahead):
    """The altitude is a wave over time, multiplied by the density."""

    def fly_wave(plan, parameters, record_every=None):
        block = LINE.fly(plan, parameters, record_every)
        wave = np.sin(5.0 * block.times)[:, None].astype(np.float32)
        return replace(block, history=block.history * wave)

    times = np.arange(2, 19) * 0.1
    waves = 1.03 * np.sin(5.0 * (times - ahead)) + 0.01 * np.cos(40.0 * times)
    text = "".join(f"{time},{wave}\n" for time, wave in zip(times, waves, strict=True))
    entries = {"measured": "{altitude_m: 0.01 m}", "dispersions": f"{{{LAWS}}}"}
    path, files = write_table(tmp_path, f"time,altitude_m\n{text}", **entries)
    (flight,) = place_flights(path, files, sets=39, engine=replace(LINE, fly=fly_wave)).flights
    assert flight.offset_s == pytest.approx(ahead, abs=0.04)
