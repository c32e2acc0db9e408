"""S manoeuvre from formulas, in place of the compiled flight, for tests of reports."""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import DENSITY, DRAG, LIFT, make_plan, record, run
from fake_flight import write_campaign as write_fake

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.blocks import FlightBlock, make_recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.statistic import Statistic
from abhv_mc.flights.timing import Timing
from abhv_mc.interfaces import Engine
from abhv_mc.report.pages.build import build_report
from abhv_mc.topics import registry
from abhv_mc_vehicle.flight.channels import CHANNELS
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.vehicle_simulator.make_plans import reference_of

CONTROLLERS = ("tlc", "lqr", "lqr_retuned")
# Relative tracking error and control effort of each controller.
ERROR = {"tlc": 0.06, "lqr": 1.0, "lqr_retuned": 0.3}
USAGE = {"tlc": 1.1, "lqr": 1.0, "lqr_retuned": 1.08}
TICK, TICKS = 0.1, 600  # s

DISPERSIONS = (
    "{atmosphere.density: {distribution: uniform, half_width: 10 %}, "
    "aero.lift: {distribution: uniform, half_width: 10 %}, "
    "aero.drag: {distribution: uniform, half_width: 15 %}}"
)
REQUIREMENTS = (
    "{metric: altitude_error_max_m, below: 50, probability: 0.9973, consumer_risk: 0.10}",
    "{metric: speed_error_max_mps, below: 5, probability: 0.9973, consumer_risk: 0.10}",
    "{metric: sideslip_max_deg, below: 0.7, probability: 0.9973, consumer_risk: 0.10}",
)


def prepare(vehicle, mission, controller, name):
    """Return a plan with the reference of the S manoeuvre."""
    time = np.arange(TICKS + 1) * TICK
    phase, flying = np.pi * time / 50.0, time < 50.0
    rate = np.where(flying, 2500.0 * np.pi / 50.0 * np.sin(phase), 0.0)
    bank = -np.arctan(np.where(flying, 2500.0 * (np.pi / 50.0) ** 2 * np.cos(phase), 0.0) / 9.6)
    columns = {
        "altitude": 20000.0,
        "speed": 1400.0,
        "heading": np.pi / 2.0 - np.arcsin(rate / 1400.0),
        "angle_of_attack": np.radians(2.3) / np.cos(bank),
        "bank": bank,
        "equivalence_ratio": 0.85 + 0.25 * (1.0 / np.cos(bank) - 1.0),
        "north": np.where(flying, 2500.0 * (1.0 - np.cos(phase)), 5000.0),
        "east": 1400.0 * time,
    }
    reference = np.stack(
        [np.broadcast_to(columns.get(key, 0.0), time.shape) for key in REFERENCE], axis=1
    )
    return replace(make_plan(name), timing=Timing(TICK / 2.0, 2, TICKS), reference=reference)


def histories_of(name, parameters, reference):
    """Return channels [channel][flight, time] of a controller.

    Errors grow with samples.
    """
    time = reference["time"]
    stray, usage = ERROR.get(name, 0.6), USAGE.get(name, 1.0)
    density, lift, drag = (parameters[:, [column]] - 1.0 for column in (DENSITY, LIFT, DRAG))
    wobble = np.sin(1e4 * lift)
    kick = np.exp(-time / 2.0) + 0.8 * np.where(time > 50.0, np.exp(-(time - 50.0) / 2.0), 0.0)
    swing = np.sin(time / 4.0) * np.exp(-time / 30.0)
    load = 1.0 + density + lift
    ones = np.ones_like(load)
    bank_command = reference["bank_reference_deg"] * (1.0 - 0.6 * (density + lift))
    alpha_command = reference["angle_of_attack_reference_deg"] * (1.0 - 0.9 * (density + lift))
    channels = {
        "altitude_m": 20000.0
        + 110.0 * (density + lift + 0.004 * wobble) * (1.0 - np.exp(-time / 5.0)) * ones,
        "speed_mps": 1400.0
        - 14.0 * (drag + 0.5 * density) * (1.0 + 2.0 * stray) * np.tanh(time / 20.0),
        "flight_path_angle_deg": 0.3 * (density + lift) * swing,
        "heading_deg": reference["heading_reference_deg"] + (0.2 * density + 0.1 * stray) * swing,
        "angle_of_attack_deg": alpha_command - stray * 2.0 * kick * load,
        "sideslip_deg": (0.25 + 0.6 * stray) * kick * swing * load + 0.02 * wobble * kick,
        "bank_deg": bank_command * (1.0 - kick * load * (0.2 + stray * 0.5)),
        "aileron_deg": usage * 1.2 * swing * kick * load,
        "rudder_deg": usage * 0.4 * swing * kick * load,
        "elevator_deg": 0.8 + usage * (1.5 * kick + 3.0 * (lift + density)) * ones,
        "equivalence_ratio": reference["equivalence_ratio_reference"]
        * (1.0 + drag + 0.3 * density),
        "north_m": reference["north_reference_m"]
        + 900.0 * density * np.tanh(time / 40.0)
        + 20.0 * stray * time / 60.0,
        "east_m": reference["east_reference_m"] * ones,
        "mass_kg": 120000.0 - 80.0 * time * (1.0 + drag),
        "flight_path_angle_command_deg": 0.2 * (density + lift) * swing,
        "angle_of_attack_command_deg": alpha_command,
        "bank_command_deg": bank_command,
    }
    for surface in ("aileron", "rudder", "elevator"):
        channels[f"{surface}_command_deg"] = channels[f"{surface}_deg"] * 1.02
    channels["equivalence_ratio_command"] = channels["equivalence_ratio"] * 1.001
    shape = (len(parameters), time.size)
    channels = {
        key: np.broadcast_to(value, shape).astype(np.float32) for key, value in channels.items()
    }
    zeros = np.zeros(shape, np.float32)  # of what else a history holds
    return {signal.name: channels.get(signal.name, zeros) for signal in CHANNELS}


