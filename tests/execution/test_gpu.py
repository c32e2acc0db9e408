"""Campaigns on a GPU: refused without one, marked where flown on one, and never mixed with the processor's."""

from dataclasses import replace

import pytest
from fake_flight import ENGINE, fly, prepare, write_campaign

from abhv_mc.execution.gpu import make_gpu_engine
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.io.documents import InputError
from abhv_mc.jit_cuda import cuda


@pytest.fixture
def gpu(monkeypatch):
    """The engine of a GPU that is not there, with cheap flights."""
    monkeypatch.setattr("abhv_mc.jit_cuda.find_device", lambda: "NVIDIA Test")
    return replace(make_gpu_engine(), prepare=prepare, fly=fly, find_stability=None)


def test_a_folder_says_what_flew_and_mixes_no_devices(gpu, tmp_path):
    campaign, folder = write_campaign(tmp_path / "files", execution="{batch: auto}"), tmp_path / "out"
    flown = run_campaign(Request(campaign, folder, 300), gpu)
    assert flown.complete
    assert flown.manifest["machine"]["device"] == "NVIDIA Test"
    blocks = list((folder / "flights").glob("*.parquet"))
    assert len(blocks) == len(flown.manifest["controllers"])  # large ones, not the processor's small ones
    with pytest.raises(InputError, match=r"another device .* on NVIDIA Test, now fake on cpu"):
        run_campaign(Request(campaign, folder, 400), ENGINE)
    other = run_campaign(Request(campaign, tmp_path / "cpu", 300), ENGINE)
    assert other.manifest["machine"]["device"] == "cpu"
    assert other.manifest["digest"] == flown.manifest["digest"]  # the same fake flights
    with pytest.raises(InputError, match=r"another device .* on cpu, now .*-gpu on NVIDIA Test"):
        run_campaign(Request(campaign, tmp_path / "cpu", 400), gpu)


@pytest.mark.skipif(cuda.is_available(), reason="this machine has a GPU")
@pytest.mark.parametrize("more", [(), ("--scheduler", "tcp://127.0.0.1:1")])
def test_no_gpu_is_said_before_anything_is_written(more, abhv_mc, tmp_path):
    campaign, folder = write_campaign(tmp_path / "files"), tmp_path / "out"
    code, _, message = abhv_mc("run", campaign, "-o", folder, "--device", "gpu", *more)
    assert code == 2
    assert ("--scheduler" if more else "--device cpu") in message
    assert "Traceback" not in message
    assert not folder.exists()
