"""Campaigns with compiled flights: guarantees that fake flights cannot test."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import interrupted_after, run

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.folder.opening import read_plan
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_campaigns
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.flight.plan_arrays import flatten
from abhv_mc_vehicle.kernel.plant.vehicle import (
    ACCELERATIONS,
    MORE_SENSORS,
    PARAMETER_INDEX,
    SCALED_SENSORS,
)
from abhv_mc_vehicle.plant.parameters import OURS, PARAMETERS
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle_simulator.stored_plans import rebuild_plan

CAMPAIGN = shipped_campaigns() / "harder_vehicle.yaml"
VEHICLE = CAMPAIGN.parents[1] / "configs/vehicle/ghame_x.yaml"
RUNS = 40


def _read_plan(folder, controller):
    vehicle = load_vehicle(VEHICLE)
    return read_plan(
        folder / f"plans/{controller}.npz", lambda arrays: rebuild_plan(arrays, vehicle)
    )


@pytest.fixture(scope="module")
def flown(flights_only, tmp_path_factory):
    """A shipped campaign, shortened."""
    return run(CAMPAIGN, tmp_path_factory.mktemp("real") / "a", flights_only, runs=RUNS, workers=2)


def test_digest_does_not_depend_on_workers_and_blocks(flown, flights_only, tmp_path):
    text = CAMPAIGN.read_text(encoding="utf-8").replace("batch: auto", "batch: 7")
    other = tmp_path / "other.yaml"
    other.write_text(
        text.replace("../configs", str(CAMPAIGN.parents[1] / "configs")), encoding="utf-8"
    )
    stopped = interrupted_after(5, replace(flights_only, isolation="threads"))
    first = run(other, tmp_path / "b", stopped, runs=RUNS, workers=1)
    assert not first.complete
    second = run(other, tmp_path / "b", flights_only, runs=RUNS, workers=1)
    assert second.manifest.digest == flown.manifest.digest
    alone = run(CAMPAIGN, tmp_path / "c", flights_only, runs=RUNS, controllers=("tlc",))
    assert alone.manifest.digests["tlc"] == flown.manifest.digests["tlc"]
    tables = [
        pq.read_table(folder / "envelopes.parquet") for folder in (flown.folder, tmp_path / "b")
    ]
    assert tables[0].equals(tables[1])


@pytest.mark.parametrize("controller", ["tlc", "lqr"])
def test_stored_plans_replay_to_the_bit(flown, flights_only, controller):
    replay = replay_flight(flown.folder, controller, 23, flights_only.fly)
    assert not replay.differences
    assert len(replay.block.times) == 6001
    configs = CAMPAIGN.parents[1] / "configs"
    fresh = flights_only.prepare(
        configs / "vehicle/ghame_x.yaml", configs / "mission/s_manoeuvre.yaml",
        configs / f"control/{controller}.yaml",
        controller,
    )  # fmt: skip
    stored = flatten(_read_plan(flown.folder, controller))
    for name, value in flatten(fresh).items():
        assert value.tobytes() == stored[name].tobytes(), name


def test_envelopes_contain_all_flights_at_every_tick(flown, flights_only):
    """Envelopes cover all ticks: TLC's surfaces saturate between samples 0.1 s apart."""
    samples = pq.read_table(flown.folder / "samples.parquet").drop_columns(["flight"])
    rows = full_rows(
        samples.column_names,
        np.column_stack([column.to_numpy() for column in samples.columns]),
        (),
        OURS,
    )
    bands = (
        pq.read_table(flown.folder / "envelopes.parquet")
        .to_pandas()
        .set_index(["controller", "channel"])
    )
    block = flights_only.fly(_read_plan(flown.folder, "tlc"), rows, 1)
    between = 0
    for channel in ("aileron_deg", "rudder_deg", "sideslip_deg", "elevator_deg", "speed_mps"):
        band, history = bands.loc["tlc", channel], block.history[:, :, CHANNEL_INDEX[channel]]
        slack = 1e-5 * np.abs(history).max()
        low, high = (np.interp(block.times, band["time"], band[end]) for end in ("min", "max"))
        assert np.all(history >= low - slack) and np.all(history <= high + slack)
        sampled = history[:, :: round(band["time"].iloc[1] / block.times[1])]
        between += sampled.max() < history.max() or sampled.min() > history.min()
    assert between  # samples alone would not contain these values


def test_a_metric_of_a_missing_quantity_is_rejected(flights_only, tmp_path):
    """A heat flux that is NaN must not pass because it never exceeds its limit."""
    text = CAMPAIGN.read_text(encoding="utf-8").replace(
        "../configs", str(CAMPAIGN.parents[1] / "configs")
    )
    text += "metrics: {hot_s: {of: stagnation_heat_flux_w_m2, statistic: time_outside, limit: 1}}\n"
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"'hot_s'.*'tlc'.*reference\.nose_radius"):
        run(tmp_path / "c.yaml", tmp_path / "out", flights_only, runs=RUNS)
    assert not (tmp_path / "out").exists()


