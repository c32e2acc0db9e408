"""Damaged files of a folder: flights are run again, other files are named in errors."""

import shutil
from dataclasses import replace

import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, fly, interrupted_after, run, write_campaign

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.hashes import read_checked
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.messages import InputError

KEEP = (
    "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: "
    "[altitude_m, bank_deg]}}"
)


def flip_a_bit(path):
    content = path.read_bytes()
    i = len(content) // 3
    path.write_bytes(content[:i] + bytes([content[i] ^ 16]) + content[i + 1 :])


ENTRIES = {"runs": "120", "keep": KEEP, "execution": "{batch: 30}"}


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return run(write_campaign(folder / "f", **ENTRIES), folder / "out")


GONE = pytest.param(lambda path: path.unlink(), id="gone", marks=pytest.mark.thorough)


@pytest.mark.parametrize("damage", [pytest.param(flip_a_bit, id="a flipped bit"), GONE])
@pytest.mark.parametrize(
    "complete",
    [
        pytest.param(False, id="interrupted"),
        pytest.param(True, id="complete", marks=pytest.mark.thorough),
    ],
)
def test_damaged_flights_are_run_again_and_other_damage_is_reported(
    flown, tmp_path, complete, damage, capfd
):
    campaign, reference = write_campaign(tmp_path / "f", **ENTRIES), flown.manifest
    run(campaign, tmp_path / "base", ENGINE if complete else interrupted_after(8))
    files = [
        path.relative_to(tmp_path / "base")
        for path in sorted((tmp_path / "base").rglob("*"))
        if path.is_file()
    ]
    again = set()
    for file in files:
        out = tmp_path / "out"
        shutil.copytree(tmp_path / "base", out)
        damage(out / file)
        if file.name == "manifest.json" and not (out / file).exists():
            with pytest.raises(InputError, match="--fresh"):
                run(campaign, out)
        elif file.parts[0] in ("flights", "envelope_states", ".lock"):
            again.add(file.parts[0])
            result = run(campaign, out)
            assert result.complete and result.manifest.digest == reference.digest, file
            for name in ("envelopes.parquet", "histories/one-000000.parquet"):
                assert pq.read_table(out / name).equals(pq.read_table(flown.folder / name)), (
                    file,
                    name,
                )
        else:
            with pytest.raises(InputError, match=f"{file}: .*--fresh"):
                run(campaign, out)
            with pytest.raises(InputError, match=str(file)):
                read_checked(CampaignFolder(out))
            if file.name in ("manifest.json", "campaign.yaml"):
                assert run(campaign, out, fresh=True).manifest.digest == reference.digest
        shutil.rmtree(out)
    assert again == {"flights", ".lock"} | (set() if complete else {"envelope_states"})


def test_a_block_with_an_uncomputed_flight_is_run_again(flown, tmp_path, capfd):
    def fail(plan, parameters, every=None):
        block = fly(plan, parameters, every)
        if len(parameters) == 30:  # a block of the campaign, not trials
            block.outcome[1] = Outcome.FAILED_TO_RUN
        return block

    campaign, reference = write_campaign(tmp_path / "f", **ENTRIES), flown.manifest
    first = run(campaign, tmp_path / "out", replace(ENGINE, fly=fail)).manifest
    assert first.runs_failed == 4 and first.digest != reference.digest
    again = run(campaign, tmp_path / "out").manifest
    assert again.runs_failed == 0 and again.digest == reference.digest
    assert pq.read_table(tmp_path / "out/envelopes.parquet").equals(
        pq.read_table(flown.folder / "envelopes.parquet")
    )


def test_a_folder_of_another_format_is_rejected(flown, tmp_path, capfd):
    campaign = write_campaign(tmp_path / "f", **ENTRIES)
    path = shutil.copytree(flown.folder, tmp_path / "out") / "manifest.json"
    path.write_text(path.read_text().replace('"format": 4,', '"format": 2,'))
    for read in (lambda: run(campaign, tmp_path / "out"),
                 lambda: read_checked(CampaignFolder(tmp_path / "out"))):  # fmt: skip
        with pytest.raises(InputError, match="written by another version"):
            read()
    assert run(campaign, tmp_path / "out", fresh=True).complete
