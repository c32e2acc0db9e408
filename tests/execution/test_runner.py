"""Results do not depend on how a campaign is run, and completed flights are never lost."""

import errno
import json
import os
import re
import shutil
import signal
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import DENSITY, ENGINE, fly, interrupted_after, make_plan, run, write_campaign
from golden import compare_report
from own_simulators import write_study
from programs import run_python

from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution import runner
from abhv_mc.execution.retention import select_flights
from abhv_mc.execution.runner import run_campaign
from abhv_mc.external_simulators.simulator import ExternalSimulator
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder import envelope_states as collector
from abhv_mc.folder.hashes import find_damage
from abhv_mc.folder.layout import CampaignFolder, StorageFullError
from abhv_mc.io.messages import InputError
from abhv_mc.requests import Request
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.plant.parameters import OURS


@pytest.fixture
def campaign(tmp_path):
    return write_campaign(tmp_path / "files")


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Return the result of 300 flights that no test changes; the campaign's files are deleted."""
    folder = tmp_path_factory.mktemp("whole")
    result = run(write_campaign(folder / "files"), folder / "out")
    shutil.rmtree(folder / "files")
    return result


@pytest.fixture
def flown(reference, tmp_path):
    """Return a copy of the reference folder."""
    return shutil.copytree(reference.folder, tmp_path / "out")


def flights(folder):
    table = pq.read_table(folder / "flights")
    return table.sort_by([("controller", "ascending"), ("flight", "ascending")])


def test_the_content_of_a_folder(reference):
    assert reference.complete and reference.manifest.runs_done == 300
    table = flights(reference.folder)
    assert table.num_rows == 600
    leading = ["flight", "controller", "outcome", "reason", "failure.case"]
    assert table.column_names[:7] == [*leading, "atmosphere.density", "aero.lift"]
    samples = pq.read_table(reference.folder / "samples.parquet")
    for name in ("atmosphere.density", "aero.lift"):
        np.testing.assert_array_equal(table[name].to_numpy()[:300], samples[name].to_numpy())
    assert table.schema.field("speed_error_max_mps").metadata[b"unit"] == b"m/s"
    outcomes = reference.manifest.controllers["one"].outcomes
    lost = int((samples["atmosphere.density"].to_numpy() < 0.91).sum())
    assert outcomes == {"ok": 300 - lost, "sideslip_limit": lost}
    verdict = reference.manifest.requirements[0]
    assert (verdict.failures, verdict.failures_ended_early, verdict.failures_measured) == (
        lost,
        lost,
        0,
    )


@pytest.mark.parametrize(
    "execution", ["{workers: 1}", "{workers: 3}", "{batch: 16}", "{batch: 1000}"]
)
def test_digest_and_envelopes_do_not_depend_on_workers_and_blocks(reference, tmp_path, execution):
    other = run(write_campaign(tmp_path / "f", execution=execution), tmp_path / "b")
    assert (
        other.manifest.digests == reference.manifest.digests
        and other.manifest.digest == reference.manifest.digest
    )
    tables = [pq.read_table(result.folder / "envelopes.parquet") for result in (reference, other)]
    assert tables[0].equals(tables[1])


def test_no_run_imports_pandas(campaign, tmp_path):
    """Some calls of pyarrow import pandas, which takes a fifth of a run without new flights."""
    code = f"""
import sys
from pathlib import Path
from types import SimpleNamespace
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from fake_flight import run
from abhv_mc.folder.flown_campaign import read_flown
out = Path({str(tmp_path / "out")!r})
for _ in range(2):
    assert run(Path({str(campaign)!r}), out).complete
read_flown(out).ranking
print("pandas" in sys.modules)
"""
    ended = run_python("-c", code)
    assert ended.stdout == "False\n", ended.stderr


def test_an_interrupt_keeps_finished_blocks_and_the_run_resumes(reference, campaign, tmp_path):
    first = run(campaign, tmp_path / "b", interrupted_after(6), workers=1)
    assert first.manifest.state == "interrupted"
    flights_done = sum(facts.flights_done for facts in first.manifest.controllers.values())
    assert 128 <= flights_done < 600
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "b/flights").iterdir()}
    second = run(campaign, tmp_path / "b")
    assert second.complete and second.manifest.digest == reference.manifest.digest
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "b/flights").iterdir()}
    assert before.items() <= after.items()  # no block was computed twice
    names = ["envelopes.parquet", *(f"histories/{name}-000000.parquet" for name in ("one", "two"))]
    for name in names:
        assert pq.read_table(reference.folder / name).equals(pq.read_table(tmp_path / "b" / name))