COUNTED = {
    Statistic.RMS: lambda values: np.sqrt((values**2).mean(axis=1)),
    Statistic.MAX_ABS: lambda values: np.abs(values).max(axis=1),
    Statistic.MAX: lambda values: values.max(axis=1),
    Statistic.MIN: lambda values: values.min(axis=1),
    Statistic.FINAL: lambda values: values[:, -1],
    Statistic.SUM: lambda values: values.sum(axis=1),
}


def metrics_of(channels, reference):
    """Return METRICS [flight, metric] from the histories, by their definitions."""
    time = reference["time"]
    settled = ((time > 5.0) & (time < 50.0)) | (time > 55.0)
    signals = {
        f"{name}_error_{unit}": channels[f"{name}_{unit}"] - reference[f"{name}_reference_{unit}"]
        for name, unit in (("altitude", "m"), ("speed", "mps"), ("heading", "deg"))
    }
    signals |= {
        f"{k}_error_deg": channels[f"{k}_deg"] - channels[f"{k}_command_deg"]
        for k in ("angle_of_attack", "bank")
    }
    signals["cross_track_m"] = channels["north_m"] - reference["north_reference_m"]
    for surface in ("aileron", "elevator", "rudder"):
        deflection = channels[f"{surface}_deg"]
        signals[f"{surface}_from_trim_deg"] = deflection - deflection[:, :1]
        signals[f"{surface}_moved_deg"] = np.abs(np.diff(deflection, axis=1))
    signals["fuel_used_kg"] = channels["mass_kg"][:, :1] - channels["mass_kg"]
    signals["load_factor_g"] = 1.0 / np.cos(np.radians(channels["bank_deg"]))
    signals = {**channels, **signals}
    table = np.zeros(
        (len(channels["bank_deg"]), len(METRICS))
    )  # zero: ripples, cycles and failures
    for k, metric in enumerate(METRICS):
        if metric.of in signals:
            values = signals[metric.of]
            table[:, k] = COUNTED[metric.statistic](
                values[:, settled] if metric.settled else values
            )
    return table


def write_campaign(
    folder,
    runs=60,
    sampling="random",
    failing=0,
    seed=2014,
    controllers=CONTROLLERS,
    requirements=REQUIREMENTS,
    end=TICKS * TICK,
    dispersions=DISPERSIONS,
    **entries,
):
    """Run a campaign in which `failing` flights with the highest density are lost at ``end`` s.

    TLC loses none.
    """
    path = write_fake(
        folder.with_name(folder.name + " files"),
        name="synthetic_s",
        question="Does TLC hold the S manoeuvre better than LQR under the paper's uncertainties?",
        controllers=f"{{{', '.join(f'{name}: one.yaml' for name in controllers)}}}",
        runs=str(runs),
        seed=str(seed),
        sampling=sampling,
        dispersions=dispersions,
        requirements=f"[{', '.join(requirements)}]",
        keep="{histories: {flights: worst 20, channels: all, rate: 10 Hz}, envelopes: {rate: 10 "
        "Hz}}",
        **entries,
    )
    densest = np.sort(read_campaign(path).make_samples().draw(0, runs)[:, 0])[::-1]

    def fly(plan, parameters, record_every=None):
        reference = reference_of(plan, 1)
        channels = histories_of(plan.controller, parameters, reference)
        lost = np.zeros(len(parameters), bool)
        if failing and plan.controller != "tlc":
            lost = parameters[:, DENSITY] >= densest[failing - 1]
        outcome = np.where(lost, Outcome.SIDESLIP_LIMIT, Outcome.OK).astype(np.int64)
        history = np.stack([channels[signal.name] for signal in CHANNELS], axis=2)
        history[lost[:, None] & (reference["time"] > end)] = np.nan
        ends = np.where(lost, end, TICKS * TICK)
        block = FlightBlock(
            outcome, ends, metrics_of(channels, reference), history, reference["time"]
        )
        return record(block, make_recording(record_every, plan))

    return run(path, folder, Engine(prepare, fly, "synthetic"), workers=1).folder


def build_page(folder, baseline=None):
    """Build a campaign's report without its figures, which take most of the time."""
    make_figures = registry.make_figures
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "make_figures", lambda models: make_figures(models) and {})
        return build_report(folder, baseline=baseline)
