"""Tests of the commands worst, rare and tune: exit codes, JSON, pages and results folders."""

import html
import json
import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest
from programs import invoke
from search.known_flights import LINE, METRIC, TUNED, fly_line, write_line, write_tuned

from abhv_mc.cli import searching
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import find_input
from abhv_mc.statistics.estimates import Interval


@pytest.fixture(autouse=True)
def fake_engine(monkeypatch, tmp_path):
    """Use fast flights and a temporary folder."""
    for module in ("abhv_mc_tune.tuning", "abhv_mc_vehicle.vehicle_simulator.simulator"):
        monkeypatch.setattr(f"{module}.make_engine", lambda: LINE)
    monkeypatch.chdir(tmp_path)


def read_json(name):
    return json.loads(Path(name).read_text(encoding="utf-8"))


@pytest.fixture
def campaign(tmp_path):
    limits = ((METRIC, 3.5), ("sideslip_max_deg", 1000))
    limit = ", ".join(
        f"{{metric: {metric}, below: {below}, probability: 0.9}}" for metric, below in limits
    )
    return write_line(tmp_path / "files", requirements=f"[{limit}]")


def test_worst_writes_its_numbers_a_page_and_flights_that_replay(abhv_mc, campaign, monkeypatch):
    monkeypatch.setattr("abhv_mc_vehicle.stability.fly_with_margins.fly", fly_line)
    command = ("worst", campaign, "--metric", METRIC, "--flights", 400, "-o", "out", "--json")
    code, out, _ = abhv_mc(*command, "worst.json")
    assert code == 0
    numbers = read_json("worst.json")
    keys = "metric controller value flights parameters random_worst at_bounds"
    assert {*keys.split()} <= numbers.keys()
    assert numbers["flights"] <= 400
    assert numbers["value"] >= numbers["random_worst"]
    assert (
        f"{numbers['value']:.5g}" in out and f"--flight {numbers['flight']}" not in out
    )  # commands are only on the page
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert f"--controller one --flight {numbers['flight']}" in page
    assert "http" not in page.split("<body>")[1]
    again = ("replay", "out", "--flight", numbers["flight"], "--controller", "one")
    code, out, _ = abhv_mc(*again, "--json", "-")
    assert code == 0 and json.loads(out)["differences"] == []
    again = abhv_mc(*command, "-")
    assert json.loads(again[1]) == numbers  # standard output has only JSON
    low = ("--metric", METRIC, "--below", "--flights", 160)
    assert abhv_mc("worst", campaign, *low, "-o", "small", "--json", "s.json")[0] == 0
    assert read_json("s.json")["value"] < numbers["value"]


def test_rare_prints_an_estimate_or_exits_with_1(abhv_mc, campaign):
    command = "rare", campaign, "--requirement"
    options = "--flights 5000 --target-cov 20% -o out --json rare.json"
    code, out, _ = abhv_mc(*command, METRIC, *options.split())
    numbers = read_json("rare.json")
    assert code == 0 and "95 %" in out
    assert 0.0 < numbers["low"] < numbers["probability"] < numbers["high"] < 1.0
    impossible = "sideslip_max_deg --flights 2000 -o no --json no.json"
    code, out, err = abhv_mc(*command, *impossible.split())
    refused = read_json("no.json")
    assert refused["probability"] is None and refused["refusal"]
    assert code == 1 and refused["refusal"] in err and "95 %" not in out
    page = html.unescape(Path("no/report.html").read_text(encoding="utf-8"))
    assert refused["refusal"] in page


def test_rare_by_a_surrogate_takes_few_flights_or_says_that_none_failed(abhv_mc, campaign):
    command = ("rare", campaign, "--surrogate", "--requirement")
    code, out, _ = abhv_mc(*command, METRIC, "-o", "out", "--json", "rare.json")
    numbers = read_json("rare.json")
    assert code == 0 and numbers["flights"] <= 400 and numbers["low"] < numbers["high"]
    assert re.search(rf"\b{numbers['failures']} ", out) and "smooth" in out
    assert "figures/learning.png" in Path("out/report.html").read_text(encoding="utf-8")
    impossible = ("sideslip_max_deg", "--flights", 80, "-o", "no", "--json", "no.json")
    code, out, err = abhv_mc(*command, *impossible)
    refused = read_json("no.json")
    assert refused["probability"] is None and " 78 " in refused["refusal"]
    assert code == 1 and refused["refusal"] in err and "95 %" not in out


