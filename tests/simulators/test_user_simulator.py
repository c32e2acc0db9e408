"""Flights of a user's simulator: each is accounted for, whatever it does."""

import sys
from pathlib import Path

import numpy as np
import pytest
from own_simulators import DIVE, DIVE_CHANNELS, DIVE_HISTORY, dive_campaign

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.simulators.engine import make_ready, simulate
from abhv_mc.simulators.user_simulator import process
from abhv_mc.simulators.user_simulator.user_flights import end_processes
from abhv_mc.simulators.user_simulator.user_plan import make_user_plans

LOST = int(Outcome.FAILED_TO_RUN)
WRONG = {  # by the delay that is asked for: what the flight returns, and what is said of it
    2.0: ("os.abort()", "killed by SIGABRT"),
    3.0: ("time.sleep(60.0)", "not done in 0.5 s"),
    4.0: ("math.sqrt(-1.0)", "ValueError: math domain error (dive.py, line "),
    5.0: (
        "found | {'load': math.nan, 'outcome': 'ok'}",
        "load is not a finite number, and the outcome is ok",
    ),
    6.0: ("{'load': 1.0}", "it did not return altitude_min"),
    7.0: ("found | {'other': 1.0}", "it returned 'other', which the campaign does not declare"),
    8.0: ("found | {'outcome': 'elsewhere'}", "it returned the outcome 'elsewhere'"),
    10.0: ("5", "which is no mapping"),
    11.0: ("found | {'load': 'much'}", "a metric or an end_time that is no number"),
    12.0: ("open('secret.txt').read()", "it reads secret.txt, which 'files' does not name"),
    13.0: ("sys.exit(3)", "exit code 3"),
    14.0: ("found | {'outcome': ['ok']}", "it returned the outcome '['ok']'"),
    15.0: ("found | {'load': 10**400}", "a metric or an end_time that is no number"),
}
WRONG_HISTORIES = {  # what is done to the history
    2.0: (
        "history.pop('time')",
        "its history holds altitude, sink_rate; declared are time, altitude, sink_rate",
    ),
    3.0: (
        "history['altitude'].pop()",
        "the columns of its history are no lists of numbers of one length",
    ),
    4.0: ("history['time'].reverse()", "the time of its history does not ascend"),
    5.0: ("history['altitude'].append(math.nan)", "the columns of its history are no lists"),
    6.0: (
        "history.update(altitude=[math.nan] * n)",
        "altitude of its history is not a finite number, and the outcome",
    ),
    7.0: ("found.pop('history')", "it did not return history"),
    8.0: (
        "history.update(dict.fromkeys(history, []))",
        "the columns of its history are no lists of numbers",
    ),
}


def ready(path: Path) -> Experiment:
    campaign = read_campaign(path)
    return make_ready(campaign, make_user_plans(campaign, campaign.controllers))  # type: ignore[arg-type]


def fly_delays(path: Path, delays: list[float]) -> FlightBlock:
    rows = np.tile([2330.0, 560.0, 1.5, 1.0], (len(delays), 1))
    rows[:, 2] = delays
    return simulate(ready(path), "v1", rows)


def test_flights_are_those_of_the_function(tmp_path: Path) -> None:
    campaign = ready(dive_campaign(tmp_path))
    rows: Floats = campaign.make_samples().draw(0, 300)
    names: dict[str, object] = {}
    exec(DIVE, names)  # noqa: S102  the text above
    for system, settings in (("v1", {"pull": 5.0}), ("v2", {"pull": 6.0})):
        block = simulate(campaign, system, rows)
        given = [
            dict(zip(campaign.parameters.index, row, strict=True))
            for row in campaign.rows(rows).tolist()
        ]
        expected = [names["fly"](each, settings) for each in given]  # type: ignore[operator]
        assert block.metrics.tolist() == [[one["altitude_min"], one["load"]] for one in expected]
        assert set(block.outcome.tolist()) <= {0, 100}
        assert (block.outcome == 100).tolist() == ["outcome" in one for one in expected]
        assert block.end_time[block.outcome == 100].tolist() == [12.5] * int(
            (block.outcome == 100).sum()
        )


