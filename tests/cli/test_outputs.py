"""Tests of output options, which never overwrite files of a campaign."""

import inspect
import json
import re
import shutil
import typing
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import typer
from fake_flight import ENGINE, run, write_campaign
from own_simulators import dive_campaign
from typer.models import OptionInfo

from abhv_mc.cli import options
from abhv_mc.cli.app import app
from abhv_mc.cli.options import takes_options
from abhv_mc.folder.layout import find_in_campaign
from abhv_mc.io.messages import InputError
from abhv_mc.io.units import LENGTH
from abhv_mc.requests import WorstRequest

# Paths that are read, or temporary.
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


def commands(group, names=()):
    """Yield the names and the function of each command in a group."""
    for inner in group.registered_groups:
        yield from commands(inner.typer_instance, (*names, inner.name))
    for command in group.registered_commands:
        if command.hidden:  # a former name of another command
            continue
        yield (*names, command.name or command.callback.__name__), command.callback


def outputs():
    """Yield each output option, after the names of its command, and its metavar."""
    added = (
        (entry.name.split("."), entry.load()) for entry in entry_points(group="abhv_mc.commands")
    )
    for names, function in [*commands(app), *added]:
        for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
            kind, *infos = typing.get_args(parameter.annotation) or (parameter.annotation,)
            options = [info for info in infos if isinstance(info, OptionInfo)]
            if options and Path in (kind, *typing.get_args(kind)) and name not in NOT_OUTPUTS:
                yield (*names, options[0].default), options[0].metavar


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
    """Return a function that runs the program and checks that the folder is unchanged."""

    def run(*arguments):
        before = {path: path.read_bytes() for path in flown.rglob("*") if path.is_file()}
        code, _, errors = abhv_mc(*arguments)
        assert {path: path.read_bytes() for path in flown.rglob("*") if path.is_file()} == before
        return code, errors

    return run


def test_all_commands_with_numbers_write_json():
    assert {option[0] for option in OPTIONS} >= {"linearize", "report", "query", "run", "merge"}
    commands_with_json = {option[0] for option in OPTIONS if option[-1] == "--json"}
    assert commands_with_json == {
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
            "tighten",
            "identify",
            "runs",
            "query",
        ),
        *("import", "trim", "margins", "list", "validate", "show"),
    }


@pytest.mark.parametrize("option", OPTIONS, ids=" ".join)
def test_outputs_do_not_overwrite_files_of_a_campaign(call, flown, tmp_path, option):
    if option == ("query", "--csv"):  # without SQL a folder
        option = ("query", flown, option[-1])
    code, errors = call(*option, flown / "flights/x")
    assert code == 2 and f"{flown / 'flights/x'}: " in errors, errors
    if option[-1] != "--json" and option[0] != "run":
        code, errors = call(*option, "s3://bucket/x.npz")
        assert code == 2 and f"{Path('s3://bucket/x.npz')}: " in errors, errors


