"""A campaign's folder on a disk that is small or may only be read: told in words, nothing lost.

Needs the rights of root; without them these tests are skipped, and the shims of tests/campaign/run stand alone.
"""

import shutil
import subprocess
import sys

import pytest
from fake_flight import ENGINE, write_campaign

from abhv_mc.cli.app import main
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.manifest import read_manifest


def mount(*words):
    return subprocess.run(["mount", *map(str, words)], capture_output=True, check=False).returncode == 0


@pytest.fixture
def disk(tmp_path):
    """A file system of 400 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    if not (shutil.which("mount") and mount("-t", "tmpfs", "-o", "size=400k", "tmpfs", place)):
        pytest.skip("no right to mount")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


@pytest.fixture
def call(monkeypatch, capfd, tmp_path):
    for place in ("runner", "engine"):
        monkeypatch.setattr(f"abhv_mc.execution.{place}.make_engine", lambda: ENGINE)
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["abhv-mc", *map(str, words)])
        with pytest.raises(SystemExit) as caught:
            main()
        said = "".join(capfd.readouterr())
        assert "Traceback" not in said, said
        return caught.value.code or 0, said

    return run


def fly(tmp_path, folder):
    campaign = write_campaign(tmp_path / "f", runs="200", execution="{workers: 2, batch: 16}")
    return campaign, run_campaign(Request(campaign, folder), ENGINE)


def test_a_small_disk_keeps_what_was_flown_and_goes_on_when_there_is_room(disk, call, tmp_path):
    campaign, whole = fly(tmp_path, tmp_path / "whole")
    code, said = call("run", campaign, "-o", disk / "out", "--no-report")
    assert code == 3 and "no space left" in said
    assert mount("-o", "remount,size=20m", disk)
    code, said = call("run", campaign, "-o", disk / "out", "--no-report")
    assert code in (0, 1), said
    assert read_manifest(disk / "out/manifest.json")["digest"] == whole.manifest["digest"]
    assert mount("-o", f"remount,size={shutil.disk_usage(disk).used // 1024 + 64}k", disk)
    writing = [
        ("report", disk / "out"),
        ("export", disk / "out"),
        ("replay", disk / "out", "--flight", 3, "--controller", "one", "-o", disk / "h.parquet"),
        ("run", campaign, "-o", disk / "more", "--no-report"),
    ]
    for words in writing:
        code, said = call(*words)
        assert (code == 3 and "no space left" in said) or code == 0, (words, code, said)
    assert mount("-o", "remount,size=40m", disk)
    assert call("report", disk / "out")[0] == 0 and call("verify", "campaign", disk / "out")[0] == 0


def read_only(campaign, folder):
    """Commands with whether a folder that takes nothing stops them."""
    yield ("status", folder), False
    yield ("list", "campaigns", folder.parent), False
    yield ("query", folder, "select count(*) from flights"), False
    yield ("verify", "campaign", folder), False
    yield ("compare", folder, folder), False
    yield ("replay", folder, "--flight", 3, "--controller", "one"), False
    yield ("export", folder, "-o", "csv"), False
    yield ("report", folder, "-o", "elsewhere"), True  # it is made in the folder first
    yield ("report", folder), True
    yield ("export", folder), True
    yield ("run", campaign, "-o", folder), True
    yield ("run", campaign, "-o", folder, "--fresh"), True
    yield ("replay", folder, "--flight", 3, "--controller", "one", "-o", folder / "mine.parquet"), True


def check_commands(call, campaign, folder):
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for words, stopped in read_only(campaign, folder):
        code, said = call(*words)
        assert (code == 2 and "cannot be written" in said) if stopped else code == 0, (words, code, said)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_disk_that_may_only_be_read(disk, call, tmp_path):
    assert mount("-o", "remount,size=40m", disk)
    campaign, _ = fly(tmp_path, disk / "out")
    assert call("report", disk / "out")[0] == 0
    assert mount("-o", "remount,ro", disk)
    check_commands(call, campaign, disk / "out")
