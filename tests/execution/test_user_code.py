"""Campaigns with user code: same digest in every run, and no untrusted code runs."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from report.synthetic import build_page
from vehicle.user_code.test_vehicle_functions import write_ghame_x

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.check_inputs import check_inputs
from abhv_mc.execution.estimate import estimate_campaign
from abhv_mc.execution.merge import merge_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc.requests import Request, WorstRequest
from abhv_mc.search.worst import find_worst
from abhv_mc.shipped import find_input
from abhv_mc_tune.request import TuneRequest
from abhv_mc_tune.tuning import tune_controller
from abhv_mc_vehicle.cli.linearizing import linearize, margins
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.user_code.compiled import compile_law
from abhv_mc_vehicle.user_code.load_law import load_law
from abhv_mc_vehicle.user_code.module import run_module
from abhv_mc_vehicle.user_code.user_channels import compile_channels
from abhv_mc_vehicle.vehicle_simulator.simulator import make_engine

CAMPAIGN = """\
name: own
vehicle: {vehicle}
mission: mission.yaml
controllers: {{mine: law.yaml, lqr: {configs}/control/lqr.yaml}}
runs: {runs}
seed: 3
dispersions:
  atmosphere.density: {{distribution: uniform, half_width: 10 %}}
  aero.lift: {{distribution: uniform, half_width: 10 %}}
channels: channels.py
metrics: metrics.yaml
requirements:
  - {{metric: late_bank_swing_deg, below: 30 deg, probability: 0.8}}
keep: {{histories: {{flights: worst 3, by: twist_max}}}}
execution: {{workers: 2, batch: 16}}
"""
METRICS = """\
late_bank_swing_deg: {of: bank_error_deg, statistic: peak_to_peak, from: 1 s}
twist_max: {of: twist, statistic: max_abs}
ran: {of: "1 + 0 * mach", statistic: max}
"""
CHANNELS = """\
from abhv_mc.extend import channel
{line}
@channel(unit="deg/s")
def twist(actual, command):
    return (actual.bank - command.bank) * actual.roll_rate
"""


@pytest.fixture
def study(repository, tmp_path, own_list):
    """Return a function ``write(runs, vehicle)`` that writes a campaign in a user's folder."""
    configs = repository / "configs"
    mission = (configs / "mission" / "s_manoeuvre.yaml").read_text()
    lines = [
        "duration: 2 s" if line.startswith("duration") else line for line in mission.splitlines()
    ]
    (tmp_path / "mission.yaml").write_text("\n".join(lines) + "\n")
    shutil.copy(configs / "control" / "cascade.py", tmp_path / "law.py")
    text = (configs / "control" / "cascade.yaml").read_text().replace("cascade.py", "law.py")
    (tmp_path / "law.yaml").write_text(text)
    (tmp_path / "channels.py").write_text(CHANNELS.format(line=""))
    (tmp_path / "metrics.yaml").write_text(METRICS)

    def write(runs=40, vehicle=configs / "vehicle" / "ghame_x.yaml"):
        (tmp_path / "campaign.yaml").write_text(
            CAMPAIGN.format(configs=configs, runs=runs, vehicle=vehicle)
        )
        return tmp_path / "campaign.yaml"

    write()
    return write


def dispersed_in_altitude(text):
    return re.sub(
        "  atmosphere.density: .*",
        "  initial.altitude: {distribution: uniform, half_width: 50 m}",
        text,
    )


def threads():
    return dataclasses.replace(make_engine(), isolation="threads")


