"""Tests of the command place, which compares test flights with a campaign."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import run as run_campaign
from fake_flight import write_campaign
from typer.testing import CliRunner

from abhv_mc.analysis.place import find_band, measure
from abhv_mc.cli.app import app
from abhv_mc.folder.flown_campaign import read_flown, read_histories
from abhv_mc.io.input_error import InputError
from abhv_mc.topics.envelopes import ENVELOPES
from abhv_mc.topics.topic import Models

KEEP = "{histories: {flights: all, channels: [altitude_m, speed_mps], rate: 2 Hz}}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("place")
    path = write_campaign(root, runs="60", controllers="{one: one.yaml}", keep=KEEP)
    return run_campaign(path, root / "out").folder


def write_flight(path, history, offset=0.0, **further):
    columns = {**history, "altitude_m": history["altitude_m"] + offset, **further}
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    return path


def place(*arguments):
    return CliRunner().invoke(app, ["place", *map(str, arguments)])


def test_a_flight_of_the_campaign_is_inside_the_band_and_a_shifted_one_outside(folder, tmp_path):
    histories = read_histories(folder, "one")
    extra = np.zeros_like(histories[7]["time"])
    inside = write_flight(tmp_path / "in.csv", histories[7], battery_V=extra)
    spread = np.ptp([history["altitude_m"].max() for history in histories.values()])
    outside = write_flight(tmp_path / "out.csv", histories[7], 10.0 * spread + 1.0)
    numbers = json.loads(place(inside, folder, "--json", "-").stdout)
    (flight,) = numbers["flights"]
    assert numbers["simulated"] == 60 and numbers["ignored"] == ["battery_V"]
    assert flight["leaves"] is None and flight["joint_p_value"] > 0.05
    assert numbers["together_p_value"] is None
    page = tmp_path / "page"
    result = place(inside, outside, folder, "-o", page)
    assert result.exit_code == 0, result.output
    assert "out.csv" in result.stdout and "altitude_m" in result.stdout
    assert (page / "report.html").is_file() and (page / "figures/placement.png").is_file()


def read_exit(result):
    """Return where the only flight leaves the band; None if it does not."""
    return json.loads(result.stdout)["flights"][0]["leaves"]


def test_declared_noise_widens_the_band(folder, tmp_path):
    histories = read_histories(folder, "one")
    noise = 50.0 * np.random.default_rng(2).standard_normal(histories[3]["time"].size)
    noisy = write_flight(tmp_path / "noisy.csv", histories[3], noise)
    assert read_exit(place(noisy, folder, "--json", "-")) is not None
    options = ["--measured", "altitude_m=50"]
    assert read_exit(place(noisy, folder, "--json", "-", *options)) is None
    assert "altitude_m 50" in place(noisy, folder, *options).stdout


def test_a_campaign_declares_the_noise(tmp_path):
    options = {"runs": "60", "controllers": "{one: one.yaml}", "keep": KEEP}
    path = write_campaign(tmp_path, **options, measured="{altitude_m: 0.05 km}")
    folder = run_campaign(path, tmp_path / "out").folder
    history = read_histories(folder, "one")[3]
    noise = 50.0 * np.random.default_rng(2).standard_normal(history["time"].size)
    noisy = write_flight(tmp_path / "noisy.csv", history, noise)
    assert read_exit(place(noisy, folder, "--json", "-")) is None
    assert "altitude_m 50" in place(noisy, folder).stdout


def test_channels_without_declared_noise_have_the_errors_of_the_sensors():
    samples = {
        "sensor.bank_bias": np.radians([0.0, 1.0, 2.0]),
        "sensor.speed_scale": np.array([1.0, 1.1, 1.2]),
        "sensor.altitude_noise": np.array([0.0, 0.0, 5.0]),
    }
    units = {"bank_deg": "deg", "speed_mps": "m/s", "speed_error_mps": "m/s", "altitude_m": "m"}
    histories = {k: np.full((4000, 4), 10.0) for k in (0, 2)}
    measured, sensed = measure(
        SimpleNamespace(samples=samples), histories, list(units), {"bank_deg": 0.0}, units
    )
    assert sensed == ("speed_mps", "speed_error_mps", "altitude_m")
    assert (measured[:, :, 0] == 10.0).all()  # declared without noise
    measured, sensed = measure(SimpleNamespace(samples=samples), histories, list(units), {}, units)
    assert measured[1].mean(axis=0) == pytest.approx([12.0, 12.0, 10.0, 10.0], abs=0.4)
    assert measured.std(axis=1)[:, 3] == pytest.approx([0.0, 5.0], abs=0.2)


@pytest.mark.parametrize(
    ("measured", "problem"),
    [("{altitude: 1 m}", "channel 'altitude'"), ("{altitude_m: 1 s}", "measured")],
)
def test_noise_of_an_unknown_channel_or_unit_is_rejected(tmp_path, measured, problem):
    path = write_campaign(tmp_path, controllers="{one: one.yaml}", measured=measured)
    with pytest.raises(InputError, match=r"campaign.yaml:\d+:\d+: ") as refused:
        run_campaign(path, tmp_path / "out")
    assert problem in str(refused.value) or "1 s" in str(refused.value)


def test_rows_of_metrics_are_ranked_without_histories(folder, tmp_path):
    table = tmp_path / "metrics.csv"
    table.write_text("altitude_error_max_m,speed_error_max_mps\n1e6,0\n1e6,0\n", encoding="utf-8")
    numbers = json.loads(place(table, folder, "--json", "-").stdout)
    assert [flight["name"] for flight in numbers["flights"]] == ["metrics.csv:2", "metrics.csv:3"]
    first = numbers["flights"][0]["metrics"][0]
    assert first["metric"] == "altitude_error_max_m" and first["rank"] == 61
    assert numbers["together_p_value"] < 0.01


@pytest.mark.parametrize(
    ("text", "options", "problem"),
    [
        ("time,mach\n0,1\n1,1\n", (), "altitude_m"),
        ("time,altitude_m\n1,1\n0,1\n", (), "flight.csv:3:"),
        ("time,altitude_m\n0,1\n1,x\n", (), "'x'"),
        ("time,altitude_m\n0,1\n1,1\n", ("--measured", "altitude_m=-1"), "-1"),
        ("time,altitude_m\n0,1\n1,1\n", ("--measured", "mach=1"), "'mach'"),
        ("time,altitude_m\n9000,1\n9001,1\n", (), "flight.csv:2:1: "),
        ("time,altitude_m\n0,1\n1,1\n", ("--controller", "three"), "'three'"),
    ],
)
def test_flights_that_cannot_be_compared_are_rejected(folder, tmp_path, text, options, problem):
    file = tmp_path / "flight.csv"
    file.write_text(text, encoding="utf-8")
    error = place(file, folder, *options).exception
    assert isinstance(error, InputError) and problem in str(error)


def test_histories_of_the_worst_flights_are_rejected(tmp_path):
    path = write_campaign(tmp_path, runs="40", controllers="{one: one.yaml}")
    folder = run_campaign(path, tmp_path / "out").folder
    file = tmp_path / "flight.csv"
    file.write_text("time,altitude_m\n0,1\n1,1\n", encoding="utf-8")
    error = place(file, folder).exception
    assert isinstance(error, InputError) and "histories" in str(error)


def test_the_report_draws_the_simultaneous_band(folder):
    models = Models(read_flown(folder))
    (_, caption), *_ = [(figure, text) for text, figure in models.figures(ENVELOPES)]
    assert "dotted lines" in caption.caption
    results = models.results
    _, band = find_band(results, "one", ["altitude_m", "mach"], np.array([0.0, 1.0]))
    histories = read_histories(folder, "one")
    inside = [
        band.deviations(history["altitude_m"][[0, 2], None]).max() <= band.factor
        for history in histories.values()
    ]
    assert np.mean(inside) >= 0.95
