"""Tests of the command and the executor of the how-to page on packages."""

import sys
from importlib.metadata import EntryPoint

import pytest
import typer
from fake_flight import run, write_campaign
from typer.testing import CliRunner

from abhv_mc.execution import executor
from abhv_mc.io.messages import InputError


@pytest.fixture
def how_to(repository, monkeypatch):
    monkeypatch.syspath_prepend(str(repository / "docs/how-to"))
    entry = EntryPoint("pool", "futures:connect", "abhv_mc.executors")
    monkeypatch.setattr(executor, "find_entry_points", lambda _: {"pool": entry})
    yield
    for name in ("largest", "futures"):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("how_to")
def test_the_executor_gives_the_same_digest_and_the_command_the_largest_values(tmp_path):
    campaign = write_campaign(tmp_path / "inputs", runs="64")
    local = run(campaign, tmp_path / "whole")
    pooled = run(campaign, tmp_path / "pooled", scheduler="pool://2")
    assert pooled.complete and pooled.manifest.digest == local.manifest.digest
    with pytest.raises(InputError, match="pool://NUMBER"):
        run(campaign, tmp_path / "none", scheduler="pool://many")
    assert not (tmp_path / "none").exists()

    from largest import largest

    command = typer.Typer()
    command.command()(largest)
    metric = "altitude_error_max_m"
    result = CliRunner().invoke(command, [str(tmp_path / "pooled"), metric, "--number", "3"])
    assert result.exit_code == 0, result
    values = [float(line.split()[-1]) for line in result.stdout.splitlines()[1:]]
    assert len(values) == 3 and values == sorted(values, reverse=True)