def test_envelopes_contain_the_first_flights(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr(collector, "ENVELOPE_FLIGHTS", 100)
    few = run(campaign, tmp_path / "few", runs=100).folder / "envelopes.parquet"
    campaign = write_campaign(tmp_path / "files", execution="{batch: 16}")
    many = run(campaign, tmp_path / "many").folder / "envelopes.parquet"
    assert (
        pq.read_table(few).equals(pq.read_table(many))
        and pq.read_table(few)["count"].to_numpy().max() == 100
    )
    assert pq.read_schema(many).metadata[b"flights"] == b"100"
    before = many.stat().st_mtime_ns
    run(campaign, tmp_path / "many", runs=400)
    assert many.stat().st_mtime_ns == before  # more flights do not change envelopes


def test_extending_keeps_flights_bit_for_bit(reference, campaign, tmp_path):
    run(campaign, tmp_path / "out", runs=100)
    before = flights(tmp_path / "out")
    result = run(campaign, tmp_path / "out", runs=300)
    after = flights(tmp_path / "out")
    mask = np.tile(np.arange(300) < 100, 2)
    assert after.filter(mask).equals(before)
    assert result.manifest.digest == reference.manifest.digest
    tables = [
        pq.read_table(folder / "envelopes.parquet") for folder in (result.folder, reference.folder)
    ]
    assert tables[0].equals(tables[1])


def test_fewer_flights_and_stratified_extensions_are_rejected(tmp_path):
    campaign = write_campaign(tmp_path / "files", sampling="lhs")
    run(campaign, tmp_path / "out", runs=100)
    for runs in (50, 200):
        with pytest.raises(InputError, match=f"runs: 100 -> {runs}"):
            run(campaign, tmp_path / "out", runs=runs)


def test_requirements_of_controllers_that_run_one_after_the_other(tmp_path):
    """Requirements must not be stored twice, which would double the pairs of the family."""
    limits = "probability: 0.9, consumer_risk: 0.1"
    requirements = (
        f"[{{metric: altitude_error_max_m, below: 1.6, {limits}, controllers: [one, two]}},"
        f" {{metric: altitude_error_max_m, below: 1.7, {limits}, controllers: [two]}},"
        f" {{metric: altitude_error_max_m, below: 1.8, {limits}, controllers: [one]}},"
        f" {{metric: altitude_error_max_m, below: 1.9, {limits}}}]"
    )
    campaign = write_campaign(
        tmp_path / "f",
        runs="60",
        requirements=requirements,
        family="{method: holm, risk: 0.10}",
        under_test="[one, two]",
    )
    reference = run(campaign, tmp_path / "whole").manifest

    def pairs(manifest):
        return sorted(repr(entry) for entry in manifest.requirements)

    orders = [("one",), ("two",), ("one",), None], [("two",), ("one",), ("two",)]
    for i, order in enumerate(orders):
        out = tmp_path / f"{i}"
        for names in (*order, order[-1], None):
            flown = run(campaign, out, controllers=names)
            assert flown.complete
        assert pairs(flown.manifest) == pairs(reference), order
        assert flown.manifest.digest == reference.digest
    assert run(campaign, tmp_path / "0", runs=90).complete


def test_requirements_without_controllers_bind_those_under_test(campaign, tmp_path):
    def judged(file, out, **options):
        result = run(file, tmp_path / out, **options)
        damage = find_damage(CampaignFolder(result.folder), result.manifest)
        assert result.complete and not [*damage]
        return [entry.controller for entry in result.manifest.requirements]

    two = write_campaign(tmp_path / "two", under_test="[two]")
    both = write_campaign(tmp_path / "both", under_test="")
    assert judged(campaign, "a") == ["one"] and judged(two, "a") == ["two"]
    assert judged(both, "a", controllers=("one",)) == ["one", "two"]
    with pytest.raises(InputError, match=r"'one'.* 'two'"):
        run(two, tmp_path / "a", controllers=("one",))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(seed="6"), "seed: 5 -> 6"),
        (
            dict(dispersions="{aero.lift: {distribution: normal, sigma: 6 %}}"),
            'sigma: "5 %" -> "6 %"',
        ),
    ],
)
def test_a_changed_campaign_does_not_resume(flown, tmp_path, change, message):
    contents = {p: p.read_bytes() for p in flown.rglob("*") if p.is_file() and p.name != ".lock"}
    with pytest.raises(InputError) as caught:
        run(write_campaign(tmp_path / "files", **change), flown)
    assert message in str(caught.value)
    assert contents == {
        p: p.read_bytes() for p in flown.rglob("*") if p.is_file() and p.name != ".lock"
    }


