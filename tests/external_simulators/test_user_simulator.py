"""Flights of user simulators: every flight is accounted for."""

import errno
import os
import re
import shutil
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from own_simulators import DIVE, DIVE_CHANNELS, DIVE_HISTORY, dive_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.executor import make_ready, simulate
from abhv_mc.external_simulators import (
    process,
    user_flights,
    working_folder,
)
from abhv_mc.external_simulators.process import end_processes
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputErrors

LOST = int(Outcome.FAILED_TO_RUN)
WRONG = {  # by the delay that is asked for: what the flight returns, and a pattern of the reason
    2.0: ("os.abort()", r"\bSIGABRT\b"),
    3.0: ("time.sleep(60.0)", r"\b0\.5 s\b"),
    4.0: ("math.sqrt(-1.0)", r"^ValueError: .*\(dive\.py, line \d+\)"),
    5.0: ("found | {'load': math.nan, 'outcome': 'ok'}", r"^'load' .*\bfinite\b.* 'ok'$"),
    6.0: ("{'load': 1.0}", r"'altitude_min'$"),
    7.0: ("found | {'other': 1.0}", "'other'"),
    8.0: ("found | {'outcome': 'elsewhere'}", "'elsewhere'"),
    10.0: ("5", r"\b5\b"),
    11.0: ("found | {'load': '6.5'}", r'"6\.5".*\bload\b'),
    12.0: ("open('secret.txt').read()", r"'files'.*\bsecret\.txt\b"),
    13.0: ("sys.exit(3)", r"\b3\b"),
    14.0: ("found | {'outcome': ['ok']}", r"'\['ok'\]'"),
    15.0: ("found | {'load': 10**400}", r"\bload\b.*\blarge\b"),
    16.0: ("found | {'load': True}", r"\btrue\b.*\bload\b.*\(.* 1\b"),
    17.0: ("found | {'end_time': '1_000'}", r'"1_000".*\bend_time\b'),
    18.0: ("found | {'flight': 1}", "'flight'"),
    19.0: ("int('x' * 300)", r"^ValueError: .*xxx"),
}
WRONG_HISTORIES = {  # what is done to the history, and a pattern of the reason
    2.0: (
        "history.pop('time')",
        r"'altitude' and 'sink_rate', but .* 'time', 'altitude' and 'sink_rate'$",
    ),
    3.0: ("history['altitude'].pop()", r"\bcolumns\b"),
    4.0: ("history['time'].reverse()", r"\btime\b"),
    5.0: ("history['altitude'].append(math.nan)", r"\bcolumns\b"),
    6.0: ("history.update(altitude=[math.nan] * n)", r"\baltitude\b.* finite\b"),
    7.0: ("found.pop('history')", "'history'$"),
    8.0: ("history.update(dict.fromkeys(history, []))", r"\bcolumns\b"),
}


def ready(path):
    campaign = read_campaign(path)
    return make_ready(campaign, campaign.simulator.make_plans(campaign.controllers))


def rows_of(delays):
    rows = np.tile([2330.0, 560.0, 1.5, 1.0], (len(delays), 1))
    rows[:, 2] = delays
    return rows


def fly_delays(path, delays):
    return simulate(ready(path), "v1", rows_of(delays))


def test_flights_are_those_of_the_function(tmp_path):
    campaign = ready(dive_campaign(tmp_path))
    rows = campaign.make_samples().draw(0, 300)
    names = {}
    exec(DIVE, names)  # noqa: S102  the text above
    for system, settings in (("v1", {"pull": 5.0}), ("v2", {"pull": 6.0})):
        block = simulate(campaign, system, rows)
        inputs = [
            dict(zip(campaign.parameters.index, row, strict=True))
            for row in campaign.rows(rows).tolist()
        ]
        expected = [names["fly"](flight_inputs, settings) for flight_inputs in inputs]
        assert block.metrics.tolist() == [
            [answer["altitude_min"], answer["load"]] for answer in expected
        ]
        assert set(block.outcome.tolist()) <= {0, 100}
        assert (block.outcome == 100).tolist() == ["outcome" in answer for answer in expected]
        assert block.end_time[block.outcome == 100].tolist() == [12.5] * int(
            (block.outcome == 100).sum()
        )


