"""No command writes over what a campaign's folder holds: every option that names an output refuses it."""

import os
import shutil
import sys
import typing
from pathlib import Path

import pytest
from fake_flight import ENGINE, write_campaign
from typer.models import OptionInfo

from abhv_mc.cli.app import app, main
from abhv_mc.cli.outputs import new_folder
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.layout import find_own_place

NOT_OUTPUTS = {"block", "plans", "references", "file"}  # options that name a file to read


def outputs(group, words=()):
    """The options of all commands that name something to write, each after the command's words, and what they take."""
    for inner in group.registered_groups:
        yield from outputs(inner.typer_instance, (*words, inner.name))
    for command in group.registered_commands:
        for name, hint in typing.get_type_hints(command.callback, include_extras=True).items():
            kind, *infos = typing.get_args(hint) or (hint,)
            options = [info for info in infos if isinstance(info, OptionInfo)]
            if options and Path in (kind, *typing.get_args(kind)) and name not in NOT_OUTPUTS:
                first = options[0].default  # where typer keeps the first name of an annotated option
                option = first if str(first).startswith("--") else f"--{name}"
                yield (*words, command.name, option), options[0].metavar


PLACES = ["manifest.json", "flights", "histories/more/x.parquet", "report.html", "inputs/x", ".lock"]
TAKEN = dict(outputs(app))
OPTIONS = list(TAKEN)
FOLDERS = [words for words, taken in TAKEN.items() if taken == "DIR"]
FILES = [words for words in OPTIONS if words not in FOLDERS]
ADDRESSES = ["s3://bucket/x.npz", "gs:/x/y.npz", "tcp://host:1/x.npz", "file:///tmp/x.npz", "memory://", "s3://"]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    campaign = write_campaign(root / "f", runs="8", keep="{envelopes: {rate: 2 Hz, channels: [altitude_m]}}")
    return run_campaign(Request(campaign, root / "out"), ENGINE).folder


@pytest.fixture
def call(monkeypatch, capfd, flown):
    """Run the program; nothing in the folder is changed."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["abhv-mc", *map(str, words)])
        before = {path: path.read_bytes() for path in flown.rglob("*") if path.is_file()}
        with pytest.raises(SystemExit) as caught:
            main()
        assert {path: path.read_bytes() for path in flown.rglob("*") if path.is_file()} == before
        return caught.value.code, capfd.readouterr().err

    return run


def test_all_commands_are_looked_at():
    assert {words[0] for words in OPTIONS} >= {
        *("run", "merge", "fly", "replay", "worst", "rare", "tune", "report", "explain", "export"),
        *("margins", "linearize", "plan", "verify", "bench"),
    }


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_outputs_keep_away_from_what_is_the_campaigns(call, flown, words, place):
    code, said = call(*words, flown / place)
    assert code == 2 and "a place of the campaign's own files" in said, said


@pytest.mark.parametrize("words", [words for words in OPTIONS if words != ("run", "--output")], ids=" ".join)
def test_an_address_is_not_taken_for_the_name_of_a_file(call, tmp_path, monkeypatch, words):
    """`replay -o file:///tmp/x.parquet` wrote into a new folder `file:`; others ended as a defect, after the flight."""
    monkeypatch.chdir(tmp_path)
    for address in ADDRESSES:
        code, said = call(*words, address)
        assert code == 2 and "an address" in said, (address, said)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_a_home_folder_that_no_shell_has_found_is_refused(call, tmp_path, monkeypatch, words):
    """`--output=~/x` wrote into a folder `~` and flew the samples of another campaign, in the user's home."""
    monkeypatch.chdir(tmp_path)
    for place in ("~/x.npz", "~", "~nobody/x.npz"):
        code, said = call(*words, place)
        assert code == 2 and "begins with '~'" in said, (place, said)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("words", FILES, ids=" ".join)