def test_a_changed_input_file_does_not_resume(campaign, flown):
    (campaign.parent / "tables/cl.csv").write_text("mach,value\n1,3\n2,3\n")
    with pytest.raises(InputError, match=r"inputs/vehicle/tables/cl\.csv: "):
        run(campaign, flown)
    assert run(campaign, flown, fresh=True).complete


def test_other_code_does_not_continue(campaign, tmp_path):
    run(campaign, tmp_path / "out", interrupted_after(5))
    with pytest.raises(InputError, match=r"\bsource .*\bother\b"):
        run(campaign, tmp_path / "out", replace(ENGINE, source="other"))


def test_a_full_disk_keeps_completed_flights(reference, campaign, tmp_path, monkeypatch):
    write, count = runner.write_block, iter(range(1000))

    def full(*arguments):
        if next(count) > 2:
            monkeypatch.setattr(pq.ParquetWriter, "write_table", raise_full)
        return write(*arguments)

    def raise_full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(runner, "write_block", full)
        with pytest.raises(StorageFullError):
            run(campaign, tmp_path / "b")
        assert json.loads((tmp_path / "b/manifest.json").read_text())["state"] == "interrupted"
        assert not list((tmp_path / "b").rglob("*.temporary"))
    monkeypatch.undo()
    assert run(campaign, tmp_path / "b").manifest.digest == reference.manifest.digest


