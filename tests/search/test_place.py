"""Tests of the comparison of test flights with simulated sets, with a fake flight."""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import DENSITY, ENGINE, LIFT, fly, make_plan, run, write_campaign
from search.known_flights import LINE

from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.io.messages import InputError
from abhv_mc.search.flight_records import Programme
from abhv_mc.search.place import find_band, place_flights
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
        }.items()
    )
    path, files = write_table(tmp_path, CHANNELS, dispersions=f"{{{laws}}}")
    programme = Programme(path, files, engine=ENGINE)
    rows = programme.draw(400)
    with programme.open() as simulate:
        measured = simulate(rows, True)[:, 0]
    history = fly(make_plan("one"), OURS.nominal[np.newaxis], 1).history[0, ::10]
    from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX

    true = history[:, [CHANNEL_INDEX[name] for name in programme.names]]
    assert measured.mean(axis=0) == pytest.approx(true * [1.0, 1.5] + [100.0, 0.0], abs=3.0)
    assert measured.std(axis=0)[:, 1] == pytest.approx([20.0] * 3, rel=0.15)
    assert [*programme.sensors["speed_mps"]] == ["scale", "noise"]
    assert programme.by_vehicle == ("sensor.altitude_bias", "sensor.speed_scale")


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
