"""A campaign's folder made by formula, in the format of the contract: the report's tests need no flight."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from abhv_mc.flight.channels import CHANNELS, REFERENCE_CHANNELS, STANDARD_CHANNELS
from abhv_mc.flight.metrics import METRICS
from abhv_mc.folder.digest import Digest
from abhv_mc.folder.envelopes import QUANTILES, EnvelopeTable, write_envelopes
from abhv_mc.folder.flights import VALUES, FlightRows, flights_schema, write_block
from abhv_mc.folder.histories import write_histories, write_nominal
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.manifest import Manifest, write_manifest
from abhv_mc.kernel.flight.counting import Statistic
from abhv_mc.report.pages.build import build_report
from abhv_mc.statistics.estimates import worst_first
from abhv_mc.topics import registry

CONTROLLERS = ("tlc", "lqr", "lqr_retuned")
# How far each controller strays (1 = a wide error) and how much surface it uses, beside the first.
ERROR = {"tlc": 0.06, "lqr": 1.0, "lqr_retuned": 0.3}
USAGE = {"tlc": 1.1, "lqr": 1.0, "lqr_retuned": 1.08}
TICK = 0.1  # s between the recorded samples

CAMPAIGN = """\
name: synthetic_s
question: Does TLC hold the S manoeuvre better than LQR under the paper's uncertainties?
vehicle: vehicle.yaml
mission: mission.yaml
controllers: {{{controllers}}}
runs: {runs}
seed: 2014
sampling: {sampling}
dispersions:
  atmosphere.density: {{distribution: uniform, half_width: 10 %}}
  aero.lift: {{distribution: uniform, half_width: 10 %}}
  aero.drag: {{distribution: uniform, half_width: 15 %}}
correlations: []
requirements: [{requirements}]
keep: {{histories: {{flights: worst 20, channels: all, rate: 10 Hz}}}}
execution: {{workers: auto, batch: auto}}
"""


REQUIREMENTS = (
    "{metric: altitude_error_max_m, below: 50, probability: 0.9973, consumer_risk: 0.10}",
    "{metric: speed_error_max_mps, below: 5, probability: 0.9973, consumer_risk: 0.10}",
    "{metric: sideslip_max_deg, below: 0.7, probability: 0.9973, consumer_risk: 0.10}",
)


def reference_of(time):
    """The S manoeuvre's reference channels, [time] each, in degrees and metres."""
    phase = np.pi * time / 50.0
    flying = time < 50.0
    rate = np.where(flying, 2500.0 * np.pi / 50.0 * np.sin(phase), 0.0)
    acceleration = np.where(flying, 2500.0 * (np.pi / 50.0) ** 2 * np.cos(phase), 0.0)
    bank = -np.degrees(np.arctan(acceleration / 9.6))
    columns = {
        "altitude_reference_m": np.full_like(time, 20000.0),
        "speed_reference_mps": np.full_like(time, 1400.0),
        "flight_path_angle_reference_deg": np.zeros_like(time),
        "heading_reference_deg": 90.0 - np.degrees(np.arcsin(rate / 1400.0)),
        "angle_of_attack_reference_deg": 2.3 / np.cos(np.radians(bank)),
        "bank_reference_deg": bank,
        "equivalence_ratio_reference": 0.85 + 0.25 * (1.0 / np.cos(np.radians(bank)) - 1.0),
        "north_reference_m": np.where(flying, 2500.0 * (1.0 - np.cos(phase)), 5000.0),
        "east_reference_m": 1400.0 * time,
    }
    assert set(columns) == {signal.name for signal in REFERENCE_CHANNELS}
    return columns


