"""Metrics and histories that are added to stored flights, which are run again."""

import json
from dataclasses import replace

import numpy as np
import pytest
from own_simulators import write_study

from abhv_mc.execution import runner
from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.messages import InputError
from abhv_mc.requests import Request

SIMULATOR = """
def fly(inputs, settings):
    values = {"miss": abs(inputs["a"]) + settings["bias"], "swing": inputs["a"] ** 2}
    return {name: values[name] for name in METRICS}
"""


def write_campaign(folder, *metrics, limit=3.0, simulator=SIMULATOR):
    names = ("miss", *metrics)
    path = write_study(
        folder,
        f"METRICS = {names}\n{simulator}",
        systems={"first": {"bias": 0.0}, "second": {"bias": 0.5}},
        inputs={"a": {}},
        dispersions={"a": {"distribution": "normal", "sigma": 1.0}},
        metrics={name: {} for name in names},
        requirements=[{"metric": "miss", "below": limit, "probability": 0.9}],
        outcomes={"lost": "Lost.", "hit": "Hit."},
        runs=60,
    )
    return Request(path, folder / "out")


@pytest.fixture
def flown(tmp_path):
    return run_campaign(write_campaign(tmp_path)).folder


def test_an_added_metric_leaves_stored_values_and_gives_the_digest_of_a_new_folder(flown, tmp_path):
    before, stored = read_manifest(flown / "manifest.json"), read_flown(flown).flights
    (flown / "notes.txt").write_text("mine")
    (flown / "replayed").mkdir()
    request = write_campaign(tmp_path, "swing")
    manifest = run_campaign(request).manifest
    new = run_campaign(replace(request, output=tmp_path / "new")).manifest
    assert manifest.digest == new.digest != before.digest
    assert manifest.earlier_digests == (before.digest,) and new.earlier_digests is None
    for name, flights in read_flown(flown).flights.items():
        assert flights.metrics["miss"].tobytes() == stored[name].metrics["miss"].tobytes()
        assert "swing" in flights.metrics and "swing" not in stored[name].metrics
    assert (flown / "notes.txt").read_text() == "mine" and (flown / "replayed").is_dir()
    assert {path.name for path in tmp_path.iterdir()} == {"out", "new", "sim.py", "study.yaml"}


def test_a_limit_changed_with_the_metrics_leaves_its_trail(flown, tmp_path):
    manifest = run_campaign(write_campaign(tmp_path, "swing", limit=4.0)).manifest
    assert [item.flights for item in manifest.requirement_sets] == [0, 60]
    (change,) = read_flown(flown).requirement_changes
    assert str(change) == "miss: below 3.0 -> 4.0"


@pytest.mark.parametrize("metrics", [("swing",), ()])
@pytest.mark.parametrize("change", [" - 0.001", " * (1.0 + 1e-12)"])
def test_flights_with_other_values_or_without_a_metric_are_rejected(
    flown, tmp_path, metrics, change
):
    """A changed simulator without added values is another campaign, of which nothing is run."""
    before = (flown / "manifest.json").read_bytes()
    other = SIMULATOR.replace('abs(inputs["a"])', f'abs(inputs["a"]{change})')
    with pytest.raises(InputError, match="miss" if metrics else r"different content.*"):
        run_campaign(write_campaign(tmp_path, *metrics, simulator=other))
    assert (flown / "manifest.json").read_bytes() == before


def test_flights_with_another_outcome_are_rejected(tmp_path):
    lost = SIMULATOR.replace("in METRICS}", 'in METRICS} | {"outcome": "lost"}')
    run_campaign(write_campaign(tmp_path, simulator=lost))
    with pytest.raises(InputError, match="does not repeat"):
        run_campaign(write_campaign(tmp_path, "swing", simulator=lost.replace("lost", "hit")))


def test_an_interrupt_keeps_the_stored_folder_and_the_flights_run_again(
    flown, tmp_path, monkeypatch
):
    before = (flown / "manifest.json").read_bytes()
    request, keep, blocks = write_campaign(tmp_path, "swing"), runner._Run._keep, []

    def interrupt(self, *arguments):
        keep(self, *arguments)
        blocks.append(arguments)
        if len(blocks) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(runner._Run, "_keep", interrupt)
    assert not run_campaign(request).complete
    assert (flown / "manifest.json").read_bytes() == before
    assert np.all(read_flown(flown).flights["first"].flight == np.arange(60))
    assert run_campaign(request).complete and len(blocks) > 2
    assert read_manifest(flown / "manifest.json").earlier_digests


def test_values_of_a_simulator_that_rounds_are_repeated_up_to_rounding(tmp_path):
    noise = "import os, random\nROUND = 1.0 + 1e-12 * random.Random(os.getpid()).random()\n"
    simulator = noise + SIMULATOR.replace('settings["bias"]', 'settings["bias"] * ROUND')
    first = run_campaign(write_campaign(tmp_path, simulator=simulator)).manifest
    assert first.repeatable == "rounding"
    manifest = run_campaign(write_campaign(tmp_path, "swing", simulator=simulator)).manifest
    assert manifest.complete and manifest.earlier_digests == (first.digest,)


def test_values_are_added_only_to_complete_campaigns_of_the_same_systems(flown, tmp_path):
    path = flown / "manifest.json"
    request = write_campaign(tmp_path, "swing")
    study = tmp_path / "study.yaml"
    text = study.read_text()
    study.write_text(json.dumps({**json.loads(text), "systems": {"first": {"bias": 0.0}}}))
    with pytest.raises(InputError, match="other inputs"):
        run_campaign(request)
    study.write_text(text)
    write_manifest(path, replace(read_manifest(path), state="interrupted"))
    with pytest.raises(InputError, match="other inputs"):
        run_campaign(request)
    write_manifest(path, replace(read_manifest(path), state="complete"))
    assert run_campaign(request).complete
