"""Tests of the commands worst, rare and tune: exit codes, JSON, pages and results folders."""

import html
import json
import re
import shlex
from pathlib import Path

import pytest
from search.known_flights import LINE, METRIC, TUNED, fly_line, write_line, write_tuned


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