def histories_of(name, samples, time, wobble):
    """Channels [channel][flight, time] of one controller, by formula: lags and pulses that grow with the samples."""
    reference = reference_of(time)
    stray, usage = ERROR.get(name, 0.6), USAGE.get(name, 1.0)
    density, lift, drag = ((samples[key] - 1.0)[:, None] for key in ("atmosphere.density", "aero.lift", "aero.drag"))
    kick = np.exp(-time / 2.0) + 0.8 * np.where(time > 50.0, np.exp(-(time - 50.0) / 2.0), 0.0)
    swing = np.sin(time / 4.0) * np.exp(-time / 30.0)
    load = 1.0 + density + lift
    one = np.ones_like(load)
    bank_command = reference["bank_reference_deg"] * (1.0 - 0.6 * (density + lift))
    alpha_command = reference["angle_of_attack_reference_deg"] * (1.0 - 0.9 * (density + lift))
    channels = {
        "altitude_m": 20000.0 + 110.0 * (density + lift + 0.004 * wobble) * (1.0 - np.exp(-time / 5.0)) * one,
        "speed_mps": 1400.0 - 14.0 * (drag + 0.5 * density) * (1.0 + 2.0 * stray) * np.tanh(time / 20.0),
        "flight_path_angle_deg": 0.3 * (density + lift) * swing,
        "heading_deg": reference["heading_reference_deg"] + (0.2 * density + 0.1 * stray) * swing,
        "angle_of_attack_deg": alpha_command - stray * 2.0 * kick * load,
        "sideslip_deg": (0.25 + 0.6 * stray) * kick * swing * load + 0.02 * wobble * kick,
        "bank_deg": bank_command * (1.0 - kick * load * (0.2 + stray * 0.5)),
        "roll_rate_dps": 8.0 * kick * load,
        "pitch_rate_dps": 1.0 + 0.5 * kick * load,
        "yaw_rate_dps": 0.3 + 0.1 * kick * load,
        "aileron_deg": usage * 1.2 * swing * kick * load,
        "rudder_deg": usage * 0.4 * swing * kick * load,
        "elevator_deg": 0.8 + usage * (1.5 * kick + 3.0 * (lift + density)) * one,
        "equivalence_ratio": reference["equivalence_ratio_reference"] * (1.0 + drag + 0.3 * density),
        "north_m": reference["north_reference_m"] + 900.0 * density * np.tanh(time / 40.0) + 20.0 * stray * time / 60.0,
        "east_m": reference["east_reference_m"] * one,
        "latitude_deg": 29.27 + reference["north_reference_m"] / 111e3 * one,
        "longitude_deg": -78.0 + 1400.0 * time / 97e3 * one,
        "mass_kg": 120000.0 - 80.0 * time * (1.0 + drag),
        "dynamic_pressure_pa": 87000.0 * (1.0 + density) * np.ones_like(time),
        "flight_path_angle_command_deg": 0.2 * (density + lift) * swing,
        "angle_of_attack_command_deg": alpha_command,
        "bank_command_deg": bank_command,
    }
    for surface in ("aileron", "rudder", "elevator"):
        channels[f"{surface}_command_deg"] = channels[f"{surface}_deg"] * 1.02
    channels["equivalence_ratio_command"] = channels["equivalence_ratio"] * 1.001
    shape = (density.size, time.size)
    channels = {key: np.broadcast_to(value, shape).astype(np.float32) for key, value in channels.items()}
    assert set(channels) == set(STANDARD_CHANNELS)
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


def metrics_of(channels, time):
    """Every metric of METRICS from the recorded histories, as the contract defines them (at the recorded rate)."""
    reference = reference_of(time)
    settled = ((time > 5.0) & (time < 50.0)) | (time > 55.0)
    of = {
        f"{name}_error_{unit}": channels[f"{name}_{unit}"] - reference[f"{name}_reference_{unit}"]
        for name, unit in (("altitude", "m"), ("speed", "mps"), ("heading", "deg"))
    }
    of |= {f"{k}_error_deg": channels[f"{k}_deg"] - channels[f"{k}_command_deg"] for k in ("angle_of_attack", "bank")}
    of["cross_track_m"] = channels["north_m"] - reference["north_reference_m"]
    for surface in ("aileron", "elevator", "rudder"):
        deflection = channels[f"{surface}_deg"]
        of[f"{surface}_from_trim_deg"] = deflection - deflection[:, :1]
        of[f"{surface}_moved_deg"] = np.abs(np.diff(deflection, axis=1))
    of["fuel_used_kg"] = channels["mass_kg"][:, :1] - channels["mass_kg"]
    of["load_factor_g"] = 1.0 / np.cos(np.radians(channels["bank_deg"]))
    of = {**channels, **of}
    found = {}
    for record in METRICS:
        nothing = np.zeros(len(channels["bank_deg"]))  # of ripples, cycles and failures
        values = of[record.of][:, settled] if record.settled else of.get(record.of)
        found[record.name] = nothing if values is None else COUNTED[record.statistic](values).astype(np.float64)
    return found


