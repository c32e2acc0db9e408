"""The command line's frame: exit codes, what is said, and that starting is cheap."""

import ast
import errno
import io
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import abhv_mc
from abhv_mc.cli.app import app
from abhv_mc.cli.errors import ExitCode, exit_code_of
from abhv_mc.execution.progress import Progress
from abhv_mc.folder.layout import FolderLostError, StorageFullError
from abhv_mc.io.documents import InputError

HEAVY = {"duckdb", "matplotlib", "numba", "numpy", "pandas", "plotly", "pyarrow", "pydantic", "scipy"}


def run_program(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "abhv_mc", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | environment,
    )


def test_version_and_help() -> None:
    assert run_program("--version").stdout == f"abhv-mc {abhv_mc.__version__}\n"
    assert f"abhv-mc {abhv_mc.__version__}\n" in run_program("version").stdout
    help_ = run_program("--help")
    assert help_.returncode == 0
    for command in app.registered_commands:
        assert f" {command.name} " in help_.stdout


def test_unknown_command_is_bad_input() -> None:
    answer = run_program("fyl")
    assert answer.returncode == ExitCode.BAD_INPUT
    assert "fyl" in answer.stderr
    assert answer.stdout == ""


def test_starting_imports_nothing_heavy() -> None:
    code = "import sys; from abhv_mc.cli import app; print(*{name.partition('.')[0] for name in sys.modules})"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert HEAVY.isdisjoint(answer.stdout.split())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shell_completion(shell: str) -> None:
    answer = run_program(_ABHV_MC_COMPLETE=f"source_{shell}", _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert answer.returncode == 0
    assert "_ABHV_MC_COMPLETE" in answer.stdout


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (InputError(Path("x.yaml"), 3, 7, "0", "more than 0"), 2, "x.yaml:3:7: found 0; wanted more than 0"),
        (KeyboardInterrupt(), 3, "interrupted"),
        (SystemExit(130), 3, "interrupted"),  # how typer reports an interrupt
        (StorageFullError("x: no space left"), 3, "x: no space left"),
        (OSError(errno.ENOSPC, "No space left on device", "y.png"), 3, "y.png: no space left"),
        (OSError(errno.ENOSPC, "No space left on device"), 3, "standard output: no space left"),
        (OSError(errno.EMFILE, "Too many open files", "y.ttf"), 3, "too many open files"),
        (OSError(errno.EFBIG, "File too large", "y.png"), 3, "y.png: no space left"),
        (PermissionError(errno.EACCES, "Permission denied", "y.png"), 2, "y.png: found a place that cannot be written"),
        (FileNotFoundError(errno.ENOENT, "No such file", "y.png"), 3, "y.png: not there when it was needed"),
        (FileNotFoundError(errno.ENOENT, "No such file", str(Path(abhv_mc.__file__).with_name("y"))), 70, "a defect"),
        (SystemExit(1), 1, ""),
        (SystemExit(None), None, ""),
        (ZeroDivisionError("by zero"), 70, "ZeroDivisionError: by zero"),
    ],
)
def test_exit_codes(error: BaseException, code: int | None, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code_of(error) == code
    out, err = capsys.readouterr()
    assert said in err
    assert out == ""


@pytest.mark.parametrize(
    "moment",
    [
        "os.kill(os.getpid(), signal.SIGINT)",
        "os.kill(os.getpid(), signal.SIGTERM)",
        # Python drops what a finalizer raises, and dies by SIGINT where it hit exec.
        "type('A', (), {'__del__': lambda self: os.kill(os.getpid(), signal.SIGINT)})(); time.sleep(60)",
        "exec('os.kill(os.getpid(), signal.SIGINT); time.sleep(60)')",
    ],
)
def test_interrupt_leaves_with_incomplete(moment: str) -> None:
    code = (
        "import os, signal, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell has it ignored in what it runs aside
        "from abhv_mc.cli import app\n"
        f"def wait():\n    {moment}\n"
        "app.app.command('wait')(wait)\n"
        "import sys; sys.argv = ['abhv-mc', 'wait']; app.main()\n"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert answer.returncode == ExitCode.INCOMPLETE != -signal.SIGINT
    assert answer.stderr.startswith("interrupted") and "Traceback" not in answer.stderr


def test_threads_without_memory_a_working_folder_that_went_and_long_names_are_no_defects(capsys, tmp_path, monkeypatch):
    for words in ("can't start new thread", "Unknown error: Failed to launch worker thread: Resource unavailable"):
        assert exit_code_of(RuntimeError(words)) == ExitCode.INCOMPLETE
    assert exit_code_of(OSError(errno.ENAMETOOLONG, "File name too long", "a" * 5000)) == ExitCode.BAD_INPUT
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError) as error:
        Path.cwd()
    assert exit_code_of(error.value) == ExitCode.BAD_INPUT
    said = capsys.readouterr().err
    assert "not enough memory" in said and "was deleted" in said and "Traceback" not in said


def test_a_name_that_is_not_utf_8_is_refused(capsys):
    from abhv_mc.folder.layout import CampaignFolder

    with pytest.raises(InputError, match="UTF-8"):
        CampaignFolder(Path("out\udcff"))


def test_a_second_interrupt_while_the_first_is_told_ends_with_incomplete():
    code = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from abhv_mc.cli import app\n"
        "first = app.exit_code_of\n"
        "def told(error):\n    os.kill(os.getpid(), signal.SIGINT)\n    return first(error)\n"
        "app.exit_code_of = told\n"
        "app.app.command('wait')(lambda: os.kill(os.getpid(), signal.SIGINT))\n"
        "sys.argv = ['abhv-mc', 'wait']; app.main()\n"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert answer.returncode == ExitCode.INCOMPLETE and "Traceback" not in answer.stderr


def test_no_memory_and_a_cluster_that_dies_are_no_defects(capsys):
    class CommClosedError(OSError):
        pass

    CommClosedError.__module__ = "distributed.comm.core"
    for error in (MemoryError(), CommClosedError("in <TCP>: Stream is closed"), FolderLostError("out: gone")):
        assert exit_code_of(error) == ExitCode.INCOMPLETE
    said = capsys.readouterr().err
    assert "not enough memory" in said and "cluster" in said and "Traceback" not in said


def raised_from(error, cause):
    try:
        try:
            raise cause
        except BaseException:
            raise error  # noqa: B904  # as a library does
    except BaseException as raised:
        return raised


def test_libraries_that_are_loaded_without_memory_or_into_an_interrupt_are_no_defects(capsys):
    """An extension module that is being initialised makes an ImportError of a Ctrl-C."""
    error = raised_from(ImportError("initialization failed"), KeyboardInterrupt())
    assert exit_code_of(error) == ExitCode.INCOMPLETE
    error = raised_from(OSError("Could not find/load shared object file"), OSError("x.so: failed to map segment"))
    assert exit_code_of(error) == ExitCode.INCOMPLETE
    said = capsys.readouterr().err
    assert "interrupted" in said and "not enough memory" in said and "Traceback" not in said
    assert exit_code_of(raised_from(KeyError("x"), KeyboardInterrupt())) == ExitCode.DEFECT
    assert exit_code_of(raised_from(ImportError("no such module"), KeyError())) == ExitCode.DEFECT


@pytest.mark.parametrize(
    "setting", ["SOURCE_DATE_EPOCH=x", "MPLBACKEND=x", "NUMBA_NUM_THREADS=0", "JOBLIB_MULTIPROCESSING=x"]
)
def test_a_setting_that_a_library_does_not_take_is_named(setting, tmp_path):
    name, _, value = setting.partition("=")
    code = "import scipy.stats, matplotlib, numba.np.ufunc.parallel, joblib"
    code = f"import sys\nfrom abhv_mc.cli.errors import exit_code_of\ntry:\n    {code}\nexcept Exception as error:"
    code += "\n    sys.exit(exit_code_of(error))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {name: value}, capture_output=True, text=True, check=False
    )
    assert done.returncode == ExitCode.BAD_INPUT and setting in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("content", ["- a list", "broken: [", "3: 4", "num_threads: 0"])
