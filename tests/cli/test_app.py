"""Tests of the command line application: help, exit codes, messages and imports."""

import errno
import io
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer
from programs import run_python

import abhv_mc
from abhv_mc.cli import options
from abhv_mc.cli.app import Command, app
from abhv_mc.cli.errors import ExitCode, exit_code_of
from abhv_mc.entry_points import VEHICLE
from abhv_mc.execution import progress
from abhv_mc.execution.progress import Progress, Waiting
from abhv_mc.execution.retry import UnusableError
from abhv_mc.folder.layout import StorageFullError
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_files
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX

HEAVY = {"duckdb", "matplotlib", "numba", "numpy", "pandas", "pyarrow", "pydantic", "scipy"}


def command_code(body, before=""):
    """Return a program whose only command is ``body``."""
    return (
        f"import os, signal, sys, time\n{before}\nfrom abhv_mc.cli import app\n"
        f"def command():\n    {body}\n"
        "app.app.command('command')(command)\nsys.argv = ['abhv-mc', 'command']; app.main()\n"
    )


def run_command(body, before="", stdout=subprocess.PIPE):
    """Run a program whose only command is ``body``, with standard output buffered as usual."""
    return subprocess.run(
        [sys.executable, "-c", command_code(body, before)],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=120.0,
        env=os.environ | {"PYTHONUNBUFFERED": ""},
    )


def test_version_and_help():
    output = run_python("-m", "abhv_mc", "--version").stdout
    assert output.startswith(f"abhv-mc {abhv_mc.__version__}\n") and "\nnumba " in output
    help_ = run_python("-m", "abhv_mc", "--help")
    assert help_.returncode == 0
    panels = re.split(r"╭─ (.+?) ─+╮", help_.stdout)
    commands = {
        panel: re.findall(r"^│ (\S+) ", text, re.MULTILINE)
        for panel, text in zip(panels[1::2], panels[2::2], strict=True)
        if panel != "Options"
    }
    assert len(commands["First day"]) == 6
    listed = {name for names in commands.values() for name in names}
    assert len(listed) <= 25
    for command in app.registered_commands:
        assert (command.name in listed) is not command.hidden


def test_long_options_are_at_most_58() -> None:
    commands = [typer.main.get_command(app)]
    for group in commands:  # Groups append their commands.
        names = group.list_commands(None) if hasattr(group, "list_commands") else ()
        commands += [group.get_command(None, name) for name in names]
    visible = [p for command in commands for p in command.params if not getattr(p, "hidden", False)]
    options = {name for p in visible for name in (*p.opts, *p.secondary_opts) if name[:2] == "--"}
    assert "--runs" in options and "--plans" not in options
    assert len(options) <= 58


@pytest.mark.parametrize("start", ["from abhv_mc.cli import app", "import abhv_mc; dir(abhv_mc)"])
def test_starting_imports_nothing_heavy(start):
    code = f"import sys; {start}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    assert HEAVY.isdisjoint(run_python("-c", code, check=True).stdout.split())


def of_cluster(message):
    """Return an error of the library distributed."""
    return type("CommError", (Exception,), {"__module__": "distributed.comm"})(message)


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (
            InputError(Path("x.yaml"), "0", "more than 0", 3, 7),
            2,
            "x.yaml:3:7: 0; expected more than 0",
        ),
        (KeyboardInterrupt(), 3, "interrupted"),
        (SystemExit(130), 3, "interrupted"),  # how typer reports an interrupt
        (RuntimeError("Query interrupted"), 3, "interrupted"),  # how DuckDB does
        (StorageFullError("x: full"), 3, "x: full"),
        (OSError(errno.ENOSPC, "No space left on device", "y.png"), 3, "y.png: "),
        (
            PermissionError(errno.EACCES, "Permission denied", "y.png"),
            2,
            "y.png: ",
        ),
        (MemoryError(), 3, "memory"),
        (OSError(errno.EMFILE, "Too many open files", "y"), 3, "ulimit -n"),
        (UnusableError("no flight"), 3, "no flight"),
        (ModuleNotFoundError("no module", name="other"), 70, "no module"),
        (ModuleNotFoundError("needs a package", name=VEHICLE), 2, "needs a package"),
        (FileNotFoundError(errno.ENOENT, "No such file", "y.png"), 70, "y.png"),
        (of_cluster("gone\nat 1"), 3, "(gone):"),
        (of_cluster(""), 3, "(CommError):"),
        (SystemExit(1), 1, ""),
        (ZeroDivisionError("by zero"), 70, "ZeroDivisionError: by zero"),
    ],
)
def test_exit_codes(error, code, message, capsys):
    assert exit_code_of(error) == code
    out, err = capsys.readouterr()
    assert message in err
    assert out == ""