def write_campaign(
    folder: Path,
    runs: int = 60,
    sampling: str = "random",
    failing: int = 0,
    seed: int = 7,
    controllers: Sequence[str] = CONTROLLERS,
    requirements: Sequence[str] = REQUIREMENTS,
) -> Path:
    """Write a synthetic campaign; of the controllers after the first, the `failing` flights with most density fail."""
    draw = np.random.default_rng(seed)
    paths = CampaignFolder(folder)
    paths.flights.mkdir(parents=True, exist_ok=True)
    time = np.arange(601) * TICK
    samples = {
        "atmosphere.density": draw.uniform(0.90, 1.10, runs),
        "aero.lift": draw.uniform(0.90, 1.10, runs),
        "aero.drag": draw.uniform(0.85, 1.15, runs),
    }
    wobble = draw.normal(size=runs)[:, None]
    pq.write_table(pa.table({"flight": np.arange(runs, dtype=np.int64), **samples}), paths.samples)
    nominal, envelopes, digests = {}, {}, {}
    for name in controllers:
        channels = histories_of(name, samples, time, wobble)
        metrics = metrics_of(channels, time)
        outcome = np.full(runs, "ok", dtype=object)
        if name != controllers[0] and failing:
            outcome[np.argsort(samples["atmosphere.density"])[-failing:]] = "sideslip_limit"
        digests[name] = write_flights(
            paths.flights, name, samples, outcome, {**metrics, "end_time_s": np.full(runs, 60.0)}
        )
        worst = worst_of(metrics, np.flatnonzero(outcome != "ok"))
        history = np.stack([channels[signal.name] for signal in CHANNELS], axis=2)
        names = [signal.name for signal in CHANNELS]
        write_histories(paths.histories / f"{name}.parquet", name, worst, time, history[worst], names)
        envelopes[name] = EnvelopeTable(
            count=np.full(history.shape[1:], runs, dtype=np.int64),
            low=history.min(axis=0).astype(np.float64),
            high=history.max(axis=0).astype(np.float64),
            least=(quantiles := np.quantile(history.astype(np.float64), QUANTILES, axis=0)),
            most=quantiles,
        )
        flown = histories_of(name, {key: np.ones(1) for key in samples}, time, np.zeros((1, 1)))
        nominal[name] = np.stack([flown[signal.name][0] for signal in CHANNELS], axis=1)
    write_envelopes(paths.envelopes, time, names, envelopes, runs)
    write_nominal(paths.nominal, time, nominal)
    pq.write_table(pa.table({"time": time, **reference_of(time)}), paths.reference)
    for reference in ("vehicle", "mission", *controllers):
        (folder / f"{reference}.yaml").write_text("name: synthetic\n", encoding="utf-8")
    listed = {
        "controllers": ", ".join(f"{name}: {name}.yaml" for name in controllers),
        "requirements": ", ".join(requirements),
    }
    paths.campaign.write_text(CAMPAIGN.format(runs=runs, sampling=sampling, **listed), encoding="utf-8")
    manifest = Manifest(
        name="synthetic",
        state="complete",
        seed=2014,
        campaign_hash="0" * 64,
        source_hash="none",
        runs_planned=runs * len(controllers),
        runs_done=runs * len(controllers),
        runs_failed=2 * failing,
        versions={"abhv_mc": "0.1.0", "python": "3.12.0", "numpy": "2.4.6", "numba": "0.68.1"},
        machine={"system": "synthetic", "processor": "none", "cores": 2},
        digest=str(sum(digests.values(), Digest())),
        digests={name: str(digest) for name, digest in digests.items()},
    )
    sign(folder, manifest)
    return folder


def sign(folder: Path, manifest: Manifest) -> None:
    """Write the manifest with the hashes of the files that are there."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json"]
    hashes = {path.relative_to(folder).as_posix(): hash_file(path) for path in files}
    write_manifest(folder / "manifest.json", replace(manifest, files=hashes))


def worst_of(metrics, early):
    """The 20 worst flights by the three requirements, ascending."""
    limits = {"altitude_error_max_m": 50.0, "speed_error_max_mps": 5.0, "sideslip_max_deg": 0.7}
    beyond = np.max([metrics[name] / limit for name, limit in limits.items()], axis=0)
    lost_at = np.where(np.isin(np.arange(beyond.size), early), 60.0, np.inf)
    return np.sort(worst_first(lost_at, beyond)[:20])


def write_flights(folder, name, samples, outcome, values):
    """The flights of one controller as two blocks; returns their digest."""
    schema = flights_schema(list(samples), {"campaign": "synthetic"})
    runs = len(outcome)
    digest = Digest()
    for first, stop in ((0, runs // 2), (runs // 2, runs)):
        block = FlightRows(
            controller=name,
            first=first,
            names=tuple(samples),
            samples=np.stack([column[first:stop] for column in samples.values()], axis=1),
            outcome=tuple(outcome[first:stop]),
            values=np.stack([values[signal.name][first:stop] for signal in VALUES], axis=1),
        )
        digest = digest + write_block(folder, block, schema)
    return digest


def build_with(folder: Path, *figures: str, baseline: Path | None = None, svg: bool = False) -> Path:
    """Build a campaign's report with these of its figures only: drawing all sixteen takes most of a report's time."""
    make_figures = registry.make_figures

    def make_few(models):
        missing = set(figures)

        def few():
            for text, figure in itertools.chain.from_iterable(make_figures(models).values()):
                if text.name in missing:
                    missing.remove(text.name)
                    yield text, figure
                if not missing:
                    return
            assert not missing, missing

        return {"few": few()}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "make_figures", make_few)
        return build_report(folder, baseline=baseline, svg=svg)