def test_workers_resume_shards_and_replay_give_the_same_digest(study, tmp_path, capfd):
    """Use a law, channels and a vehicle of the user, and margins, which need law and vehicle."""
    vehicle = write_ghame_x(tmp_path, "body")

    def write(runs):
        file = study(runs, vehicle)
        file.write_text(file.read_text() + "margins: {at: [trim, 1 s], flights: 20}\n")
        return file

    local = run_campaign(Request(write(40), tmp_path / "one", workers=1), threads()).manifest
    two = run_campaign(Request(write(24), tmp_path / "two"), make_engine()).manifest  # processes
    assert two.digest != local.digest
    two = run_campaign(Request(write(40), tmp_path / "two"), make_engine()).manifest
    parts = [tmp_path / "part1", tmp_path / "part2"]
    for i, shard in enumerate(parts, 1):
        run_campaign(Request(write(40), shard, shard=(i, 2), workers=1), threads())
    merged = merge_campaign(parts, tmp_path / "merged", threads()).manifest
    assert local.digest == two.digest == merged.digest
    stability = [
        json.loads((tmp_path / name / "margins.json").read_text()) for name in ("one", "merged")
    ]
    assert stability[0] == stability[1] and set(stability[0]["controllers"]) == {"mine", "lqr"}
    assert stability[0]["controllers"]["mine"]["nominal"][0]["stable"]
    own = {"inputs/controllers/mine/law.py", "inputs/channels/channels.py", "inputs/vehicle/own.py"}
    assert own <= set(two.inputs)
    assert replay_flight(tmp_path / "two", "mine", 7, fly).differences == ()
    results = read_flown(tmp_path / "two")
    assert {"late_bank_swing_deg", "twist_max"} <= set(results.metrics)
    assert results.flights["mine"].metrics["twist_max"].min() > 0.0
    entry = read_manifest(tmp_path / "two" / "manifest.json").requirements[0]
    assert (entry.metric, entry.verdict) == ("late_bank_swing_deg", "PASS")
    label = "late_bank_swing_deg".removesuffix("_deg").replace("_", " ").capitalize()
    assert label in build_page(tmp_path / "two").read_text()


def write_c_law(repository, folder, *lines):
    """Write the shipped LQR in C, with additional lines, as the law of the study's campaign."""
    shipped = repository / "configs" / "control" / "lqr_c"
    shutil.copy(shipped / "lqr_design.py", folder)
    shutil.copy(shipped / "lqr_c.yaml", folder / "law.yaml")
    text = (shipped / "lqr.c").read_text()
    text = text.replace(
        "    double path =", "\n".join(f"    {line}" for line in (*lines, "double path ="))
    )
    (folder / "lqr.c").write_text(text)
    return Request(folder / "campaign.yaml", folder / ("failing" if lines else "whole"))


def read_errors(folder, controller):
    return np.array(read_flown(folder).flights[controller].metrics["altitude_error_max_m"])


needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


@needs_cc
def test_a_crash_and_a_hang_in_c_cost_a_flight_each_of_a_campaign_that_ends_and_reports(
    study, repository, tmp_path, capfd
):
    """Run in worker processes; all other flights equal those of the built-in law."""
    file = study(140)
    text = file.read_text().replace("batch: 16}", "batch: 16, flight_time_limit: 1 s}")
    file.write_text(dispersed_in_altitude(text))
    heights = (20_000.0 + read_campaign(file).make_samples().draw(0, 140)[:, 0]).tolist()
    crash, hang = (f"time == 0.0 && measured->altitude - {heights[k]!r} < 1e-4" for k in (137, 61))
    crash, hang = (
        f"{statement} && measured->altitude - {heights[k]!r} > -1e-4"
        for statement, k in ((crash, 137), (hang, 61))
    )
    lines = (
        f"if ({crash}) *(volatile int *)0 = 1;",
        f"if ({hang}) for (volatile int on = 1; on;) {{}}",
    )
    request = write_c_law(repository, tmp_path, *lines)
    manifest = run_campaign(request, make_engine()).manifest
    assert manifest.state == "complete"
    assert manifest.controllers["mine"].outcomes == {"law_crashed": 1, "law_hung": 1, "ok": 138}
    flown = read_flown(request.output).flights
    assert [Outcome(code).code for code in flown["mine"].outcome[[61, 137]]] == [
        "law_hung",
        "law_crashed",
    ]
    is_ok = flown["mine"].outcome == Outcome.OK
    assert np.array_equal(
        read_errors(request.output, "mine")[is_ok], read_errors(request.output, "lqr")[is_ok]
    )
    assert build_page(request.output).exists()
    output = capfd.readouterr().err
    for reason, flight in (
        ("SIGSEGV", 137),
        (" 1 s", 61),
    ):  # lost twice, the second time alone
        assert re.search(rf"{reason}; .* altitude {int(heights[flight])}\.", output)


