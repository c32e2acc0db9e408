"""The command line's frame: exit codes, what is said, and that starting is cheap."""

import errno
import io
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import abhv_mc
from abhv_mc.cli.app import app
from abhv_mc.cli.errors import ExitCode, exit_code_of
from abhv_mc.execution.progress import Progress, Waiting
from abhv_mc.folder.layout import StorageFullError
from abhv_mc.io.documents import InputError

HEAVY = {"duckdb", "matplotlib", "numba", "numpy", "pandas", "pyarrow", "pydantic", "scipy"}


def run_program(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "abhv_mc", *arguments], capture_output=True, text=True, check=False
    )


def command_code(body: str, before: str = "") -> str:
    """A program whose only command is ``body``."""
    return (
        f"import os, signal, sys, time\n{before}\nfrom abhv_mc.cli import app\n"
        f"def command():\n    {body}\n"
        "app.app.command('command')(command)\nsys.argv = ['abhv-mc', 'command']; app.main()\n"
    )


def run_command(
    body: str, before: str = "", stdout: Any = subprocess.PIPE
) -> subprocess.CompletedProcess[str]:
    """A program whose only command is ``body``, for standard output as it is buffered by default."""
    return subprocess.run(
        [sys.executable, "-c", command_code(body, before)],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=120.0,
        env=os.environ | {"PYTHONUNBUFFERED": ""},
    )


def test_version_and_help() -> None:
    said = run_program("--version").stdout
    assert said.startswith(f"abhv-mc {abhv_mc.__version__}\n") and "\nnumba " in said
    help_ = run_program("--help")
    assert help_.returncode == 0
    for command in app.registered_commands:
        assert (f" {command.name} " in help_.stdout) is not command.hidden
    panels = re.split(r"╭─ (.+?) ─+╮", help_.stdout)
    commands = {
        panel: re.findall(r"^│ (\S+) ", text, re.MULTILINE)
        for panel, text in zip(panels[1::2], panels[2::2], strict=True)
        if panel != "Options"
    }
    assert len(commands["First day"]) == 6
    assert sum(map(len, commands.values())) <= 24


@pytest.mark.parametrize("start", ["from abhv_mc.cli import app", "import abhv_mc; dir(abhv_mc)"])
def test_starting_imports_nothing_heavy(start: str) -> None:
    code = f"import sys; {start}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert HEAVY.isdisjoint(answer.stdout.split())


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (
            InputError(Path("x.yaml"), "0", "more than 0", 3, 7),
            2,
            "x.yaml:3:7: 0; expected more than 0",
        ),
        (KeyboardInterrupt(), 3, "interrupted"),
        (SystemExit(130), 3, "interrupted"),  # how typer reports an interrupt
        (RuntimeError("Query interrupted"), 3, "interrupted"),  # how DuckDB does
        (StorageFullError("x: no space left"), 3, "x: no space left"),
        (OSError(errno.ENOSPC, "No space left on device", "y.png"), 3, "y.png: no space left"),
        (
            PermissionError(errno.EACCES, "Permission denied", "y.png"),
            2,
            "y.png: the path cannot be written",
        ),
        (MemoryError(), 3, "not enough memory"),
        (FileNotFoundError(errno.ENOENT, "No such file", "y.png"), 70, "a defect"),
        (SystemExit(1), 1, ""),
        (ZeroDivisionError("by zero"), 70, "ZeroDivisionError: by zero"),
    ],
)
def test_exit_codes(
    error: BaseException, code: int | None, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code_of(error) == code
    out, err = capsys.readouterr()
    assert said in err
    assert out == ""


# Python would die by SIGINT where it hit exec.
@pytest.mark.parametrize(("moment", "number"), [("exec({!r})", "SIGINT"), ("{}", "SIGTERM")])
def test_interrupt_leaves_with_incomplete(moment: str, number: str) -> None:
    default = (
        "signal.signal(signal.SIGINT, signal.default_int_handler)"  # ignored in a background job
    )
    answer = run_command(
        moment.format(f"os.kill(os.getpid(), signal.{number}); time.sleep(60)"), default
    )
    assert answer.returncode == ExitCode.INCOMPLETE
    assert answer.stderr.startswith("interrupted") and "Traceback" not in answer.stderr


def test_a_command_that_asks_with_sql_ends_without_a_word():
    """What is not searched for garbage at the end is a leak to duckdb."""
    answer = run_command("import duckdb; duckdb.connect().sql('select 1').fetchall()")
    assert (answer.returncode, answer.stderr) == (0, "")


@pytest.mark.parametrize("ending", ["", "; raise SystemExit(1)"])
def test_output_that_nobody_reads_any_more_is_no_failed_requirement(ending):
    """`runs DIR | head -1` ended with exit code 1, which says that a requirement failed."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed:
        answer = run_command(f"print('words' * 100){ending}", stdout=closed)
        assert answer.returncode == (ExitCode.FAILED if ending else ExitCode.INCOMPLETE)
        assert "Traceback" not in answer.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a system without /dev/full")
def test_output_to_a_full_disk_is_told_as_that():
    with Path("/dev/full").open("w") as full:
        program = [sys.executable, "-m", "abhv_mc", "--version"]
        answer = subprocess.run(
            program, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
        assert answer.returncode == ExitCode.INCOMPLETE
        assert "standard output: no space left" in answer.stderr
        assert (
            subprocess.run(program, stdout=full, stderr=full, check=False).returncode
            == ExitCode.INCOMPLETE
        )


def test_a_log_that_takes_nothing_stops_no_campaign():
    """A full disk or a dead reader of standard error ended the campaign, with the code of a failed requirement."""

    class FullLog(io.StringIO):
        def write(self, _: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    with Progress("flights", 1, FullLog()) as progress, Waiting("compiling", FullLog()):
        progress.add(1)


def test_another_system_is_told_what_is_needed() -> None:
    """In a process of its own: much of Python looks at the system's name."""
    program = "import abhv_mc, os; os.name = 'nt'; import abhv_mc.cli"
    ended = subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True
    )
    assert ended.returncode == 2
    assert "Linux or macOS" in ended.stderr and "Traceback" not in ended.stderr