def test_tune_writes_the_file_and_a_page_or_the_reason(abhv_mc, tmp_path, monkeypatch):
    """After an interrupt before the page was written, the new file made the command fail."""
    monkeypatch.setattr("abhv_mc_tune.tuning.make_engine", lambda: TUNED)
    command = ("tune", write_tuned(tmp_path).campaign, "--tune", "block.yaml")

    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("abhv_mc_tune.api.write_answer", stop)
        code, _, err = abhv_mc(*command, "-o", "new.yaml", "--json", "new.json")
    assert code == 3 and "interrupted" in err
    code, out, _ = abhv_mc(*command, "-o", "new.yaml", "--json", "new.json")
    assert code == 0 and "95 %" in out
    page = Path("new.html").read_text(encoding="utf-8")
    assert f"-&gt; {read_json('new.json')['fresh'][0]['best']:.4g}" in page
    assert read_json("new.json")["shown_better"] and page.count("<img ") == 1
    impossible = (
        Path("block.yaml")
        .read_text(encoding="utf-8")
        .replace("below_start_times: 1.5", "below: 0.01")
    )
    Path("block.yaml").write_text(impossible, encoding="utf-8")
    code, _, err = abhv_mc(*command, "-o", "no.yaml", "--json", "no.json")
    assert code == 1 and "no.rejected.yaml" in err
    limit = read_json("no.json")["fresh"][1]
    assert not limit["keeps"] and limit["best"] > limit["limit"]
    assert f"below {limit['limit']:.4g}" in Path("no.html").read_text(encoding="utf-8")
    assert not Path("no.yaml").exists() and Path("no.rejected.yaml").is_file()


def test_other_commands_recognize_the_folder_of_a_search(abhv_mc, campaign):
    search = ("worst", campaign, "--metric", METRIC, "--flights", 160, "-o")
    assert abhv_mc(*search, "out")[0] == 0
    code, _, err = abhv_mc("run", campaign, "-o", "out", "--no-report")
    assert code == 2 and re.search(r"\bout: .*\bsearch\b", err)
    assert abhv_mc("run", campaign, "-o", "flown", "--no-report")[0] in (0, 1)
    code, _, err = abhv_mc(*search, "flown")
    assert code == 2 and re.search(r"\bflown: .*\bcampaign\b", err)
    before = Path("out/report.html").read_bytes()
    Path("out/report.html").unlink()
    code, _, err = abhv_mc("report", "out")
    assert code == 2
    page_command = re.search(r"`abhv-mc (.* -o \S+)`", " ".join(err.split()))[1]
    assert abhv_mc(*shlex.split(page_command))[0] == 0  # creates the page again
    assert Path("out/report.html").read_bytes() == before
    code, out, _ = abhv_mc("verify", "campaign", "out")
    assert code == 0 and "abhv-mc worst" in out
    first = min(Path("out/flights").glob("*.parquet"))
    first.write_bytes(first.read_bytes()[:-100])
    code, out, _ = abhv_mc("verify", "campaign", "out")
    assert code == 1 and "flights/" in out


def test_the_order_of_the_dispersions_is_part_of_a_search(abhv_mc, tmp_path):
    """Dispersions are the axes of a search, so that another order leads to other flights."""
    first, second = (
        "aero.lift: {distribution: uniform, half_width: 10 %}",
        "atmosphere.density: {distribution: uniform, half_width: 2 %}",
    )
    file = write_line(tmp_path / "files", dispersions=f"{{{first}, {second}}}")
    command = ("worst", file, "--metric", METRIC, "--flights", "160", "-o", "out")
    assert abhv_mc(*command)[0] == 0
    before = {path: path.read_bytes() for path in Path("out").rglob("*.parquet")}
    write_line(tmp_path / "files", dispersions=f"{{{second}, {first}}}")
    code, _, err = abhv_mc(*command)
    assert code == 2 and re.search(r"\bout: .*\bcampaign\b", err)
    assert {path: path.read_bytes() for path in Path("out").rglob("*.parquet")} == before


def printed(capsys):
    return capsys.readouterr().out.replace("\u202f", " ").replace("\xa0", " ")


