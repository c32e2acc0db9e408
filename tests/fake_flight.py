"""Cheap flight that replaces the compiled one, to test the campaign engine alone.

Every number is a plain function of the flight's parameters, element by element, so that the bits
depend on nothing else. Density below ``LOST_BELOW`` ends a flight early.
"""

import time
import typing
from dataclasses import replace
from functools import cache

import numpy as np

from abhv_mc.flights.blocks import FlightBlock, make_recording
from abhv_mc.flights.metrics import NO_METRICS
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.statistic import Statistic
from abhv_mc.flights.timing import Timing
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.control.design.trim_tables import rebuild_trim_tables
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX, CHANNELS
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.flight.plan import NO_SOURCES, FlightPlan, Limits
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE, TLC_GAINS, TLC_SETTINGS
from abhv_mc_vehicle.kernel.plant.air_data import no_profile
from abhv_mc_vehicle.kernel.plant.state import N_STATES
from abhv_mc_vehicle.kernel.plant.vehicle import CHUNK, PARAMETER_INDEX
from abhv_mc_vehicle.plant.effectiveness import make_effectiveness
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

DENSITY, LIFT, DRAG = (
    PARAMETER_INDEX[name] for name in ("atmosphere.density", "aero.lift", "aero.drag")
)
LOST_BELOW = 0.91
TICKS = 20  # of 0.1 s
_hints = cache(typing.get_type_hints)
_EXTREMES = {
    Statistic.MAX_ABS: lambda values: np.fmax.reduce(np.abs(values), axis=1),
    Statistic.MIN: lambda values: np.fmin.reduce(values, axis=1),
    Statistic.MAX: lambda values: np.fmax.reduce(values, axis=1),
}


def make_plan(name, gain=1.0, vehicle=None):
    """Return a plan with small arrays; the fake flight reads its first gain."""
    plan = _fill(FlightPlan)
    vehicle = vehicle or load_vehicle(shipped_configs() / "vehicle/nesc/brick.yaml")
    trim_tables = rebuild_trim_tables(
        np.tile([0.0, 1.0], 3), np.tile([1.0, 0.0], 3), np.zeros(8 * CHUNK)
    )
    parts = vars(plan) | {
        "controller": name,
        "law": "tlc",
        "timing": Timing(0.05, 2, TICKS),
        "limits": Limits(0.0, 1e5, -1.0, 1.0, 1.0),
        "vehicle": vehicle,
        "trim_tables": trim_tables,
        "effectiveness": make_effectiveness(vehicle),
        "initial_state": np.zeros(N_STATES),
        "reference": np.zeros((TICKS + 1, len(REFERENCE))),
        "gains": np.full((TICKS + 1, len(TLC_GAINS)), gain),
        "settings": np.zeros(len(TLC_SETTINGS)),
        "warnings": np.empty(0, dtype=np.str_),
        "gain_names": np.empty(0, dtype=np.str_),
        "profile": no_profile(),
        "declared": NO_METRICS,
        "user_sources": NO_SOURCES,
        "lean": False,
        "around": "",
        "law_parameters": np.empty(0, dtype=np.str_),
        "vehicle_code": None,
        **{"source_hash": "", "channels_hash": "", "source": None, "channels_source": None},
    }
    return FlightPlan(**parts)


def _fill(kind):
    """Return a nested record with values of the right types."""
    if hasattr(kind, "_fields") or hasattr(kind, "__dataclass_fields__"):
        return kind(**{name: _fill(hint) for name, hint in _hints(kind).items()})
    if kind in (bool, int, float, str):
        return kind(3)
    return np.arange(4.0) / 3.0


def prepare(vehicle, mission, controller, name):
    """Return a plan with the gain in the controller's file."""
    text = controller.read_text("utf-8")
    if "gain:" not in text:
        raise InputError(controller, "no gain", "gain: 1.0", 1, 1)
    return make_plan(name, float(text.partition("gain:")[2]), load_vehicle(vehicle))


def fly(plan, parameters, record_every=None):
    """Fly rows of parameters."""
    density, lift, drag = parameters[:, DENSITY], parameters[:, LIFT], parameters[:, DRAG]
    error = np.sin(40.0 * density) + np.cos(9.0 * lift) * drag
    lost = density < LOST_BELOW
    metrics = error[:, None] * plan.gains[0, 0] + np.arange(len(METRICS)) + np.abs(error[:, None])
    ticks = np.arange(TICKS + 1) * plan.timing.tick
    end = np.where(lost, 1.0, TICKS * plan.timing.tick)
    shape = 1.0 + 0.01 * np.arange(len(CHANNELS))
    history = (
        error[:, None, None] * plan.gains[0, 0] * np.cos(ticks)[None, :, None] * shape
    ).astype(np.float32)
    history[ticks[None, :] > end[:, None] + 1e-9] = np.nan
    last = history[np.arange(len(end)), np.rint(end / plan.timing.tick).astype(int)]
    for row, metric in enumerate(
        METRICS
    ):  # extremes and ends are those of the history, as a flight's are
        if metric.of in CHANNEL_INDEX:
            column = CHANNEL_INDEX[metric.of]
            if metric.statistic in _EXTREMES:
                values = _EXTREMES[metric.statistic](history[:, :, column])
                metrics[:, row] = np.maximum(values, 0.0 if metric.never_negative else -np.inf)
            elif metric.statistic == Statistic.FINAL:
                metrics[:, row] = last[:, column]
    outcome = np.where(lost, Outcome.SIDESLIP_LIMIT, Outcome.OK).astype(np.int64)
    return record(
        FlightBlock(outcome, end, metrics, history, ticks), make_recording(record_every, plan)
    )