@pytest.mark.parametrize("file", ["law.py", "a/b/deep.py", "../../../../code.py", "{beside}"])
def test_untrusted_code_does_not_run(study, tmp_path, monkeypatch, file):
    """Reading a foreign folder runs no code, wherever its files point; a run needs trust."""
    ran, law = tmp_path / "ran", tmp_path / "law.py"
    line = f"open({str(ran)!r}, 'w').close()"
    (tmp_path / "channels.py").write_text(CHANNELS.format(line=line))
    law.write_text(law.read_text() + f"\n{line}\n")
    out, again, level = tmp_path / "handed/out", tmp_path / "again", find_input("level", "mission")
    run_campaign(Request(study(), out, runs=24), threads())
    ran.unlink()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "somebody_else"))
    for cached in (run_module, load_law, compile_law, compile_channels):
        cached.cache_clear()
    campaign, controller = out / "campaign.yaml", out / "inputs/controllers/mine/law.yaml"
    is_inside, is_beside = file == "law.py", file == "{beside}"
    if is_inside:
        read_flown(out)
        build_page(out)
        checked = check_inputs(campaign)
        assert "law.yaml" in [report.path.name for report in checked if report.warnings]
        with pytest.raises(InputError, match="--trust-code"):
            replay_flight(out, "mine", 1, fly)
    else:
        file = file.format(beside=out.parent / "code.py")
        (controller.parent / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(law, controller.parent / file)
        controller.write_text(controller.read_text().replace("law.py", file))
    metric = "bank_error_settled_max_deg"
    asks = (
        lambda: run_campaign(Request(campaign, again, runs=4), threads()),
        lambda: find_worst(WorstRequest(campaign, again, metric, flights=64), threads()),
        lambda: tune_controller(TuneRequest(campaign, tmp_path / "new.yaml"), threads()),
        lambda: estimate_campaign(read_campaign(campaign), threads()),
        lambda: margins(campaign, controllers="mine"),
        lambda: linearize(level, tmp_path / "model.npz", controller=str(controller)),
    )
    for ask in asks[: -1 if is_beside else None]:  # a controller file may name any file
        with pytest.raises(InputError, match="--trust-code"):
            ask()
    assert not ran.exists() and not again.exists()
    if is_inside:
        linearize(level, tmp_path / "model.npz", controller=str(controller), trust_code=True)
        assert ran.exists()
        assert replay_flight(out, "mine", 1, fly, trust_code=True).differences == ()


BAD = [
    ("bank_error_deg", "{of: bank_eror_deg, statistic: min}", "'bank_eror_deg'"),
    ("x", "{of: '__import__(\"os\")', statistic: min}", "__import__"),
    ("x", "{of: sin(bank_deg), statistic: min}", "degrees"),
    ("x", "{of: bank_deg, statistic: time_outside}", "'limit'"),
    ("x", "{of: bank_deg, statistic: min, from: 3 m}", "'3 m'"),
    (
        "sideslip_max_deg",
        "{of: bank_deg, statistic: min}",
        "'sideslip_max_deg'",
    ),
]


@pytest.mark.parametrize(("name", "entry", "message"), BAD)
def test_a_wrong_metric_is_rejected_with_its_location(study, name, entry, message):
    file = study()
    file.write_text(
        file.read_text()
        .replace(" metrics.yaml", f"\n  {name}: {entry}")
        .replace(", by: twist_max", "")
    )
    with pytest.raises(InputErrors) as caught:
        read_campaign(file)
    assert message in str(caught.value)
    assert f"{file}:12:" in str(caught.value)
