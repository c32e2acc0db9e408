"""Any file of a campaign's folder cut short, altered or gone: the same command mends it, or says what to do."""

import shutil
from dataclasses import replace

import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, fly, write_campaign

from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder import envelope_states as collector
from abhv_mc.io.input_error import InputError

DAMAGES = {
    "cut short": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "altered": lambda path: path.write_bytes(flip(path.read_bytes())),
    "gone": lambda path: path.unlink(),
}
KEEP = "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: [altitude_m, bank_deg]}}"


def flip(content):
    """Eight bytes in the middle."""
    middle = len(content) // 3
    return content[:middle] + bytes(byte ^ 0xFF for byte in content[middle : middle + 8]) + content[middle + 8 :]


def interrupted_after(number):
    count = iter(range(10_000))

    def some(plan, parameters, every=None):
        if next(count) >= number:
            raise KeyboardInterrupt
        return fly(plan, parameters, every)

    return replace(ENGINE, fly=some)


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize(
    ("exact", "complete"), [(4096, False), (0, False), (4096, True)], ids=["exact", "histograms", "complete"]
)
def test_a_damaged_file_is_mended_or_explained(tmp_path, exact, complete, damage, monkeypatch, capfd):
    monkeypatch.setattr(collector, "EXACT_FLIGHTS", exact)
    campaign = write_campaign(tmp_path / "f", runs="120", keep=KEEP, execution="{batch: 30}")
    whole = run_campaign(Request(campaign, tmp_path / "whole"), ENGINE).manifest
    run_campaign(Request(campaign, tmp_path / "base"), ENGINE if complete else interrupted_after(8))
    files = [path.relative_to(tmp_path / "base") for path in sorted((tmp_path / "base").rglob("*")) if path.is_file()]
    explained = {}
    for file in files:
        out = tmp_path / "out"
        shutil.copytree(tmp_path / "base", out)
        DAMAGES[damage](out / file)
        try:
            result = run_campaign(Request(campaign, out), ENGINE)
        except InputError as error:
            explained[file.as_posix()] = str(error)
            result = run_campaign(Request(campaign, out, fresh=True), ENGINE)
        assert result.complete and result.manifest["digest"] == whole["digest"], file
        for name in ("envelopes.parquet", "samples.parquet"):
            assert pq.read_table(out / name).equals(pq.read_table(tmp_path / "whole" / name)), (file, name)
        for path in (tmp_path / "whole/inputs").rglob("*.yaml"):
            assert path.read_bytes() == (out / path.relative_to(tmp_path / "whole")).read_bytes(), file
        shutil.rmtree(out)
    assert any(file.parts[0] == "flights" for file in files)
    assert any(file.parts[0] == "histories" if complete else file.parts[0] == "envelope_states" for file in files)
    # What nothing else in the folder tells, and another machine might compute otherwise.
    assert all("--fresh" in said for said in explained.values())
    assert explained.keys() <= {"manifest.json", "plans/one.npz", "plans/two.npz"}


@pytest.mark.parametrize("damage", ["cut short", "altered"])
def test_damaged_states_are_left_out_where_blocks_have_another_size_now(tmp_path, damage, capfd):
    campaign = write_campaign(tmp_path / "f", runs="120", keep=KEEP, execution="{batch: 60}")
    run_campaign(Request(campaign, tmp_path / "whole"), ENGINE)
    run_campaign(Request(campaign, tmp_path / "out"), interrupted_after(6))  # both nominal flights, four blocks
    for path in (tmp_path / "out/envelope_states").rglob("*.npy"):
        DAMAGES[damage](path)
    write_campaign(tmp_path / "f", runs="120", keep=KEEP, execution="{batch: 48}")
    assert run_campaign(Request(campaign, tmp_path / "out"), ENGINE).complete
    tables = [pq.read_table(tmp_path / out / "envelopes.parquet") for out in ("whole", "out")]
    assert tables[0].equals(tables[1])


def test_damaged_histories_of_a_complete_campaign_are_flown_again(tmp_path, capfd):
    campaign = write_campaign(tmp_path / "f", runs="120", keep=KEEP)
    run_campaign(Request(campaign, tmp_path / "out"), ENGINE)
    path = tmp_path / "out/histories/two-000000.parquet"
    table = pq.read_table(path)
    DAMAGES["cut short"](path)
    flown = []

    def fly_noting(plan, parameters, every=None):
        flown.append((plan.controller, len(parameters)))
        return fly(plan, parameters, every)

    assert run_campaign(Request(campaign, tmp_path / "out"), replace(ENGINE, fly=fly_noting)).complete
    assert pq.read_table(path).equals(table)
    assert flown == [("two", 3)]