def test_what_goes_wrong_costs_one_flight_and_none_is_flown_twice(tmp_path, capfd):
    source = (
        DIVE + "\nwell = fly\n\ndef fly(inputs, settings):\n    print('a flight')\n    delay = "
        "inputs['delay']\n"
    )
    source += f"    open({str(tmp_path / 'flown')!r}, 'a').write(f'{{delay}}\\n')\n"
    source += "    found = well(inputs, settings)\n    if delay == 9.0:\n"
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
    delays = [1.0, 2.0, 1.1, 3.0, 1.2, *map(float, range(4, 20)), 1.3]
    block = fly_delays(path, delays)
    lost = [delay in WRONG for delay in delays]
    assert (block.outcome == LOST).tolist() == lost
    assert np.isnan(block.metrics[lost]).all()
    assert np.isfinite(block.metrics[[0, 2, 4, -1]]).all()
    assert (block.outcome[10], block.end_time[10]) == (100, 0.0)
    assert sorted(map(float, (tmp_path / "flown").read_text().split())) == sorted(delays)
    errors = capfd.readouterr().err
    for row, delay in enumerate(delays):
        if delay in WRONG:
            assert re.search(WRONG[delay][1], block.reasons[row]), block.reasons[row]
            assert block.reasons[row] in errors


def test_a_history_that_is_none_costs_its_flight(tmp_path, capfd):
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
    block = fly_delays(path, delays)
    assert (block.outcome == LOST).tolist() == [delay in WRONG_HISTORIES for delay in delays]
    errors = capfd.readouterr().err
    for row, (_, pattern) in enumerate(WRONG_HISTORIES.values(), 1):
        assert re.search(pattern, block.reasons[row]) and block.reasons[row] in errors
    path = dive_campaign(tmp_path, source)
    assert fly_delays(path, [1.0]).outcome.tolist() == [LOST]
    assert "'history'" in capfd.readouterr().err


def test_declared_files_are_read_and_modules_imported(tmp_path):
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
    assert fly_delays(path, [1.0]).metrics[0, 1] == 6.5
    undeclared = dive_campaign(tmp_path, source, simulator={"python": "dive.py", "files": ["data"]})
    end_processes()
    assert fly_delays(undeclared, [1.0]).outcome.tolist() == [LOST]


# Writes its case into its working folder, over a declared file, and reads it after a while.
DECK = """
import json, os, sys, time
for line in sys.stdin:
    delay = json.loads(line)["inputs"]["delay"]
    with open("case.in", "w") as file:
        file.write(str(delay))
    os.listdir("out")
    time.sleep(0.02)
    print(json.dumps({"altitude_min": float(open("case.in").read()), "load": 1.0}), flush=True)
"""


def test_a_file_that_is_missing_at_the_start_is_named(tmp_path):
    path = dive_campaign(tmp_path)
    (tmp_path / "drag.txt").write_text("0.02")
    (tmp_path / "dive.py").write_text(f"open('drag.txt')\n{DIVE}")
    with pytest.raises(InputErrors, match=r"'files'.*\bdrag\.txt\b"):
        list(read_campaign(path).simulator.try_out())


