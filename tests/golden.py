"""Numbers of small reports that a change of structure must not move, and how they are renewed.

    python tests/golden.py --renew [NAME...]    writes tests/reference/golden/NAME.json.gz

The cases are the shipped campaigns with a few flights, two simulators in Python, and a table. Quick
cases hold the numbers that commands print and the curves of figures, for flights from formulas.
Renew them in the commit that is meant to move numbers, and say there which and why.
"""

import argparse
import gzip
import io
import json
import math
import os
import re
import shlex
import sys
import tempfile
from contextlib import ExitStack, chdir, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from fake_flight import ENGINE
from fake_flight import write_campaign as write_fake
from matplotlib.backends.backend_agg import FigureCanvasAgg
from own_simulators import DIVE_CHANNELS, DIVE_HISTORY, dive_campaign
from report import synthetic

from abhv_mc.cli.app import main
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.shipped import shipped_configs, shipped_files
from abhv_mc.topics.registry import make_figures
from abhv_mc.topics.topic import Models
from abhv_mc_vehicle.vehicle_simulator.simulator import make_engine

STORED = Path(__file__).parent / "reference" / "golden"
CASES = (*shipped_files("campaign"), "rocket", "dive", "table")
FLIGHTS = 8
_PATCHES = {  # drawing and searching take most of the time
    "abhv_mc.topics.registry.make_figures": lambda models: {},
    "abhv_mc.statistics.unknowns.FEWEST_SEARCHED": 8,
}
# What is another in each folder, on each machine or in each version; texts are tested elsewhere.
_OTHER = {
    "code",
    "commit",
    "failure_map",
    "hash",
    "key",
    "pages",
    "files",
    "pictures",
    "digest",
    "digests",
    "warnings",
    "wall_time_s",
    "machine",
    "versions",
    "labels",
    "label",
}
_STATUS = re.compile(r"[A-Za-z][\w.]*|NOT SHOWN")
_DIGITS = 12  # that are stored
_TOLERANCE = 1e-9  # relative, for floating-point numbers of another machine
# flights that cycle at their limits or end early amplify the last bits of gains
_TOLERANCES = {"physics": 1e-7, "wide": 1e-7, "wind_and_sensors": 1e-7}
# ratio of a variance to that of paired differences, which may be near their rounding
_AMPLIFIED, _FACTOR = "pairing_gain", 1e6
_ZERO = 1e-10  # absolute, for differences of numbers that are nearly equal
# The rudder of its trim lies on a node of the tables; the last bits decide on which side, and
# slopes differ there.
_ON_A_NODE = {"winged_cone": "margins"}