# Python would end by the signal SIGINT during exec.
@pytest.mark.parametrize(("moment", "number"), [("exec({!r})", "SIGINT"), ("{}", "SIGTERM")])
def test_interrupt_leaves_with_incomplete(moment, number):
    default = (
        "signal.signal(signal.SIGINT, signal.default_int_handler)"  # ignored in a background job
    )
    answer = run_command(
        moment.format(f"os.kill(os.getpid(), signal.{number}); time.sleep(60)"), default
    )
    assert answer.returncode == ExitCode.INCOMPLETE
    assert answer.stderr.startswith("interrupted") and "Traceback" not in answer.stderr


def test_a_command_with_sql_prints_no_warning_at_exit():
    """duckdb reports objects that are not collected at exit as leaks."""
    answer = run_command("import duckdb; duckdb.connect().sql('select 1').fetchall()")
    assert (answer.returncode, answer.stderr) == (0, "")


@pytest.mark.parametrize("ending", ["", "; raise SystemExit(1)"])
def test_a_closed_output_is_not_reported_as_a_failed_requirement(ending):
    """`runs DIR | head -1` ended with exit code 1, which means that a requirement failed."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed:
        answer = run_command(f"print('words' * 100){ending}", stdout=closed)
        assert answer.returncode == (ExitCode.FAILED if ending else ExitCode.INCOMPLETE)
        assert "Traceback" not in answer.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a system without /dev/full")
def test_output_to_a_full_disk_is_reported():
    with Path("/dev/full").open("w") as full:
        program = [sys.executable, "-m", "abhv_mc", "--version"]
        answer = subprocess.run(
            program, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
        assert answer.returncode == ExitCode.INCOMPLETE
        assert "standard output:" in answer.stderr and "Traceback" not in answer.stderr
        assert (
            subprocess.run(program, stdout=full, stderr=full, check=False).returncode
            == ExitCode.INCOMPLETE
        )


def test_an_unwritable_log_does_not_stop_a_campaign():
    """A full disk or a closed standard error ended the campaign with exit code 1."""

    class FullLog(io.StringIO):
        def write(self, _):
            raise OSError(errno.ENOSPC, "No space left on device")

    with Progress("flights", 1, FullLog()) as progress, Waiting("compiling", FullLog()):
        progress.add(1)


def test_the_time_left_is_for_the_remaining_steps(monkeypatch):
    monkeypatch.setattr(progress, "_printed", [-1e9])
    display = Progress("flights", 4, log := io.StringIO())
    display._start -= 10.0
    display.add(1)
    assert "flights: 1 of 4 (25 %), 0/s, 30 s left" in log.getvalue()
    assert display.counts == (1, 4) and display.pace == pytest.approx((0.1, 30.0), rel=0.01)


@pytest.mark.parametrize("is_screen", [True, False])
def test_a_clock_runs_on_terminals_only(is_screen, monkeypatch):
    monkeypatch.setattr(progress, "_printed", [-1e9])
    screen = io.StringIO()
    screen.isatty = lambda: is_screen
    waiting, answers = Waiting("compiling", screen), iter([False, False, True])
    waiting._start -= 30.0
    waiting._over = SimpleNamespace(wait=lambda clock: next(answers), set=lambda: None)
    with waiting:
        pass
    first, *later = screen.getvalue().split("\r")
    assert first.startswith("compiling") and len(later) == 2 * is_screen
    assert (first[-1] == "\n") is not is_screen and screen.getvalue()[-1] == "\n"
    assert all(re.match(r"compiling: 3\d s", line) for line in later)


def test_other_operating_systems_are_rejected():
    """Run in a separate process, because many Python modules read the name of the system."""
    program = "import abhv_mc, os; os.name = 'nt'; import abhv_mc.cli"
    ended = run_python("-c", program)
    assert ended.returncode == 2
    assert "macOS" in ended.stderr and "Traceback" not in ended.stderr


def test_shells_complete_shipped_names_and_folders_of_campaigns(tmp_path):
    for name in ("flown", "empty"):
        (tmp_path / "reports" / name).mkdir(parents=True)
    (tmp_path / "reports/flown/manifest.json").touch()
    for typed, offered in (
        ("run s_man", "s_manoeuvre"),
        ("fly level --controllers tlc,lqr_robust_abh", "tlc,lqr_robust_abhv"),
        ("worst x --metric bank_error_settled", "bank_error_settled_max_deg"),
        ("report re", "reports/flown"),
    ):
        line = f"abhv-mc {typed}"
        request = {
            "_ABHV_MC_COMPLETE": "complete_bash",
            "COMP_WORDS": line,
            "COMP_CWORD": str(len(typed.split())),
        }
        answer = run_python("-m", "abhv_mc", env=os.environ | request, cwd=tmp_path)
        assert offered in answer.stdout.split(), answer.stderr
        assert "reports/empty" not in answer.stdout


def test_completions_begin_with_the_typed_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b", "a", "ab"):
        (tmp_path / "reports" / name).mkdir(parents=True)
        (tmp_path / "reports" / name / "manifest.json").touch()
    offered = options._complete_folder("reports/a")
    assert offered == ["reports/a", "reports/ab"]
    assert options._complete_folder("") == ["reports/a", "reports/ab", "reports/b"]
    assert options._complete_metric("bank_error_s") == [
        name for name in METRIC_INDEX if name.startswith("bank_error_s")
    ]
    laws = [f"tlc,{name}" for name in shipped_files("control") if name.startswith("lqr")]
    assert options._complete_controllers("tlc,lqr") == laws and len(laws) > 1
    names = {kind: [*shipped_files(kind)] for kind in ("mission", "vehicle")}
    complete = options.of_kinds(*names)["autocompletion"]
    assert complete("") == [*names["mission"], *names["vehicle"]]
    assert complete("gh") == [name for name in names["vehicle"] if name.startswith("gh")] != []


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_closed_standard_streams_change_no_exit_code(closed, tmp_path):
    """A file that is opened must not get the number of a stream, or printed text enters it."""
    body = (
        "from abhv_mc.cli.printing import say; file = open('out', 'w'); print('words'); "
        "say('words', file=sys.stderr); os.write(1, b'words'); os.write(2, b'words'); file.close()"
    )
    closing = " ".join(f"{number}>&-" for number in closed)
    done = subprocess.run(
        ["sh", "-c", f'exec "$0" -c "$1" {closing}', sys.executable, command_code(body)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "out").read_text()


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_terminal_without_unicode_gets_escapes(encoding):
    body = (
        "from abhv_mc.cli.printing import new_table, print_table, say; "
        "table = new_table(['angle \\u03b1'], ['n']); table.add_row('\\u2212', '1'); "
        "print_table(table); say('\\u03b1', file=sys.stderr); print('end')"
    )
    done = subprocess.run(
        [sys.executable, "-c", command_code(body)],
        capture_output=True,
        check=False,
        env=os.environ | {"PYTHONIOENCODING": encoding},
    )
    output = done.stdout.decode(encoding)
    assert done.returncode == 0 and output.rstrip().endswith("end"), done.stderr
    assert ("\\u03b1" in output) == (encoding != "utf-8") and "\\u2500" not in output


def test_a_container_without_a_home_runs_a_simulator(tmp_path):
    """All commands failed with `HOME=/` or without HOME; not even root can write in /dev/null."""
    names = ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "NUMBA_CACHE_DIR", "MPLCONFIGDIR")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    environment |= {"HOME": "/dev/null", "TMPDIR": str(tmp_path)}

    def run(*arguments):
        done = run_python("-m", "abhv_mc", *arguments, cwd=tmp_path, env=environment)
        assert done.returncode in (ExitCode.DONE, ExitCode.FAILED), done.stderr
        return done.stderr

    run("new", "mine", "--simulator", "python")
    errors = run("run", "mine/campaign.yaml", "--runs", "20", "-o", "out")
    assert errors.count("Set XDG_CACHE_HOME") == 1
    assert "temporary" not in errors  # a warning of matplotlib about its cache
    assert (tmp_path / "out" / "report.html").exists()
    assert (tmp_path / f"abhv-mc-{os.getuid()}").stat().st_mode & 0o077 == 0


def test_options_have_short_types_and_flags_have_none():
    group = typer.main.get_command(app)
    shown = {}
    for name in ("run", "worst", "report"):
        command = group.get_command(None, name)
        parameters = command.get_params(typer.Context(command))
        shown |= {(name, p.name): None if p.hidden else p.metavar for p in parameters if p.opts}
    expected = {
        **{("run", name): "N" for name in ("runs", "seed", "workers")},
        **{("run", name): "" for name in ("fresh", "trust_code", "check_workers", "no_report")},
        **{("run", "controllers"): "A,B", ("run", "shard"): "I/N", ("run", "scheduler"): "ADDRESS"},
        **{("run", "output"): "DIR", ("run", "plans"): None, ("run", "junit"): "FILE.xml"},
        **{("worst", "box"): "X", ("worst", "flights"): "N", ("worst", "bad"): ""},
        **{("worst", "metric"): "METRIC", ("worst", "controller"): "NAME"},
        **{("report", "svg"): None, ("report", "pdf"): "", ("report", "requirements"): "FILE"},
    }
    assert {key: shown[key] for key in expected} == expected


def test_paragraphs_of_a_help_are_joined_lines():
    assert (
        Command(
            "x",
            help="""a
        b

        c [m]
        d""",
        ).help
        == "a b\n\nc \\[m] d"
    )
    assert Command("x").help == ""