def test_a_folder_is_no_name_of_a_file(call, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    for place in ("", ".", "..", "/", "none/..", tmp_path):
        code, said = call(*words, place)
        assert code == 2 and "a folder" in said, (place, said)


@pytest.mark.parametrize("words", FOLDERS, ids=" ".join)
def test_a_file_is_no_name_of_a_folder(call, tmp_path, words):
    (tmp_path / "file").touch()
    code, said = call(*words, tmp_path / "file")
    assert code == 2 and "found a file" in said, said


def test_the_root_is_a_folder(monkeypatch):
    monkeypatch.setattr(os, "access", lambda place, mode: True)
    assert new_folder(Path("/")) == Path("/")


@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_nothing_can_be_written_below_a_file(call, tmp_path, words):
    (tmp_path / "file").touch()
    code, said = call(*words, tmp_path / "file/more/x.npz")
    assert code == 2 and "a place below a file" in said, said


@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_a_closed_folder_is_found_before_anything_flies(call, tmp_path, monkeypatch, words):
    monkeypatch.setattr(os, "access", lambda place, mode: not Path(place).samefile(tmp_path))
    code, said = call(*words, tmp_path / "new/x.npz")
    assert code == 2 and "cannot be written" in said, said


@pytest.mark.parametrize("command", ["fly", "report", "export", "margins", "plan"])
def test_folders_of_files_are_not_a_campaigns(call, flown, command):
    """`fly -o` would write its nominal flight over the campaign's."""
    code, said = call(command, "-o", flown)
    assert code == 2 and "own files" in said


def test_neither_through_a_link_nor_a_way_around(call, flown, tmp_path):
    (tmp_path / "link").symlink_to(flown / "flights")
    for out in (tmp_path / "link/x", flown / "csv/../plans", tmp_path / "none/.." / "link"):
        code, said = call("export", flown, "-o", out)
        assert code == 2 and "own files" in said


@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_a_pipe_is_not_replaced_by_a_file(call, tmp_path, words):
    """Nor is /dev/null, where the user may do everything: a new file was renamed into its place."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    for place in ("pipe", "link"):
        code, said = call(*words, tmp_path / place)
        assert code == 2 and "a pipe, socket or device" in said, said
    assert (tmp_path / "pipe").is_fifo() and (tmp_path / "link").is_symlink()


def test_the_page_beside_a_tuned_controller_is_no_campaigns_report(call, flown):
    code, said = call("tune", "campaign.yaml", "-o", flown / "report.yaml")
    assert code == 2 and "own files" in said


@pytest.mark.parametrize(
    "words",
    [
        "plan one.yaml --json one.yaml",
        "plan --json ./one.yaml one.yaml",
        "worst one.yaml --metric x -o new --json one.yaml",
        "worst one.yaml --metric x -o new --json new",
        "margins one.yaml --json one.yaml",
        "tune one.yaml -o new.yaml --json one.yaml",
        "tune one.yaml -o new.yaml --tune two.yaml --json two.yaml",
        "tune one.yaml -o new.yaml --json new.yaml",
        "tune one.yaml -o new.yaml --json new.html",
    ],
)
def test_outputs_keep_away_from_each_other_and_from_what_is_read(call, tmp_path, monkeypatch, words):
    """The campaign file was lost, or the result was not where it had been asked for."""
    monkeypatch.chdir(tmp_path)
    for name in ("one.yaml", "two.yaml"):
        (tmp_path / name).write_text("{}\n", encoding="utf-8")
    code, said = call(*words.split())
    assert code == 2 and "a file that the command reads or writes, too" in said, said
    assert all((tmp_path / name).read_text() == "{}\n" for name in ("one.yaml", "two.yaml"))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("command", ["worst one.yaml --metric x", "rare one.yaml --requirement x"])
def test_the_result_keeps_away_from_what_the_search_is_to_write(call, tmp_path, command, place):
    """`worst -o NEW --json NEW/manifest.json` took the manifest from a search that had just been flown."""
    new = tmp_path / "new"
    code, said = call(*command.split(), "-o", new, "--json", new / place)
    assert code == 2 and "a place of the campaign's own files" in said, said


def test_other_places_are_free(flown, tmp_path):
    copy = shutil.copytree(flown, tmp_path / "copy")
    assert find_own_place(copy) == Path()
    for free in (copy / "csv", copy / "mine.parquet", copy.parent / "flights", tmp_path / "new"):
        assert find_own_place(free) is None
    (copy / "campaign.yaml").unlink()  # a damaged folder is one all the same
    assert find_own_place(copy / "flights/x") == Path("flights/x")
    (tmp_path / "manifest.json").write_text("{}")  # of a web page
    (tmp_path / "figures").mkdir()
    assert find_own_place(tmp_path / "figures/x.png") is None
