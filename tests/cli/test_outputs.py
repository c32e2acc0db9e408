"""No command writes over what a campaign's folder holds: every option that names an output refuses it."""

import inspect
import json
import shutil
import typing
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from fake_flight import ENGINE, run, write_campaign
from typer.models import OptionInfo

from abhv_mc.cli.app import app
from abhv_mc.cli.request_options import takes_options
from abhv_mc.folder.layout import find_in_campaign
from abhv_mc.requests import WorstRequest

# Read, or there for a while.
NOT_OUTPUTS = {
    "baseline",
    "block",
    "campaign",
    "plans",
    "references",
    "requirements",
    "vehicle",
    "file",
    "staging",
}


def commands(group, words=()):
    """Yield the words and the function of each command in a group."""
    for inner in group.registered_groups:
        yield from commands(inner.typer_instance, (*words, inner.name))
    for command in group.registered_commands:
        if command.hidden:  # another name of one that is listed
            continue
        yield (*words, command.name or command.callback.__name__), command.callback


def outputs():
    """Yield the options that name something to write, each after its command's words, and what they take."""
    added = (
        (entry.name.split("."), entry.load()) for entry in entry_points(group="abhv_mc.commands")
    )
    for words, function in [*commands(app), *added]:
        for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
            kind, *infos = typing.get_args(parameter.annotation) or (parameter.annotation,)
            options = [info for info in infos if isinstance(info, OptionInfo)]
            if options and Path in (kind, *typing.get_args(kind)) and name not in NOT_OUTPUTS:
                yield (*words, options[0].default), options[0].metavar


TAKEN = dict(outputs())
OPTIONS = list(TAKEN)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    campaign = write_campaign(
        root / "f", runs="8", keep="{envelopes: {rate: 2 Hz, channels: [altitude_m]}}"
    )
    return run(campaign, root / "out").folder


@pytest.fixture
def call(abhv_mc, flown):
    """Run the program; nothing in the folder is changed."""

    def run(*words):
        before = {path: path.read_bytes() for path in flown.rglob("*") if path.is_file()}
        code, _, said = abhv_mc(*words)
        assert {path: path.read_bytes() for path in flown.rglob("*") if path.is_file()} == before
        return code, said

    return run


def test_all_commands_are_looked_at_and_all_that_print_figures_write_json():
    assert {words[0] for words in OPTIONS} >= {"linearize", "report", "query", "run", "merge"}
    figures = {words[0] for words in OPTIONS if words[-1] == "--json"}
    assert figures == {
        *(
            "run",
            "merge",
            "fly",
            "replay",
            "worst",
            "rare",
            "tune",
            "compare",
            "explain",
            "whatif",
            "place",
            "runs",
            "query",
        ),
        *("import", "trim", "margins", "list", "verify", "validate", "show"),
    }


@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_outputs_keep_away_from_what_is_the_campaigns(call, flown, tmp_path, words):
    if words == ("query", "--csv"):  # without SQL a folder
        words = ("query", flown, words[-1])
    code, said = call(*words, flown / "flights/x")
    assert code == 2 and "a place of the campaign's own files" in said, said
    if words[-1] != "--json" and words[0] != "run":
        code, said = call(*words, "s3://bucket/x.npz")
        assert code == 2 and "an address" in said, said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("query", "FLOWN", "--csv", "file.yaml"), "a file"),
        (("runs", "FLOWN", "--json", "."), "a folder"),
        (("runs", "FLOWN", "--json", "file.yaml/more/x.json"), "cannot be written"),
        (
            ("fly", "level", "-o", "FLOWN"),
            "own files",
        ),  # its nominal flight would be written over the campaign's
        (("query", "FLOWN", "--csv", "FLOWN"), "own files"),
        (("validate", "file.yaml", "--json", "file.yaml"), "a JSON file"),
    ],
)
def test_what_is_no_place_for_an_output(call, flown, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.yaml").write_text("{}\n", encoding="utf-8")
    code, found = call(*(flown if word == "FLOWN" else word for word in words))
    assert code == 2 and said in found, found
    assert (tmp_path / "file.yaml").read_text() == "{}\n"


@pytest.mark.parametrize("command", ["worst", "rare", "tune", "run"])
def test_a_shipped_campaign_is_known_by_its_name(abhv_mc, tmp_path, command):
    """`worst s_manoeuvre` failed: found no such file."""
    words = {
        "worst": ("--metric", "x", "-o", tmp_path / "o"),
        "rare": ("--requirement", "x", "-o", tmp_path / "o"),
    }
    words |= {
        "tune": ("-o", tmp_path / "o.yaml"),
        "run": ("--controllers", "x", "-o", tmp_path / "o"),
    }
    code, _, said = abhv_mc(command, "s_manoeuvre", *words[command])
    assert "no such file" not in said and code == 2, said
    code, _, said = abhv_mc(command, "s_manoeuvr", *words[command])
    assert code == 2 and "did you mean 's_manoeuvre'?" in said, said


def test_a_campaign_in_place_of_a_mission_is_named(abhv_mc):
    code, _, said = abhv_mc("fly", "campaigns/s_manoeuvre.yaml")
    assert code == 2 and "a campaign file; expected a mission file: `abhv-mc run`" in said, said


def test_json_on_standard_output_stands_there_alone(abhv_mc, tmp_path, monkeypatch):
    monkeypatch.setattr("abhv_mc.simulators.vehicle_simulator.make_engine", lambda: ENGINE)
    campaign = write_campaign(tmp_path / "f", runs="8")
    code, out, _ = abhv_mc("run", campaign, "-o", tmp_path / "out", "--no-report", "--json", "-")
    assert code == 0 and json.loads(out)["runs_done"] == 8


def test_a_dry_run_plans_the_campaign(abhv_mc, tmp_path):
    words = ("--dry-run", "--runs", 400, "--json", tmp_path / "p.json", "-o", tmp_path / "out")
    code, out, err = abhv_mc("validate", "s_manoeuvre", *words)
    assert code == 0 and "981" in out and err.count("no outcome of 400 flights") == 1
    (entry,) = json.loads((tmp_path / "p.json").read_text()).values()
    assert (entry["flights"], entry["plan"]["runs"]) == (400, 400)
    assert entry["plan"]["requirements"][0]["most_failures_at_runs"] == -1
    assert (tmp_path / "out/plan.png").read_bytes()[:4] == b"\x89PNG"


def test_other_places_are_free(flown, tmp_path):
    copy = shutil.copytree(flown, tmp_path / "copy")
    for free in (copy / "csv", copy / "mine.parquet", copy.parent / "flights", tmp_path / "new"):
        assert find_in_campaign(free) is None
    (copy / "campaign.yaml").unlink()  # a damaged folder is one all the same
    assert find_in_campaign(copy / "flights/x") == Path("flights/x")
    (tmp_path / "manifest.json").write_text("{}")  # of a web page
    (tmp_path / "figures").mkdir()
    assert find_in_campaign(tmp_path / "figures/x.png") is None


def test_a_search_has_a_folder_by_default():
    seen = []

    @takes_options(WorstRequest)
    def worst(request):
        seen.append(request)

    worst(campaign="s_manoeuvre", output=None, metric="altitude_error_max_m")
    worst(campaign="s_manoeuvre", output=Path("mine"), metric="altitude_error_max_m")
    assert [one.output for one in seen] == [
        Path("reports/s_manoeuvre_worst_altitude_error_max_m"),
        Path("mine"),
    ]
