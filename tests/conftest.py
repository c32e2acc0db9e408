"""Fixtures and settings of all tests."""

import multiprocessing
import os
import shutil
import sys
from dataclasses import replace
from multiprocessing import forkserver
from pathlib import Path

import pytest
from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"  # figures without a display
os.environ.pop("COLUMNS", None)  # tables fold to a terminal of that width
# The matrices here are small, and workers share the cores: threads that wait for each other took
# half of the time. Linear algebra reads it when numpy is loaded, which nothing has done yet.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Worker processes find the fake flight as this one does.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")])
)

# What `make test` leaves to `make test-all`: tests that compile everything anew, fly for minutes,
# start clusters, servers or browsers, kill at random, or look at pages and benchmarks.
_THOROUGH = (
    "benchmarks",
    "vehicle/control/design/test_shipped_designs.py",
    "docs",
    "remote/test_cluster.py",
    "execution/test_faults.py",
    "execution/test_kill.py",
    "execution/test_user_code.py",
    "jsbsim_models/test_flight.py",
    "remote/test_store.py",
    "report/test_browser.py",
    "report/test_flights_view.py",
    "report/test_reading.py",
    "studies",
    "test_golden.py",
    "test_public_numba.py",
    "test_wheel.py",
)
# The same examples in each run: a suite that fails now and then teaches people to run it again.
settings.register_profile("repeatable", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def repository() -> Path:
    """Return the root of the checkout."""
    return Path(__file__).parents[1]


@pytest.fixture
def source(tmp_path):
    """Return a copy of the core's source, beside a copy of the vehicle's."""
    import abhv_mc

    skip = shutil.ignore_patterns("__pycache__", "shipped_files")
    package = Path(abhv_mc.__file__).parent
    for name in ("abhv_mc_vehicle", "abhv_mc"):
        copy = shutil.copytree(package.with_name(name), tmp_path / "source" / name, ignore=skip)
    return copy


@pytest.fixture(scope="session")
def engine():
    """Return the engine of the compiled flight; plans of shipped inputs are made once."""
    from plans_once import prepare_once

    from abhv_mc_vehicle.vehicle_simulator.simulator import make_engine

    return replace(make_engine(), prepare=prepare_once)


@pytest.fixture(scope="session")
def flights_only(engine):
    """Return the engine without margins at the corners.

    These take as long as hundreds of flights.
    """
    return replace(engine, find_stability=None)


@pytest.fixture
def no_figures(monkeypatch):
    """Make reports without figures, which take most of the time."""
    monkeypatch.setattr("abhv_mc.topics.registry.make_figures", lambda models: {})


@pytest.fixture
def own_list(monkeypatch, tmp_path):
    """Use an empty list of trusted code."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.fixture
def fake_engine(monkeypatch, tmp_path):
    """Let commands run fake flights in an empty folder."""
    from fake_flight import ENGINE

    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: ENGINE)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="session")
def failing_folder(tmp_path_factory):
    """Write a synthetic campaign of 100 flights of three controllers.

    Of all but the first, 12 flights terminate early.
    """
    from report.synthetic import write_campaign

    return write_campaign(tmp_path_factory.mktemp("failing") / "campaign", runs=100, failing=12)


@pytest.fixture(scope="session")
def failing(failing_folder):
    from abhv_mc.folder.flown_campaign import read_flown

    return read_flown(failing_folder)


@pytest.fixture(scope="session")
def failing_numbers(failing):
    """Return the numbers of its report."""
    from abhv_mc.report.numbers.report_numbers import make_numbers
    from abhv_mc.topics.topic import Models

    return make_numbers(Models(failing))


@pytest.fixture(scope="session", autouse=True)
def _fork_server():
    """Start one fork server for all engines, so that workers need not import for seconds."""
    ours = ["abhv_mc.execution.worker", "abhv_mc.execution.runner", "abhv_mc_vehicle.flight.fly"]
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["fake_flight", *ours, "scipy.stats", "joblib"])
    forkserver.ensure_running()


def _is_thorough(path: Path) -> bool:
    return path.relative_to(Path(__file__).parent).as_posix().startswith(_THOROUGH)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out thorough files whose tests are deselected, because their imports take seconds."""
    return (config.option.markexpr == "not thorough" and _is_thorough(collection_path)) or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark thorough tests, and sort those first that compile for minutes while others wait."""
    for item in items:
        if _is_thorough(item.path):
            item.add_marker(pytest.mark.thorough)
    items.sort(key=lambda item: item.path.name not in ("test_public_numba.py", "test_wheel.py"))


@pytest.fixture
def abhv_mc(monkeypatch, capfd):
    """Return a function that runs the program: exit code, standard output, standard error."""

    from programs import words_of

    from abhv_mc.cli.app import main

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["abhv-mc", *words_of(*arguments)])
        with pytest.raises(SystemExit) as caught:
            main()
        out, err = capfd.readouterr()
        return caught.value.code or 0, out, err

    return call