# campaigns of fake flights are in c/, d/ and e/, a synthetic one is in s/
QUICK = {
    "campaigns": """
        run e/campaign.yaml -o u
        show verdicts u
        show comparison u
        run d/campaign.yaml -o a --json a.json
        run d/campaign.yaml -o b --seed 6 --runs 200 --no-report
        query a "from samples limit 5" --csv -
        query a "from flights order by flight, controller limit 2" --csv -
        query a "from envelopes limit 9" --csv -
        query a "from histories limit 3" --csv -
        query u "from samples limit 12" --csv -
        replay a --flight 7 --controller two
        merge a b -o m --json m.json
        verify campaign a
    """,
    "commands": """
        run c/campaign.yaml -o a --junit a.xml
        run c/campaign.yaml -o b --seed 6
        runs .
        show summary a
        show flights a
        show drivers a
        show failures a
        show envelopes a
        compare a b --json ab.json
        compare a a --controllers one,two --fail-if-worse altitude_error_max_m=5% --fail-if-loses 1
        tighten a aero.lift.sigma=4% --json tighten.json
        explain a --all --controller two --json explain.json
        report a -o r --requirements r.yaml --junit r.xml
        explain a --flight 5 --controller two -o e.png
        replay a --flight 5 --controller two --plot
        compare a b -o ab
        show metrics b --json metrics.json
        show nothing a
        list metrics
        list channels
        list controllers
        list missions
        query a --json x.json
        margins level --worst
        margins s_manoeuvre --worst --bank 5
        margins s_manoeuvre --worst --at 2s
        margins s_manoeuvre --worst --hold speed
        margins s_manoeuvre --worst -o x
        margins s_manoeuvre --worst --vehicle abhv
        run c/campaign.yaml -o x --baseline a --no-report
        run c/campaign.yaml -o x --runs 0
        run c/campaign.yaml -o x --shard 4/3
        explain a
        explain a --all --flight 3
        replay a --flight 300 --controller one
        replay a --flight 5 --controller three
        compare a b --controllers one
        compare a b --fail-if-worse altitude_error_max_m
        tighten a aero.drag.sigma=4%
        tighten a aero.lift.sigma=60%
        tighten a aero.lift.sigma=-1%
        merge a a -o x
        report nowhere
        trim nowhere
    """,
    "searches": """
        run d/campaign.yaml -o a
        worst d/campaign.yaml --metric altitude_error_max_m --flights 200 -o w --json w.json
        worst d/campaign.yaml --metric altitude_error_max_m --below --flights 160 --box 2 -o x
        rare c/campaign.yaml --requirement high --flights 3000 -o y --json y.json
        rare c/campaign.yaml --requirement sideslip_max_deg --flights 2000 --controller two -o z
        compare t.csv d/campaign.yaml --controller one --json place.json -o p
        compare t.csv d/campaign.yaml --controller two --measured altitude_error_max_m=0.5
        compare t.csv d/campaign.yaml
        worst d/campaign.yaml --metric nothing -o x
        worst d/campaign.yaml --metric altitude_error_max_m --flights 0 -o x
        rare c/campaign.yaml --requirement nothing -o x
        explain a --flight 5 --controller two --requirement altitude_error_max_m
    """,
    "physics": """
        run wide --runs 3 --no-report -o a
        query a "from flights order by flight, controller" --csv -
        run failures --runs 5 --no-report -o b
        query b "from flights order by flight, controller" --csv -
        run wind_and_air_data --runs 3 --no-report -o v
        query v "from flights order by flight, controller" --csv -
        run navigation --runs 2 --no-report -o n
        query n "from flights order by flight, controller" --csv -
        run flexible --runs 2 --no-report -o x
        query x "from flights order by flight, controller" --csv -
        trim s_manoeuvre --bank 0,40 --rotating
        trim f16 --altitude 3048 --speed 170 --flight-path-angle 5
        margins s_manoeuvre --bank 30 --controllers tlc,lqr --json m.json
        fly level --controllers tlc,lqr --json f.json
        show failure_cases b
    """,
    "sections": """
        show summary s
        show verdicts s
        show comparison s
        show metrics s
        show flights s
        show drivers s
        show failures s
        show failure_cases s
        show envelopes s
        show convergence s
        report s -o r --junit r.xml
    """,
}
_PRINTED = re.compile(
    r"(?<![\w.-])-?\d{1,6}(?:\.\d+)?(?:e[-+]?\d{1,2})?(?!\.?\w|-)"
    r"|\b(?:PASS|FAIL|NOT SHOWN|ESTIMATE|one|two|TLC|LQR)\b"
)
_CANVAS = "abhv_mc.topics.figure_style.FigureCanvasAgg"
_MIXED = """{atmosphere.density: {distribution: triangular, half_width: 10 %}, aero.lift:
  {distribution: truncated_normal, sigma: 5 %, half_width: 8 %, probability: 0.5}, aero.drag:
  {distribution: discrete, values: [0.9, 1, 1.2], weights: [1, 2, 1]}}"""
_LIMITS = """[{metric: altitude_error_max_m, below: 3.4, probability: 0.9, id: high},
  {metric: speed_error_max_mps, above: 0.5, below: 50, probability: 0.8, ended_early: as_measured},
  {metric: sideslip_max_deg, above: 0, probability: 0.95, consumer_risk: 0.2}]"""
_LIMIT = "[{metric: altitude_error_max_m, below: 2.5, probability: 0.8}]"
_PAIR = "[{between: [aero.drag, atmosphere.density], rank: 0.6}]"
_CAMPAIGNS = {
    "c": {"requirements": _LIMITS},
    "d": {"requirements": _LIMITS, "dispersions": _MIXED, "correlations": _PAIR, "runs": "400"},
    "e": {"requirements": _LIMIT, "unknowns": "{aero.drag: {low: 0.8, high: 1.15}}", "runs": "60"},
}