def test_a_tightening_is_printed_with_its_widths_and_confirmation(capsys):
    def dispersion(name, reweighted, width, entry, verdict):
        return SimpleNamespace(
            name=name, reweighted=reweighted, width=width, entry=entry, verdict=verdict
        )

    passed = SimpleNamespace(status="PASS", failures=2, flights=900)
    failed = SimpleNamespace(status="FAIL", failures=70, flights=800)
    rows = [
        dispersion("lift", 0.75, 0.5, {"distribution": "normal", "sigma": 0.02}, passed),
        dispersion("drag", 0.25, 0.0, None, None),
    ]
    result = SimpleNamespace(controller="own", verdict=failed, dispersions=rows, folder="there")
    searching._print_tightening(result)
    head, *lines = [line for line in printed(capsys).splitlines() if line.strip()]
    assert head.split()[:5] == ["own:", "FAIL", "70", "of", "800;"]
    cells = [line.split() for line in lines]
    (lift,), (drag,) = ([row for row in cells if row[0] == name] for name in ("lift", "drag"))
    assert lift[1:5] == ["75", "%", "50", "%"] and lift[-4:] == ["PASS", "2", "of", "900"]
    assert "0.02" in " ".join(lift) and drag[1:3] == ["25", "%"] and "PASS" in drag
    assert cells[-1] == ["folder", "there"]
    searching._print_tightening(SimpleNamespace(**vars(result) | {"dispersions": [], "folder": ""}))
    assert printed(capsys).split() == ["own:", "FAIL", "70", "of", "800"]


def test_changed_dispersions_are_compared_for_the_metrics_asked(capsys):
    def row(label, metric, start):
        before, after = (Interval(k, k - 0.5, k + 0.5) for k in (start, start + 10.0))
        return SimpleNamespace(label=label, level="95 %", metric=metric, before=before, after=after)

    own = SimpleNamespace(
        flights=500, effective_flights=123.4, estimates=[row("A", "a", 2.0), row("B", "b", 3.0)]
    )
    estimates = SimpleNamespace(
        after={"lift": {"sigma": 0.02}},
        stopped_when_proven=False,
        controllers={"tlc": own},
        asked={"b"},
    )
    searching._print_whatif(estimates)
    out = printed(capsys)
    lines = [line.split() for line in out.splitlines() if line.strip()]
    assert lines[0][0] == "lift:" and "0.02" in " ".join(lines[0])
    assert " 500 flights" in out and " 123" in out and len([x for x in lines if x[0] == "A"]) == 0
    (cells,) = [line for line in lines if line[0] == "B"]
    assert [float(x) for x in re.findall(r"\d+\.\d+|\d+", " ".join(cells[1:]))] == [
        *(95.0, 3.0, 2.5, 3.5, 13.0, 12.5, 13.5)
    ]


@pytest.mark.parametrize("fits", [True, False])
@pytest.mark.parametrize("out", [None, "new.yaml"])
def test_an_identification_names_its_file_and_fails_without_a_fit(tmp_path, monkeypatch, fits, out):
    asked = []

    def identify(*arguments, **options):
        asked.append((arguments, options))
        return SimpleNamespace(fits=fits, texts=lambda: [("Fit", "text")])

    monkeypatch.setattr("abhv_mc.search.identify.identify", identify)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f.csv").write_text("x")
    campaign = find_input("s_manoeuvre", "campaign")
    extra = ("-o", out) if out else ()
    options = ("--parameters", "a,b", "--controller", "c", "--measured", "x=2", *extra)
    result = invoke("identify", tmp_path / "f.csv", "s_manoeuvre", *options)
    assert result.exit_code == int(not fits), result.exception
    ((arguments, further),) = asked
    assert arguments[0] == campaign and arguments[2:] == (("a", "b"), "c", {"x": 2.0})
    assert further == {"output": out and Path(out)}
    assert [line.split() for line in result.stdout.splitlines() if "campaign" in line] == (
        [["campaign", out]] if out else []
    )


@pytest.mark.parametrize(
    ("options", "is_flights", "valid"),
    [
        (["--measured", "a=1"], True, True),
        ([], True, True),
        (["--fail-if-worse", "a=1"], True, False),
        (["--fail-if-loses", "1"], True, False),
        (["--requirements", "r.yaml"], True, False),
        (["--measured", "a=1"], False, False),
        (["--requirements", "r.yaml"], False, True),
    ],
)
def test_options_of_campaigns_and_of_test_flights_are_not_mixed(
    tmp_path, monkeypatch, options, is_flights, valid
):
    called = []

    def call(*arguments):
        called.append(arguments)
        raise ZeroDivisionError

    monkeypatch.setattr("abhv_mc.search.place.place_flights", call)
    monkeypatch.setattr("abhv_mc.report.pages.compare_page.compare_folders", call)
    monkeypatch.chdir(tmp_path)
    for name in ("r.yaml", "f.csv"):
        (tmp_path / name).write_text("x")
    first = "f.csv" if is_flights else "."
    error = invoke("compare", first, "s_manoeuvre", *options).exception
    assert isinstance(error, ZeroDivisionError if valid else InputError) and len(called) == valid