def record(block, recording):
    """Return the requested channels and ticks of a block that has all."""
    if not recording.every:
        return replace(block, history=block.history[:, :0], times=np.empty(0))
    history = block.history[:, :, list(recording.channels)]
    channels = replace(
        block, history=history[:, :: recording.every], times=block.times[:: recording.every]
    )
    if not recording.extremes:
        return channels
    return replace(
        channels,
        low=around(history, recording.every, np.fmin),
        high=around(history, recording.every, np.fmax),
    )


def around(samples_of, every, extreme):
    """Return extremes [sample, channel] of all flights between the neighbours of each sample."""
    samples = range(0, samples_of.shape[1], every)
    pieces = [samples_of[:, max(0, k - every) : k + every + 1] for k in samples]
    return np.stack([extreme.reduce(piece, axis=(0, 1)) for piece in pieces]) + np.float32(0.0)


def fly_slowly(plan, parameters, record_every=None):
    """Fly slowly enough to be interrupted."""
    time.sleep(0.02)
    return fly(plan, parameters, record_every)


def sleep_and_fly(plan, parameters, record_every=None):
    """Take half a second in which the processor is idle."""
    time.sleep(0.5)
    return fly(plan, parameters, record_every)


ENGINE = Engine(prepare, fly, "fake")
SLOW_ENGINE = Engine(prepare, fly_slowly, "fake")


def interrupted_after(calls, engine=ENGINE):
    """Return an engine that is interrupted after a number of blocks; the first are trials."""
    left = iter(range(calls))

    def fly_until(plan, parameters, record_every=None):
        if len(parameters) and next(left, None) is None:
            raise KeyboardInterrupt
        return engine.fly(plan, parameters, record_every)

    return replace(engine, fly=fly_until)


def run(campaign, out, engine=ENGINE, **options):
    """Run a campaign with the options of a request."""
    from abhv_mc.execution.runner import run_campaign  # not where workers import this file
    from abhv_mc.requests import Request

    return run_campaign(Request(campaign, out, **options), engine)


def write_campaign(folder, **entries):
    """Write a campaign file and its inputs; ``entries`` (YAML) replace or add top-level keys."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "tables").mkdir(exist_ok=True)
    (folder / "tables/cl.csv").write_text("mach,value\n1,2\n2,3\n", "utf-8")
    brick = (shipped_configs() / "vehicle/nesc/brick.yaml").read_text("utf-8")
    brick = brick.replace("tables:\n", "tables:\n  lift: {file: tables/cl.csv}\n")
    lift = "aerodynamics:\n  lift:\n    - {table: lift}\n"
    (folder / "vehicle.yaml").write_text(brick.replace("aerodynamics:\n", lift), "utf-8")
    mission = (shipped_configs() / "mission/paper_s.yaml").read_text("utf-8")
    (folder / "mission.yaml").write_text(mission, "utf-8")
    (folder / "one.yaml").write_text("gain: 1.0\n", "utf-8")
    (folder / "two.yaml").write_text("gain: 2.0\n", "utf-8")
    lines = {
        "name": "fake",
        "vehicle": "vehicle.yaml",
        "mission": "mission.yaml",
        "controllers": "{one: one.yaml, two: two.yaml}",
        # The first controller is under test.
        "under_test": f"[{entries.get('controllers', '{one:').strip('{').partition(':')[0]}]",
        "runs": "300",
        "seed": "5",
        "sampling": "random",
        "dispersions": "{atmosphere.density: {distribution: uniform, half_width: 10 %},"
        " aero.lift: {distribution: normal, sigma: 5 %}}",
        "requirements": "[{metric: altitude_error_max_m, below: 50, probability: 0.9}]",
        "keep": "{histories: {flights: [worst 5, 7], rate: 10 Hz}, envelopes: {rate: 5 Hz}}",
        "execution": "{workers: 2, batch: 64}",
        **entries,
    }
    path = folder / "campaign.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in lines.items()), "utf-8")
    return path