def run_program(folder, *arguments):
    """Run a command of the program in this process; exit codes of verdicts are ignored."""
    with ExitStack() as stack:
        stack.enter_context(patch.dict(os.environ, {"XDG_CONFIG_HOME": str(folder / "config")}))
        stack.enter_context(patch.object(sys, "argv", ["abhv-mc", *map(str, arguments)]))
        for name, value in _PATCHES.items():
            stack.enter_context(patch(name, value))
        try:
            main()
        except SystemExit as ended:
            if ended.code not in (None, 0, 1, 2):
                raise
            return ended.code
    return None


def make_report(case, folder):
    """Return the numbers and statuses of a case's ``report.json``, made in an empty folder."""
    if case in QUICK:
        return make_outputs(case, folder)
    results = folder / "results"
    if case in ("dive", "table"):
        own = dive_campaign(folder / "own", DIVE_HISTORY, histories=DIVE_CHANNELS, runs=300)
        run_program(folder, "run", own, "-o", results, "--workers", 2)
    if case == "table":
        run_program(folder, "query", results, "--csv", folder / "exported")
        content = json.loads(own.read_text())
        for name in ("simulator", "runs", "histories"):
            del content[name]
        del content["inputs"]["dive"]  # nominal in each flight, and not in the table
        own.write_text(json.dumps(content | {"independent": True}))
        table, results = folder / "exported" / "flights.csv", folder / "adopted"
        run_program(folder, "import", "flights", table, "--campaign", own, "-o", results)
    if case == "rocket":
        campaign = shipped_configs() / "simulator" / "campaign.yaml"
        python = campaign.parent / "python" / "rocket.py"
        (folder / "rocket.py").write_bytes(python.read_bytes())
        own = folder / "campaign.yaml"
        own.write_bytes(campaign.read_bytes())
        run_program(folder, "run", own, "-o", results, "--runs", 200, "--workers", 2)
    if case in (shipped := shipped_files("campaign")):
        run_program(folder, "run", shipped[case], "-o", results, "--runs", FLIGHTS, "--workers", 1)
    report = json.loads((results / "report.json").read_text("utf-8"))
    report.pop(_ON_A_NODE.get(case), None)
    return keep_numbers(report)


def make_outputs(case, folder):
    """Return exit codes of a quick case's commands, and the numbers that they print or write."""
    outputs: dict[str, Any] = {}
    if case == "sections":
        synthetic.write_campaign(folder / "s", runs=100, failing=12)
        models = Models(read_flown(folder / "s"))
        outputs = {
            text.name: list(describe_figure(figure))
            for figures in make_figures(models).values()
            for text, figure in figures
        }
    else:
        for name, entries in _CAMPAIGNS.items():
            write_fake(folder / name, **entries)
    (folder / "t.csv").write_text("altitude_error_max_m,speed_error_max_mps\n3,4\n9,2\n")
    (folder / "r.yaml").write_text(f"requirements: {_LIMITS.replace('3.4', '2')}")
    engine = replace(make_engine(), find_stability=None) if case == "physics" else ENGINE
    simulator = patch("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: engine)
    drawn: list[Any] = []
    canvas = patch(_CANVAS, lambda figure: drawn.append(figure) or FigureCanvasAgg(figure))
    with chdir(folder), simulator, canvas:
        for command in filter(None, map(str.strip, QUICK[case].splitlines())):
            with redirect_stdout(io.StringIO()) as printed:
                code = run_program(folder, *shlex.split(command))
            curves = [row for figure in drawn for row in describe_figure(figure)]
            outputs[command] = [int(code or 0), *read_printed(printed.getvalue()), *curves]
            drawn.clear()
    for path in sorted([*folder.glob("*.[jx]*"), *folder.glob("r/*.[ch]*")]):
        text = path.read_text("utf-8").rpartition('id="page-data">')[2].partition("</script>")[0]
        is_json = path.suffix in (".json", ".html")
        outputs[path.name] = json.loads(text) if is_json else list(read_printed(text))
    return keep_numbers(outputs)


def read_printed(text):
    """Yield the numbers, statuses and controllers in a text."""
    for part in _PRINTED.findall(text.replace("\u202f", "").replace("\u2212", "-")):
        yield part if part[-1].isalpha() else float(part)


def describe_figure(figure):
    """Yield the limits of each axes, and the number and weighted sums of the points of artists."""
    for axes in figure.axes:
        yield [*axes.get_xlim(), *axes.get_ylim()]
        yield [*read_printed(" ".join(text.get_text() for text in axes.texts))]
        points = [line.get_xydata() for line in axes.lines]
        points += [artist.get_offsets() for artist in axes.collections]
        points += [path.vertices for artist in axes.collections for path in artist.get_paths()]
        points += [patch.get_path().vertices * 1.0 for patch in axes.patches]
        for curve in points:
            values = np.nan_to_num(np.asarray(curve, float))
            yield [len(values), *(np.linspace(1.0, 2.0, len(values)) @ values).tolist()]


def keep_numbers(value):
    """Return a value of ``report.json`` without texts and entries that depend on the folder."""
    if isinstance(value, dict):
        return {
            name: keep_numbers(entry)
            for name, entry in value.items()
            if name not in _OTHER and not _is_text(entry)
        }
    if isinstance(value, list):
        return [keep_numbers(entry) for entry in value if not _is_text(entry)]
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}")
    return value