# Parameters without effect on GHAME-X's tables, and densities at altitudes outside the mission;
# campaigns reject them.
WITHOUT_EFFECT = {
    "atmosphere.member",
    *(
        f"aero.{force}.{cause}"
        for force in ("lift", "drag")
        for cause in ("sideslip", "roll_rate", "pitch_rate")
    ),
    *(
        f"aero.{force}.{cause}"
        for force in ("lift", "drag")
        for cause in ("yaw_rate", "aileron", "rudder")
    ),
    "aero.drag.elevator",
    *(f"aero.side_force.{cause}" for cause in ("roll_rate", "pitch_rate", "yaw_rate", "elevator")),
    *(f"aero.rolling_moment.{cause}" for cause in ("pitch_rate", "elevator")),
    *(
        f"aero.pitching_moment.{cause}"
        for cause in ("sideslip", "roll_rate", "yaw_rate", "aileron", "rudder")
    ),
    *(f"aero.yawing_moment.{cause}" for cause in ("pitch_rate", "elevator")),
    *(f"atmosphere.density_at_{km}km" for km in (10, 30, 35, 40)),
    *(f"control.effector_{i}_effectiveness" for i in range(16)),
    # Quantities that TLC does not measure.
    *(
        f"sensor.{name}_{error}"
        for name in (*MORE_SENSORS, *ACCELERATIONS)
        for error in ("bias", "noise", "lag", "interval")
    ),
    *(f"sensor.{name}_scale" for name in ACCELERATIONS),
    # The vehicle has neither dead zones nor backlash.
    *(
        f"{device}.{slack}"
        for device in ("actuator", "engine")
        for slack in ("dead_zone", "backlash")
    ),
    *(f"sensor.{name}_scale" for name in MORE_SENSORS if name in SCALED_SENSORS),
}
MOVED = {
    **{"m": 5.0, "m/s": 2.0, "m/s2": 0.5, "1/s": 1e-4, "rad": 0.002, "rad/s": 0.002, "s": 0.03},
    **{"K": 5.0, "-": 0.1},
}
LIMITS = {
    "actuator.rate_limit": 0.1,
    "actuator.deflection_limit": 0.3,
    "engine.rate_limit": 0.01,
    "engine.equivalence_ratio_limit": 0.5,
}


def test_every_parameter_changes_a_flight(flown, flights_only):
    """With gusts, turbulence and noise, each parameter has an effect."""
    # The first is no parameter of a vehicle; failures act in pairs and have separate tests.
    listed = [
        parameter for parameter in PARAMETERS[1:] if not parameter.name.startswith("failure.")
    ]
    base = nominal_parameters()[0]
    for name, value in {
        "wind.gust_north": 3.0,
        "wind.gust_start": 5.0,
        "wind.turbulence": 0.5,
    }.items():
        base[PARAMETER_INDEX[name]] = value
    for parameter in listed:
        if parameter.name.endswith("_noise"):
            base[PARAMETER_INDEX[parameter.name]] = 0.1 * MOVED[parameter.unit]
    rows = np.tile(base, (1 + len(listed), 1))
    for row, parameter in zip(rows[1:], listed, strict=True):
        i = PARAMETER_INDEX[parameter.name]
        row[i] = LIMITS.get(parameter.name, row[i] + MOVED[parameter.unit])
    metrics = flights_only.fly(_read_plan(flown.folder, "tlc"), rows).metrics
    still = {
        p.name
        for p, row in zip(listed, metrics[1:], strict=True)
        if np.array_equal(row, metrics[0])
    }
    assert still == WITHOUT_EFFECT


def test_controllers_may_have_different_rates(flights_only, tmp_path):
    lqr = CAMPAIGN.parents[1] / "configs/control/lqr.yaml"
    slower = lqr.read_text(encoding="utf-8").replace("rate: 100 Hz", "rate: 50 Hz")
    (tmp_path / "slower.yaml").write_text(slower, encoding="utf-8")
    (tmp_path / "c.yaml").write_text(
        "{name: c, vehicle: abhv, mission: level, controllers: {tlc: tlc, slower: slower.yaml},"
        " under_test: [tlc], runs: 8, keep: {envelopes: {rate: 5 Hz}, histories: {rate: 10 Hz}},"
        " dispersions: {atmosphere.density: {distribution: uniform, half_width: 10 %}}}",
        encoding="utf-8",
    )
    folder = run(tmp_path / "c.yaml", tmp_path / "o", flights_only).folder
    bands = pq.read_table(folder / "envelopes.parquet").to_pandas()
    tracks = pq.read_table(folder / "nominal.parquet").to_pandas()
    for table, step in ((bands, 0.2), (tracks, 0.1)):
        times = [np.unique(own.time) for _, own in table.groupby("controller")]
        np.testing.assert_array_equal(*times)
        np.testing.assert_allclose(np.diff(times[0]), step, atol=1e-9)