def test_a_file_of_settings_that_numba_does_not_take_is_named(content, tmp_path):
    pytest.importorskip("yaml")
    (tmp_path / ".numba_config.yaml").write_text(content)
    program = [sys.executable, "-m", "abhv_mc", "fly", "level"]
    environment = os.environ | {"PYTHONPATH": str(Path(abhv_mc.__file__).parents[1])}
    done = subprocess.run(program, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == ExitCode.BAD_INPUT, done.stderr
    assert ".numba_config.yaml" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("ending", ["", "; sys.stdout.flush()", "; raise SystemExit(1)", "; 1 / 0"])
def test_output_that_nobody_reads_any_more_is_no_failed_requirement(ending):
    """`status DIR | head -1` ended with exit code 1, which says that a requirement failed."""
    code = (
        "import sys\n"
        "from abhv_mc.cli import app\n"
        f"def talk():\n    print('words' * 100){ending}\n"
        "app.app.command('talk')(talk)\n"
        "sys.argv = ['abhv-mc', 'talk']; app.main()\n"
    )
    environment = os.environ | {"PYTHONUNBUFFERED": ""}  # else nothing is left to write at the end
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed:
        program = [sys.executable, "-c", code]
        answer = subprocess.run(program, stdout=closed, stderr=subprocess.PIPE, text=True, check=False, env=environment)
        wanted = {"; raise SystemExit(1)": ExitCode.FAILED, "; 1 / 0": ExitCode.DEFECT}.get(ending, ExitCode.INCOMPLETE)
        assert answer.returncode == wanted
        assert ("Traceback" in answer.stderr) == (wanted == ExitCode.DEFECT)
        if wanted == ExitCode.DEFECT:  # the code does not depend on whether it can be told
            assert (
                subprocess.run(program, stdout=closed, stderr=closed, check=False, env=environment).returncode == wanted
            )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a system without /dev/full")
def test_output_to_a_full_disk_is_told_as_that():
    with Path("/dev/full").open("w") as full:
        program = [sys.executable, "-m", "abhv_mc", "--version"]
        answer = subprocess.run(program, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        assert answer.returncode == ExitCode.INCOMPLETE
        assert "standard output: no space left" in answer.stderr
        assert subprocess.run(program, stdout=full, stderr=full, check=False).returncode == ExitCode.INCOMPLETE


def test_a_log_that_takes_nothing_stops_no_campaign():
    """A full disk or a dead reader of standard error ended the campaign, with the code of a failed requirement."""

    class FullLog(io.StringIO):
        def write(self, _: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    with Progress("flights", 1, FullLog()) as progress:
        progress.add(1)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_locale_that_lacks_characters_shows_their_escapes(encoding):
    """Tables have lines that Latin-1 lacks: they ended with a traceback and exit code 70."""
    arguments = ("trim", "ghame_x", "--altitude", "20km", "--speed", "1400")
    answer = run_program(*arguments, PYTHONIOENCODING=encoding)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert "3.519" in answer.stdout and "\\u2500" in answer.stdout


def test_every_command_prints_through_what_escapes():
    """`say`, which shows a character that would steer the terminal as an escape."""
    folder = Path(abhv_mc.__file__).parent / "cli"
    calls = {
        path.name
        for path in folder.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Name) and node.id == "print"
    }
    assert calls == {"printing.py", "__init__.py"}  # the latter on systems on which it does not run