def _is_text(value):
    return isinstance(value, str) and not _STATUS.fullmatch(value)


def find_differences(stored, value, tolerance=_TOLERANCE, path=""):
    """Yield stored numbers and statuses that are missing or differ; new entries are ignored."""
    if isinstance(stored, dict) and isinstance(value, dict):
        for name, entry in stored.items():
            if name in value:
                own = tolerance * (_FACTOR if name == _AMPLIFIED else 1.0)
                yield from find_differences(entry, value[name], own, f"{path}/{name}")
            else:
                yield f"{path}/{name}: missing"
    elif isinstance(stored, list) and isinstance(value, list):
        if len(stored) != len(value):
            yield f"{path}: {len(value)} entries instead of {len(stored)}"
        for k, (entry, other) in enumerate(zip(stored, value, strict=False)):
            yield from find_differences(entry, other, tolerance, f"{path}/{k}")
    elif not _is_same(stored, value, tolerance):
        yield f"{path}: {value!r} instead of {stored!r}"


def _is_same(stored, value, tolerance):
    if isinstance(stored, float) and isinstance(value, float):
        return math.isclose(stored, value, rel_tol=tolerance, abs_tol=_ZERO)
    return type(stored) is type(value) and bool(stored == value)


def compare_report(case, folder):
    """Return the differences of a case's report, made in an empty folder, from the stored one."""
    tolerance = _TOLERANCES.get(case, _TOLERANCE)
    return list(find_differences(read_stored(case), make_report(case, folder), tolerance))


def read_stored(case):
    """Return the stored numbers of a case."""
    return json.loads(gzip.decompress((STORED / f"{case}.json.gz").read_bytes()))


def write_stored(case, numbers):
    """Store the numbers of a case, in the same bytes for the same numbers."""
    text = json.dumps(numbers, separators=(",", ":"))
    path = STORED / f"{case}.json.gz"
    path.write_bytes(gzip.compress(text.encode(), compresslevel=9, mtime=0))
    return path


def _renew():
    parser = argparse.ArgumentParser(description="Renew the stored numbers of small reports.")
    parser.add_argument(
        "--renew", nargs="*", metavar="NAME", choices=[*CASES, *QUICK], required=True
    )
    for case in parser.parse_args().renew or [*CASES, *QUICK]:
        with tempfile.TemporaryDirectory() as folder:
            numbers = make_report(case, Path(folder))
        stored = STORED / f"{case}.json.gz"
        moved = list(find_differences(read_stored(case), numbers)) if stored.exists() else ["new"]
        path = write_stored(case, numbers)
        print(f"{case}: {len(moved)} differences, {path.stat().st_size} bytes", flush=True)


if __name__ == "__main__":
    _renew()
