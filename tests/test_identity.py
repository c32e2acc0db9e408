"""Identity of the running code: the imported source, not the files on disk."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from programs import run_python

import abhv_mc
from abhv_mc import identity
from abhv_mc.entry_points import find_packages

PACKAGE = Path(abhv_mc.__file__).parent
PACKAGES = sorted(
    f"{init.parents[1].name}/{init.parent.name}"
    for package in (PACKAGE, PACKAGE.with_name("abhv_mc_vehicle"))
    for init in package.glob("*/__init__.py")
)
SHOWN = {"cli", "report", "topics"}

WORKER = """
import sys
from abhv_mc.identity import code_hash
for line in sys.stdin:
    __import__(line.strip())
    print(code_hash(), flush=True)
"""


@pytest.fixture
def worker(source):
    """Return a function that makes a running process import a module and return its code hash."""
    environment = {**os.environ, "PYTHONPATH": str(source.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", WORKER]
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:

        def ask(module):
            process.stdin.write(f"{module}\n")
            process.stdin.flush()
            return process.stdout.readline().strip()

        yield ask
        process.stdin.close()


def edit(package):
    file = package / "__init__.py"
    file.write_bytes(file.read_bytes() + b"#")


def hash_now(source):
    hashes = {}
    for name in ("abhv_mc", *find_packages()):
        folder = source.with_name(name)
        hashes |= identity.hash_source(folder if folder.exists() else PACKAGE.with_name(name))
    return identity._join_hashes(tuple(hashes.items()))


def test_an_edit_of_each_package_is_another_identity_and_not_that_of_a_worker_left_alive(
    source, worker
):
    begun = worker("abhv_mc.io")
    assert begun == identity.code_hash()  # the place does not matter
    for name in PACKAGES:
        before = hash_now(source)
        edit(source.parent / name)
        assert (hash_now(source) == before) == (name.partition("/")[2] in SHOWN), name
        assert worker("abhv_mc.io") == begun


def test_a_worker_that_imports_edited_source_later_is_nobody_else(source, worker):
    begun = worker("abhv_mc.io")
    edit(source.with_name("abhv_mc_vehicle") / "kernel" / "world")
    assert worker("abhv_mc_vehicle.kernel.numerics") == begun
    mixed = worker("abhv_mc_vehicle.kernel.world")
    assert mixed not in (begun, hash_now(source))


@pytest.mark.parametrize(("group", "shapes_rows"), [("executors", True), ("topics", False)])
def test_the_source_of_a_package_that_registers_an_executor_counts(tmp_path, group, shapes_rows):
    information = tmp_path / "plugin-1.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: plugin\nVersion: 1\n")
    (information / "entry_points.txt").write_text(f"[abhv_mc.{group}]\nmine = plugin:connect\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    program = "from abhv_mc.identity import code_hash; print(code_hash())"

    def code_hash(text):
        (tmp_path / "plugin.py").write_text(text)
        return run_python("-c", program, env=environment, check=True).stdout

    before = code_hash("1 / 0  # nobody imports it")
    assert (code_hash("1 / 0") != before) == shapes_rows