def test_each_process_works_in_a_folder_of_its_own(tmp_path, monkeypatch):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    own = tmp_path / "own"
    (own / "out").mkdir(parents=True)
    (own / "deck.py").write_text(DECK)
    (own / "case.in").write_text("as it was")
    simulator = {"command": [sys.executable, "deck.py"], "files": ["case.in", "out"]}
    campaign = ready(dive_campaign(own, simulator=simulator))
    before = sorted(own.rglob("*"))

    def fly(first):
        delays = np.arange(first, first + 20, dtype=float)
        assert simulate(campaign, "v1", rows_of(delays)).metrics[:, 0].tolist() == delays.tolist()

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(fly, range(0, 80, 20)))
    assert len(list(scratch.iterdir())) == 4
    end_processes()
    assert not list(scratch.iterdir())
    assert (own / "case.in").read_text() == "as it was" and sorted(own.rglob("*")) == before


def test_a_working_folder_holds_copies_with_their_modes(tmp_path, monkeypatch):
    monkeypatch.setattr(working_folder, "_LARGEST_COPY", 1000)
    shutil.copy("/bin/true", tmp_path / "program")
    for name, text, mode in (("run.sh", "#!/bin/sh\n", 0o755), ("data.txt", "1", 0o444)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(mode)
    (tmp_path / "large.bin").write_bytes(bytes(1001))
    files = ["program", "run.sh", "data.txt", "large.bin", "made/"]
    path = dive_campaign(tmp_path, simulator={"python": "dive.py", "files": files})
    plan = ready(path).systems["v1"].plan
    folder = working_folder.make_working_folder(plan)
    links = sorted(path.name for path in folder.iterdir() if path.is_symlink())
    assert links == ["large.bin", "program"]
    for name in ("dive.py", "run.sh", "data.txt"):
        assert (folder / name).stat().st_mode == (tmp_path / name).stat().st_mode
    assert (folder / "made").is_dir()
    working_folder.delete_working_folder(folder)
    assert not folder.exists()


def test_a_word_that_leads_out_of_the_folder_is_rejected(tmp_path):
    (tmp_path / "sim.py").touch()
    path = dive_campaign(tmp_path / "own", simulator={"command": ["python3", "../sim.py"]})
    with pytest.raises(InputErrors, match=r"'folder: \.\.'"):
        read_campaign(path)
    path = dive_campaign(
        tmp_path / "own", simulator={"command": ["python3", "own/dive.py"], "folder": ".."}
    )
    assert dict(ready(path).systems["v1"].plan.files).keys() == {"own/dive.py"}


SWALLOWS = (
    DIVE
    + """
import subprocess
once = fly
def fly(inputs, settings):
    subprocess.run(["cat"], timeout=20.0)
    subprocess.run(["echo", "no answer"])
    if os.fork() == 0:
        return once(inputs, settings) | {"load": 0.0}
    os.wait()
    return once(inputs, settings)
"""
)


def test_what_a_flight_starts_reads_no_request_and_writes_no_answer(tmp_path, monkeypatch):
    monkeypatch.setattr(user_flights, "_AHEAD", np.inf)
    path = dive_campaign(tmp_path, SWALLOWS)
    delays = np.linspace(1.0, 2.0, 30).tolist()
    fly_delays(path, delays[:1])
    plain = fly_delays(dive_campaign(tmp_path / "plain"), delays)
    assert np.array_equal(fly_delays(path, delays).metrics, plain.metrics)


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
    tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(process, "_ENDING", 0.1)
    (tmp_path / "program.py").write_text(PROGRAM)
    path = dive_campaign(
        tmp_path, simulator={"command": [sys.executable, "./program.py"], "time_limit": "20 s"}
    )
    assert dict(ready(path).systems["v1"].plan.files).keys() == {"program.py"}
    delays = [1.0, 2.0, 1.1, 1.2, 3.0, 1.3, 4.0, 1.4, 5.0, *[1.5] * 200]
    expected = [delay if delay < 2.0 else np.nan for delay in delays]
    assert fly_delays(path, delays).metrics[:, 0].tolist() == pytest.approx(expected, nan_ok=True)
    path = dive_campaign(tmp_path, simulator={"command": ["no-such-program"]})
    assert fly_delays(path, [1.0, 2.0]).outcome.tolist() == [LOST, LOST]
    assert "no-such-program" in capfd.readouterr().err


# Answers some flights twice, and others not at all.
UNEVEN = """
import json, os, sys, threading, time
def late():
    time.sleep(0.08)
    print(json.dumps({"altitude_min": -1.0, "load": 1.0}), flush=True)
for line in sys.stdin:
    given = json.loads(line)
    delay = given["inputs"]["delay"]
    time.sleep(0.005 * (MODE == "thread"))
    answer = {"altitude_min": delay, "load": 1.0}
    if ECHOES:
        answer["flight"] = given["flight"]
    if delay % 10 == 3:
        if MODE == "thread":
            threading.Thread(target=late).start()
        elif MODE == "error":
            print(json.dumps({"error": "diverged"}))
        else:
            print(json.dumps(answer), flush=True)
            time.sleep(0.005 * (MODE == "late"))
    if delay % 50 == 7 and MODE == "few":
        continue
    print(json.dumps(answer), flush=True)
"""


@pytest.mark.parametrize("echoes", [False, True])
@pytest.mark.parametrize("mode", ["error", "twice", "late", "thread", "few"])
def test_no_flight_has_the_numbers_of_another(tmp_path, mode, echoes, monkeypatch, capfd):
    monkeypatch.setattr(user_flights, "_told", set())
    text = UNEVEN.replace("MODE", repr(mode)).replace("ECHOES", repr(echoes))
    (tmp_path / "uneven.py").write_text(text)
    simulator = {"command": [sys.executable, "uneven.py"], "time_limit": "1 s"}
    campaign = ready(dive_campaign(tmp_path, simulator=simulator))
    systems = {
        name: system._replace(plan=campaign.simulator.prove(system.plan))
        for name, system in campaign.systems.items()
    }
    campaign = replace(campaign, systems=systems)
    delays = np.arange(60.0)
    events = Counter()
    for block in np.split(delays, 2):
        flown = simulate(campaign, "v1", rows_of(block))
        events.update(flown.events)
        lost = flown.outcome == LOST
        assert np.array_equal(flown.metrics[~lost, 0], block[~lost])
        assert lost.sum() <= 6
    assert events["surplus"]
    assert ("twice" in capfd.readouterr().err) or mode == "thread"


def test_a_process_is_replaced_after_so_many_flights_and_says_what_it_wrote(tmp_path):
    text = "import json, os, sys\nfor line in sys.stdin:\n    given = json.loads(line)['inputs']\n"
    text += "    print('flying', file=sys.stderr)\n"
    text += "    print(json.dumps({'altitude_min': os.getpid(), 'load': 1.0}), flush=True)\n"
    (tmp_path / "sim.py").write_text(text)
    simulator = {"command": [sys.executable, "sim.py"], "flights_per_process": 3}
    block = fly_delays(dive_campaign(tmp_path, simulator=simulator), [1.0] * 7)
    numbers = block.metrics[:, 0].tolist()
    assert [numbers.count(number) for number in dict.fromkeys(numbers)] == [3, 3, 1]
    assert block.events == {"restarts": 2}
    assert block.standard_error.count("flying") == 7


def test_a_program_may_take_its_time_to_start_and_has_to_flush(tmp_path, monkeypatch, capfd):
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    text = "import json, sys, time\ntime.sleep(1.0)\nfor line in sys.stdin:\n"
    text += '    print(\'{"altitude_min": 1.0, "load": 1.0}\', flush=FLUSH)\n'
    (tmp_path / "slow.py").write_text(text.replace("FLUSH", "True"))
    simulator = {"command": [sys.executable, "slow.py"], "time_limit": "300 ms"}
    assert (fly_delays(dive_campaign(tmp_path, simulator=simulator), [1.0]).outcome == 0).all()
    end_processes()
    (tmp_path / "slow.py").write_text(text.replace("FLUSH", "False"))
    simulator["start_limit"] = "1 s"
    path = dive_campaign(tmp_path, simulator=simulator)
    assert fly_delays(path, [1.0]).outcome.tolist() == [LOST]
    assert "flush" in capfd.readouterr().err


def test_output_without_line_ends_is_lost_at_the_time_limit(tmp_path, capfd):
    """The start limit does not apply, because the program has written."""
    (tmp_path / "dots.py").write_text("while True:\n    print('.' * 999, end='')\n")
    simulator = {"command": [sys.executable, "dots.py", "x" * 300], "time_limit": "200 ms"}
    path = dive_campaign(tmp_path, simulator=simulator)
    assert fly_delays(path, [1.0, 2.0]).outcome.tolist() == [LOST] * 2
    assert "within 0.2 s" in capfd.readouterr().err


def test_a_program_without_answers_is_lost_with_its_last_error(tmp_path, capfd):
    """Regression: a shell continues after a missing program, which was not reported."""
    (tmp_path / "loop.sh").write_text("#!/bin/sh\nwhile read -r line; do ./shot </dev/null; done\n")
    (tmp_path / "shot").write_text("#!/bin/sh\n")
    for name in ("loop.sh", "shot"):
        (tmp_path / name).chmod(0o755)
    simulator = {"command": ["./loop.sh"], "time_limit": "1 s", "start_limit": "2 s"}
    path = dive_campaign(tmp_path, simulator=simulator)
    assert fly_delays(path, [1.0, 2.0, 3.0]).outcome.tolist() == [LOST] * 3
    errors = capfd.readouterr().err
    assert errors.count("(start_limit)") == 1  # it is used up once
    assert "./shot: not found'" in errors
    assert re.search(r"'files'.* shot,", errors)


@pytest.mark.parametrize("code", [errno.EMFILE, errno.EAGAIN])
def test_a_machine_that_starts_no_process_costs_no_flight(tmp_path, monkeypatch, code):
    def fail(*_, **__):
        raise OSError(code, os.strerror(code))

    end_processes()
    monkeypatch.setattr("subprocess.Popen", fail)
    with pytest.raises(OSError, match=re.escape(os.strerror(code))):
        fly_delays(dive_campaign(tmp_path), [1.0])


def test_other_files_than_the_campaign_was_begun_with_do_not_fly(tmp_path):
    campaign = ready(dive_campaign(tmp_path))
    end_processes()
    (tmp_path / "dive.py").write_text(DIVE + "\n")
    with pytest.raises(Exception, match=r"dive\.py: "):
        simulate(campaign, "v1", campaign.make_samples().draw(0, 1))


def test_histories_are_sampled_within_their_times_and_extremes_cover_the_neighbours():
    """Straight lines from 0 to 1.6 s with a peak at 0.6 s, and from 0.5 to 0.9 s."""
    histories = {
        0: np.array([[0.0, 0.6, 1.6], [0.0, 6.0, -4.0]]),
        2: np.array([[0.5, 0.9], [1.0, 9.0]]),
    }
    times, sampled = user_flights.sample_histories(histories, 3, 1, 2.0, beyond=1)
    nan = np.nan
    assert times.tolist() == [-0.5, 0.0, 0.5, 1.0, 1.5, 2.0]
    np.testing.assert_allclose(sampled[0, :, 0], [nan, 0.0, 5.0, 2.0, -3.0, nan], rtol=1e-6)
    np.testing.assert_allclose(sampled[2, :, 0], [nan, nan, 1.0, nan, nan, nan])
    assert np.isnan(sampled[1]).all()
    low, high = user_flights.find_extremes(histories, times, sampled)
    np.testing.assert_allclose(low[:, 0], [0, 0, 0, -3, -4, -4], rtol=1e-6)
    np.testing.assert_allclose(high[:, 0], [0, 5, 9, 9, 2, -3], rtol=1e-6)