def test_a_folder_with_other_files_is_left_unchanged(campaign, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/thesis.tex").write_text("mine")
    for fresh in (False, True):
        with pytest.raises(InputError, match=r"thesis\.tex"):
            run(campaign, tmp_path / "out", fresh=fresh)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["thesis.tex"]


def test_selected_flights_exist_and_were_computed():
    counts = SimpleNamespace(failed=[3], not_computed=[4])
    items = (1, 9, "every 2", "failed", "worst 1")
    assert select_flights(items, 6, counts, worst=(5, 3)) == [0, 1, 2, 3, 5]


def test_kept_histories_are_the_worst_and_selected_flights(reference):
    rows = flights(reference.folder).slice(0, 300)  # controller one
    early = np.array(rows["outcome"].to_pylist()) != "ok"
    metric = rows["altitude_error_max_m"].to_numpy()
    worst = np.lexsort([np.arange(300), np.where(early, 0.0, -metric), ~early])[
        :5
    ]  # all early terminations are at the same time
    table = pq.read_table(reference.folder / "histories/one-000000.parquet")
    assert sorted(set(table["flight"].to_pylist())) == sorted({7, *worst.tolist()})
    assert str(table.schema.field("altitude_m").type) == "float"
    for flight in set(table["flight"].to_pylist()):
        times = table.filter(np.array(table["flight"]) == flight)["time"].to_numpy()
        assert times[-1] == pytest.approx(rows["end_time_s"].to_numpy()[flight])


@pytest.mark.parametrize(
    ("sampling", "runs", "expected"),
    [("sobol", "64", 64), ("{design: grid, levels: 3}", "null", 9), ("one_at_a_time", "null", 5)],
)
def test_designs_run(tmp_path, sampling, runs, expected):
    keep = "{histories: {flights: every 3}}"
    campaign = write_campaign(tmp_path / "files", sampling=sampling, keep=keep, runs=runs)
    manifest = run(campaign, tmp_path / "out").manifest
    assert manifest.runs_done == manifest.runs_planned == expected
    assert manifest.requirements[0].verdict == "ESTIMATE"


def test_samples_from_a_file_are_used_unchanged(tmp_path):
    entries = {"sampling": "{design: file, path: given.csv}", "dispersions": "{}", "runs": "3"}
    campaign = write_campaign(tmp_path / "files", keep="{histories: {flights: all}}", **entries)
    (campaign.parent / "given.csv").write_text("flight,aero.drag\n0,0.9\n1,1.1\n2,1.2\n")
    run(campaign, tmp_path / "out")
    table = flights(tmp_path / "out")
    assert table["aero.drag"].to_pylist() == [0.9, 1.1, 1.2] * 2
    block = fly(
        make_plan("one"), full_rows(("aero.drag",), np.array([[0.9], [1.1], [1.2]]), (), OURS)
    )
    expected = block.metrics[:, METRIC_INDEX["altitude_error_max_m"]].tolist()
    assert table["altitude_error_max_m"].to_pylist()[:3] == expected


def test_envelopes_equal_numpys_quantiles(tmp_path):
    keep = (
        "{histories: {flights: all, rate: 5 Hz}, envelopes: {rate: 5 Hz, channels: "
        "[bank_deg, altitude_m]}}"
    )
    run(write_campaign(tmp_path / "files", keep=keep), tmp_path / "out")
    files = sorted((tmp_path / "out/histories").glob("two-*"))
    tables = [pq.read_table(path).to_pandas() for path in files]
    envelope = pq.read_table(tmp_path / "out/envelopes.parquet").to_pandas()
    for channel in ("bank_deg", "altitude_m"):
        rows = envelope[(envelope.controller == "two") & (envelope.channel == channel)]
        for _, row in rows.iterrows():
            values = np.concatenate(
                [t[np.isclose(t.time, row.time)][channel].to_numpy() for t in tables]
            )
            assert row["count"] == len(values)
            expected = np.quantile(values.astype(float), [0, 0.00135, 0.05, 0.5, 0.95, 0.99865, 1])
            computed = row[["min", "q0.135", "q5", "q50", "q95", "q99.865", "max"]].to_numpy(float)
            np.testing.assert_allclose(computed[1:-1], expected[1:-1], rtol=1e-12)
            assert (
                computed[0] <= expected[0] and computed[-1] >= expected[-1]
            )  # envelopes cover every tick, histories samples


def test_fresh_from_the_folders_own_campaign_file(reference, flown):
    """The inputs are read before `--fresh` deletes them with the folder's content."""
    again = run(flown / "campaign.yaml", flown, fresh=True)
    assert again.complete and again.manifest.digest == reference.manifest.digest
    assert (flown / "inputs/vehicle/tables/cl.csv").exists()


def test_a_folder_of_a_linked_vehicle_can_be_run_again(reference, tmp_path):
    """Regression: tables beside a link were stored relative to the file to which it points."""
    path = write_campaign(tmp_path / "inputs")
    (tmp_path / "elsewhere").mkdir()
    (path.parent / "vehicle.yaml").rename(tmp_path / "elsewhere/brick.yaml")
    (path.parent / "vehicle.yaml").symlink_to(tmp_path / "elsewhere/brick.yaml")
    first = run(path, tmp_path / "out")
    again = run(tmp_path / "out/campaign.yaml", tmp_path / "again")
    assert first.manifest.digest == again.manifest.digest == reference.manifest.digest


def test_a_slow_disk_does_not_fill_the_memory(campaign, tmp_path, monkeypatch):
    """The number of blocks in memory is limited by the workers, not by the campaign."""
    flying, most = [0], [0]

    def count(plan, parameters, every=None):
        flying[0] += 1
        most[0] = max(most[0], flying[0])
        return fly(plan, parameters, every)

    write = runner.write_block

    def slow(*arguments):
        time.sleep(0.01)
        flying[0] -= 1
        return write(*arguments)

    monkeypatch.setattr(runner, "write_block", slow)
    monkeypatch.setattr(runner, "write_kept_histories", lambda *_: [])
    campaign = write_campaign(tmp_path / "files", execution="{batch: 16}")
    trials = 2
    run(campaign, tmp_path / "out", replace(ENGINE, fly=count), workers=2)
    assert most[0] - trials <= 2 * 2 + 2


def fly_never(plan, parameters, every=None):
    time.sleep(3600.0 * len(parameters))


def fly_never_and_interrupt(plan, parameters, every=None):
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(3600.0)


def test_endless_first_flights_are_rejected_and_interruptible(tmp_path):
    campaign = write_campaign(tmp_path / "f")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run(campaign, tmp_path / "out", replace(ENGINE, fly=fly_never_and_interrupt))
    finally:
        signal.signal(signal.SIGINT, before)
    campaign = write_campaign(tmp_path / "f", execution="{flight_time_limit: 0.1 s}")
    with pytest.raises(InputError, match=r"trial flights of 'one' .*\b0\.1 s"):
        run(campaign, tmp_path / "out", replace(ENGINE, fly=fly_never))
    assert not (tmp_path / "out").exists()


def test_the_numbers_of_run_and_merged_campaigns_are_the_stored_ones(tmp_path):
    assert not compare_report("campaigns", tmp_path)


def test_a_lost_history_is_made_by_the_next_run(campaign, reference, tmp_path, capfd):
    """The flight itself stays; only the file of its controller is written again."""
    losing = [True]

    def lose(plan, parameters, recorded=None):
        block = fly(plan, parameters, recorded)
        is_history = isinstance(recorded, int) and recorded > 0 and 0 < len(parameters) < 7
        if losing and is_history and plan.controller == "two":
            block.outcome[stored.index(7)] = Outcome.FAILED_TO_RUN
        return block

    out = tmp_path / "out"
    table = pq.read_table(reference.folder / "histories/two-000000.parquet")
    stored = sorted(set(table["flight"].to_pylist()))
    first = run(campaign, out, replace(ENGINE, fly=lose)).manifest
    (message,) = first.not_made
    assert "flight 7 " in message and "'two'" in message and message in capfd.readouterr().err
    before = {path.name: path.stat().st_mtime_ns for path in (out / "histories").iterdir()}
    losing.clear()
    second = run(campaign, out, replace(ENGINE, fly=lose)).manifest
    assert second.not_made == () and second.digest == first.digest == reference.manifest.digest
    after = {path.name: path.stat().st_mtime_ns for path in (out / "histories").iterdir()}
    assert [name.partition("-")[0] for name in after if after[name] != before[name]] == ["two"]
    for name in after:
        tables = [pq.read_table(root / "histories" / name) for root in (out, reference.folder)]
        assert tables[0].equals(tables[1])


def test_a_shard_has_its_flights_and_no_products(campaign, tmp_path):
    manifest = run(campaign, tmp_path / "out", shard=(2, 3)).manifest
    assert (manifest.runs_planned, manifest.runs_done, manifest.shard) == (100, 100, (2, 3))
    assert manifest.requirements == () and manifest.stopped_at is None
    assert set(flights(tmp_path / "out")["flight"].to_pylist()) == {*range(100, 200)}
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert not names & {"envelopes.parquet", "histories"}
    assert run(campaign, tmp_path / "out", shard=(2, 3)).manifest == manifest


@pytest.mark.parametrize(("seconds", "blocks"), [(0.0, [1, 1, 4, 4, *[5] * 6]), (5.0, [2] * 20)])
def test_blocks_of_slow_simulators_follow_the_time_of_a_flight(
    tmp_path, monkeypatch, seconds, blocks
):
    """While no flight has been timed, the first of each system is flown alone."""
    sizes, keep = [], runner._Run._keep

    def note(self, block, flown):
        sizes.append(block.flights)
        keep(self, block, flown)

    path = write_study(
        tmp_path,
        "def fly(inputs, settings):\n    return {'total': inputs['a'] + inputs['b']}\n",
        systems={"one": {}, "two": {}},
        runs=20,
    )
    monkeypatch.setattr(runner._Run, "_keep", note)
    monkeypatch.setattr(ExternalSimulator, "time_of_flight", lambda *_: seconds)
    manifest = run_campaign(Request(path, tmp_path / "out", workers=1)).manifest
    assert manifest.complete and manifest.runs_done == 20
    table = flights(tmp_path / "out")
    assert table["flight"].to_pylist() == [*range(20)] * 2
    assert sizes == blocks


def test_flights_that_fail_to_run_are_named_and_counted(tmp_path, capfd):
    def lose(plan, parameters, recorded=None):
        block = fly(plan, parameters, recorded)
        if plan.controller == "two" and len(parameters) != 7:  # not the trials
            block.outcome[parameters[:, DENSITY] > 1.09] = Outcome.FAILED_TO_RUN
        return block

    keep, limit = "{histories: {flights: []}}", "[]"
    campaign = write_campaign(tmp_path / "f", runs="60", keep=keep, requirements=limit)
    result = run(campaign, tmp_path / "out", replace(ENGINE, fly=lose), workers=1)
    density = pq.read_table(result.folder / "samples.parquet")["atmosphere.density"].to_numpy()
    lost = np.flatnonzero(density > 1.09).tolist()
    counts = result.manifest.controllers
    assert counts["two"].failed_to_run == (*lost,) and counts["one"].failed_to_run is None
    assert (result.manifest.runs_done, result.manifest.runs_failed) == (60 - len(lost), len(lost))
    named = re.findall(r"flight (\d+) of controller '(\w+)'", capfd.readouterr().err)
    assert named == [(str(number), "two") for number in lost] != []