@pytest.mark.parametrize(
    "command",
    [
        ("query", "FLOWN", "--csv", "file.yaml"),
        ("runs", "FLOWN", "--json", "."),
        ("runs", "FLOWN", "--json", "file.yaml/more/x.json"),
        ("fly", "level", "-o", "FLOWN"),  # its files would replace those of the campaign
        ("query", "FLOWN", "--csv", "FLOWN"),
        ("validate", "file.yaml", "--json", "file.yaml"),
    ],
)
def test_invalid_output_paths_are_rejected(call, flown, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.yaml").write_text("{}\n", encoding="utf-8")
    arguments = [flown if argument == "FLOWN" else argument for argument in command]
    code, errors = call(*arguments)
    assert code == 2 and f"{arguments[-1]}: " in errors, errors
    assert (tmp_path / "file.yaml").read_text() == "{}\n"


@pytest.mark.parametrize("command", ["worst", "rare", "tune", "run"])
def test_a_shipped_campaign_is_known_by_its_name(abhv_mc, tmp_path, command):
    """`worst s_manoeuvre` failed because there is no such file."""
    options = {
        "worst": ("--metric", "x", "-o", tmp_path / "o"),
        "rare": ("--requirement", "x", "-o", tmp_path / "o"),
        "tune": ("-o", tmp_path / "o.yaml"),
        "run": ("--controllers", "x", "-o", tmp_path / "o"),
    }
    faults = {"worst": "'x'", "rare": "'x'", "tune": "'tune'", "run": "'x'"}  # of the contents
    code, _, errors = abhv_mc(command, "s_manoeuvre", *options[command])
    assert code == 2 and faults[command] in errors, errors
    code, _, errors = abhv_mc(command, "s_manoeuvr", *options[command])
    assert code == 2 and "s_manoeuvr: " in errors and "'s_manoeuvre'" in errors, errors


def test_a_campaign_in_place_of_a_mission_is_named(abhv_mc):
    code, _, errors = abhv_mc("fly", "campaigns/s_manoeuvre.yaml")
    assert code == 2 and "s_manoeuvre.yaml: " in errors and "`abhv-mc run`" in errors, errors


def test_only_json_is_printed_to_standard_output(abhv_mc, tmp_path, monkeypatch):
    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: ENGINE)
    campaign = write_campaign(tmp_path / "f", runs="8")
    code, out, _ = abhv_mc("run", campaign, "-o", tmp_path / "out", "--no-report", "--json", "-")
    assert code == 0 and json.loads(out)["runs_done"] == 8