def test_what_goes_wrong_costs_one_flight_and_none_is_flown_twice(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    source = (
        DIVE
        + "\nwell = fly\n\ndef fly(inputs, settings):\n    print('a flight')\n    delay = inputs['delay']\n"
    )
    source += "    open('flown', 'a').write(f'{delay}\\n')\n    found = well(inputs, settings)\n    if delay == 9.0:\n"
    source += "        return {'altitude_min': None, 'load': math.nan, 'outcome': 'ground'}\n"
    source += "".join(
        f"    if delay == {delay}:\n        return {code}\n" for delay, (code, _) in WRONG.items()
    )
    path = dive_campaign(
        tmp_path,
        f"{source}    return found\n",
        simulator={"python": "dive.py", "time_limit": "500 ms"},
    )
    (tmp_path / "secret.txt").write_text("42")
    delays = [
        1.0,
        2.0,
        1.1,
        3.0,
        1.2,
        4.0,
        5.0,
        6.0,
        7.0,
        8.0,
        9.0,
        10.0,
        11.0,
        12.0,
        13.0,
        14.0,
        15.0,
        1.3,
    ]
    block = fly_delays(path, delays)
    lost = [delay in WRONG for delay in delays]
    assert (block.outcome == LOST).tolist() == lost
    assert np.isnan(block.metrics[lost]).all()
    assert np.isfinite(block.metrics[[0, 2, 4, -1]]).all()
    assert (block.outcome[10], block.end_time[10]) == (100, 0.0)
    assert sorted(map(float, (tmp_path / "flown").read_text().split())) == sorted(delays)
    told = capfd.readouterr().err
    assert [words for _, words in WRONG.values() if words not in told] == []


def test_a_history_that_is_none_costs_its_flight(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    source = (
        DIVE_HISTORY.replace("< 200.0", "< -1e9")
        + "\nwhole = fly\n\ndef fly(inputs, settings):\n    found = whole(inputs, settings)\n"
    )
    source += (
        "    history, delay, n = found['history'], inputs['delay'], len(found['history']['time'])\n"
    )
    source += "".join(
        f"    if delay == {delay}:\n        {code}\n"
        for delay, (code, _) in WRONG_HISTORIES.items()
    )
    source += "    if delay == 9.0:\n        history['altitude'][2] = math.nan\n"
    source += "    return found | {'outcome': 'ground' if delay == 9.0 else 'ok'}\n"
    path = dive_campaign(tmp_path, source, histories=DIVE_CHANNELS)
    delays = [1.0, *WRONG_HISTORIES, 9.0]
    assert (fly_delays(path, delays).outcome == LOST).tolist() == [
        delay in WRONG_HISTORIES for delay in delays
    ]
    told = capfd.readouterr().err
    assert [words for _, words in WRONG_HISTORIES.values() if words not in told] == []
    path = dive_campaign(tmp_path, source)
    assert fly_delays(path, [1.0]).outcome.tolist() == [LOST]
    assert "it returned 'history', which the campaign does not declare" in capfd.readouterr().err


def test_declared_files_are_read_and_modules_imported_and_what_python_compiled_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    source = DIVE.replace("import json", "import model\nimport json").replace(
        "return found", "return found | model.own()"
    )
    (tmp_path / "model.py").write_text(
        "def own():\n    return {'load': float(open('data/load.txt').read())}\n"
    )
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "load.txt").write_text("6.5")
    path = dive_campaign(
        tmp_path, source, simulator={"python": "dive.py", "files": ["model.py", "data"]}
    )
    for _ in range(2):  # written, by a temporary file beside it, then read
        end_processes()
        assert fly_delays(path, [1.0]).metrics[0, 1] == 6.5
        assert list(tmp_path.glob("__pycache__/model.*.pyc"))
    undeclared = dive_campaign(tmp_path, source, simulator={"python": "dive.py", "files": ["data"]})
    end_processes()
    assert fly_delays(undeclared, [1.0]).outcome.tolist() == [LOST]


PROGRAM = """
import json, os, sys, time
for line in sys.stdin:
    given = json.loads(line)["inputs"]
    if given["delay"] == 2.0:
        print('{"level": "warning"}')
    if given["delay"] == 3.0:
        os.close(1)
        time.sleep(600.0)
    if given["delay"] == 4.0:
        print("out of the table")
    if given["delay"] == 5.0:
        os.abort()
    print(json.dumps({"altitude_min": given["delay"], "load": 1.0}), flush=True)
"""


def test_a_program_speaks_lines_and_what_is_no_answer_costs_its_flight_and_shifts_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(process, "_ENDING", 0.1)
    (tmp_path / "program.py").write_text(PROGRAM)
    path = dive_campaign(
        tmp_path, simulator={"command": [sys.executable, "./program.py"], "time_limit": "20 s"}
    )
    assert dict(ready(path).systems["v1"].plan.files).keys() == {"program.py"}  # type: ignore[union-attr]
    delays = [1.0, 2.0, 1.1, 1.2, 3.0, 1.3, 4.0, 1.4, 5.0, *[1.5] * 200]
    expected = [delay if delay < 2.0 else np.nan for delay in delays]
    assert fly_delays(path, delays).metrics[:, 0].tolist() == pytest.approx(expected, nan_ok=True)
    path = dive_campaign(tmp_path, simulator={"command": ["no-such-program"]})
    assert fly_delays(path, [1.0, 2.0]).outcome.tolist() == [LOST, LOST]
    assert "no-such-program" in capfd.readouterr().err


def test_other_files_than_the_campaign_was_begun_with_do_not_fly(tmp_path: Path) -> None:
    campaign = ready(dive_campaign(tmp_path))
    end_processes()
    (tmp_path / "dive.py").write_text(DIVE + "\n")
    with pytest.raises(Exception, match="other content"):
        simulate(campaign, "v1", campaign.make_samples().draw(0, 1))