def test_a_shell_offers_shipped_names_and_the_folders_of_campaigns(tmp_path: Path) -> None:
    for name in ("flown", "empty"):
        (tmp_path / "reports" / name).mkdir(parents=True)
    (tmp_path / "reports/flown/manifest.json").touch()
    for words, offered in (
        ("run s_man", "s_manoeuvre"),
        ("fly level --controllers tlc,lqr_robust_abh", "tlc,lqr_robust_abhv"),
        ("worst x --metric bank_error_settled", "bank_error_settled_max_deg"),
        ("report re", "reports/flown"),
    ):
        typed = f"abhv-mc {words}"
        asked = {
            "_ABHV_MC_COMPLETE": "complete_bash",
            "COMP_WORDS": typed,
            "COMP_CWORD": str(len(words.split())),
        }
        program = [sys.executable, "-m", "abhv_mc"]
        told = subprocess.run(
            program,
            env=os.environ | asked,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert offered in told.stdout.split(), told.stderr
        assert "reports/empty" not in told.stdout


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_closed_standard_streams_change_no_exit_code(
    closed: tuple[int, ...], tmp_path: Path
) -> None:
    """A file that is opened then must not get the number of a stream: prints would land in it."""
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
def test_a_terminal_without_unicode_stops_no_command(encoding: str) -> None:
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
    shown = done.stdout.decode(encoding)
    assert done.returncode == 0 and shown.rstrip().endswith("end"), done.stderr
    assert ("\\u03b1" in shown) == (encoding != "utf-8") and "\\u2500" not in shown


def test_too_many_open_files_is_no_defect(capsys: pytest.CaptureFixture[str]) -> None:
    error = OSError(errno.EMFILE, os.strerror(errno.EMFILE), "flights/x.parquet")
    assert exit_code_of(error) == ExitCode.INCOMPLETE
    assert "ulimit -n" in capsys.readouterr().err


def test_a_container_without_a_home_runs_a_simulator(tmp_path: Path) -> None:
    """`HOME=/` and no HOME at all ended every command; /dev/null is a home in which even root makes no folder."""
    names = ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "NUMBA_CACHE_DIR", "MPLCONFIGDIR")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    environment |= {"HOME": "/dev/null", "TMPDIR": str(tmp_path)}

    def run(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "abhv_mc", *words],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in (ExitCode.DONE, ExitCode.FAILED), done.stderr
        return done.stderr

    run("new", "mine", "--simulator", "python")
    said = run("run", "mine/campaign.yaml", "--runs", "20", "-o", "out")
    assert said.count("Set XDG_CACHE_HOME") == 1
    assert "temporary" not in said  # as matplotlib warns of a folder that it makes itself
    assert (tmp_path / "out" / "report.html").exists()
    assert (tmp_path / f"abhv-mc-{os.getuid()}").stat().st_mode & 0o077 == 0