def test_a_dry_run_plans_the_campaign(abhv_mc, tmp_path):
    options = ("--dry-run", "--runs", 400, "--json", tmp_path / "p.json", "-o", tmp_path / "out")
    code, out, err = abhv_mc("validate", "s_manoeuvre", *options)
    assert code == 0 and "981" in out and len(re.findall(r"\b400\b.* 0\.\d+", err)) == 1
    (entry,) = json.loads((tmp_path / "p.json").read_text()).values()
    assert (entry["flights"], entry["plan"]["runs"]) == (400, 400)
    assert entry["plan"]["requirements"][0]["most_failures_at_runs"] == -1
    disk = sum(entry[f"{name}_bytes"] for name in ("rows", "histories", "envelope"))
    assert f"{disk / 1e6:.1f} MB at most" in out
    assert f"{1e3 * entry['flight_s']:.2f} ms per flight" in out
    # up to 2234 flights need 0 failures, of which a fifth of 0.27 % are expected
    assert f"({100 * (1 - 0.2 * 0.0027) ** 1600:.0f}\u202f%)" in out
    assert (tmp_path / "out/plan.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("count", [1, 2])
def test_a_dry_run_gives_the_chance_of_all_verdicts(abhv_mc, own_list, tmp_path, count):
    limits = [{"metric": "load", "below": 7.0 + k, "probability": "95 %"} for k in range(count)]
    campaign = dive_campaign(tmp_path / "f", requirements=limits)
    options = ("--dry-run", "--json", tmp_path / "plan.json")
    code, out, err = abhv_mc("validate", campaign, *options)
    assert code == 0, err
    (entry,) = json.loads((tmp_path / "plan.json").read_text()).values()
    assert len(entry["plan"]["requirements"]) == count
    assert len(re.findall(r"All PASS by 200 \*  .+% to .+%", out)) == (count > 1)


def test_paths_outside_a_campaign_are_accepted(flown, tmp_path):
    copy = shutil.copytree(flown, tmp_path / "copy")
    for free in (copy / "csv", copy / "mine.parquet", copy.parent / "flights", tmp_path / "new"):
        assert find_in_campaign(free) is None
    (copy / "campaign.yaml").unlink()  # a damaged folder is still a campaign's
    assert find_in_campaign(copy / "flights/x") == Path("flights/x")
    (tmp_path / "manifest.json").write_text("{}")  # of a web page
    (tmp_path / "figures").mkdir()
    assert find_in_campaign(tmp_path / "figures/x.png") is None


def test_a_search_has_a_default_folder():
    requests = []

    @takes_options(WorstRequest)
    def worst(request):
        requests.append(request)

    worst(campaign="s_manoeuvre", output=None, metric="altitude_error_max_m")
    worst(campaign="s_manoeuvre", output=Path("mine"), metric="altitude_error_max_m")
    assert [request.output for request in requests] == [
        Path("reports/s_manoeuvre_worst_altitude_error_max_m"),
        Path("mine"),
    ]


def test_flags_are_off_unless_given():
    """Code is not trusted, and nothing is deleted or left out, by default."""
    added = ((entry.name, entry.load()) for entry in entry_points(group="abhv_mc.commands"))
    flags = {
        (*names, name): parameter.default
        for *names, function in [*commands(app), *added]
        if not isinstance(function, typer.Typer)
        for name, parameter in inspect.signature(function).parameters.items()
        if isinstance(parameter.default, bool)
    }
    assert len(flags) > 20
    assert [key for key, value in flags.items() if value] == [("explore", "browser")]


@pytest.mark.parametrize(("rate", "code"), [("100 Hz", 0), ("50 Hz", 2)])
def test_histories_of_two_rates_are_not_stored_together(abhv_mc, own_list, tmp_path, rate, code):
    law = "from abhv_mc.extend import Command, controller\n@controller\ndef law(measured):\n"
    (tmp_path / "law.py").write_text(law + "    return Command(0.0, 0.0, 0.0, 0.5)\n")
    controllers = []
    for name, own in (("a", "100 Hz"), ("b", rate)):
        controllers.append(tmp_path / f"{name}.yaml")
        controllers[-1].write_text(f"law: python\nfile: law.py\nrate: {own}\n")
    names = ",".join(map(str, controllers))
    ended, _, err = abhv_mc("fly", "level", "--controllers", names, "-o", tmp_path / "out")
    assert ended == code, err
    assert (tmp_path / "out").exists() == (code == 0)


def test_options_are_parsed_or_refused():
    assert options.parse_names(None) is None and options.parse_names(" a, b") == ("a", "b")
    assert options._parse_shard("3/8") == (3, 8)
    assert options.parse_noise(["a_m=0.5", "b=2"]) == {"a_m": 0.5, "b": 2.0}
    assert options.parse_noise(None) == {}
    assert options.parse_option("--x", " 2 km ", LENGTH) == 2000.0
    assert options.parse_option("--x", "2", LENGTH, "ft") == pytest.approx(0.6096)
    for parse, texts in (
        (options.parse_names, ("", "a,", ",a", "a,,b")),
        (options._parse_shard, ("3", "3/", "/8", "-1/8", "3/x", "\u0663/8", "3/8/9")),
        (lambda text: options.parse_noise([text]), ("a=0", "a=-1", "a=inf", "a=nan", "a=x", "a")),
        (lambda text: options.parse_option("--x", text, LENGTH), ("2 kg", "x")),
    ):
        for text in texts:
            with pytest.raises(InputError):
                parse(text)


def test_paths_of_outputs_must_be_writable_and_outside_campaigns(flown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.yaml").write_text("x")
    (tmp_path / "folder").mkdir()
    every = {
        *("file.yaml", "file.yaml/a", "new", "new/a", "new.yaml", "new.json", "-", "folder"),
        *(flown, flown / "flights", "s3://bucket/a", "s3://bucket"),
    }
    allowed = {
        options.output_file: {"file.yaml", "new", "new/a", "new.yaml", "new.json", "-"},
        options.output_folder: {"folder", "new", "new/a", "new.yaml", "new.json", "-"},
    }
    allowed[options.output_file_or_stream] = allowed[options.output_file]
    allowed[options.json_file] = allowed[options.output_file] - {"file.yaml"}
    allowed[options.campaign_folder] = allowed[options.output_folder] | {flown}
    addresses = {"s3://bucket/a", "s3://bucket"}
    allowed[options.campaign_folder_or_address] = allowed[options.campaign_folder] | addresses
    for check, accepted in allowed.items():
        assert check(None) is None
        for path in map(Path, every):
            if path in map(Path, accepted):
                assert check(path) == path
            else:
                with pytest.raises(InputError):
                    check(path)
