"""Which code flies: the source that a process has imported, not what lies on the disk by now."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import abhv_mc
from abhv_mc import identity

PACKAGE = Path(abhv_mc.__file__).parent
PACKAGES = sorted(folder.name for folder in PACKAGE.iterdir() if (folder / "__init__.py").is_file())
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
    """Asks a process that lives on which code it has, after it has imported a module."""
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
    return identity._join_hashes(tuple(identity.hash_source(source).items()))


def test_an_edit_of_each_package_is_another_identity_and_not_that_of_a_worker_left_alive(
    source, worker
):
    begun = worker("abhv_mc.io")
    assert begun == identity.code_hash()  # the place does not matter
    for name in PACKAGES:
        before = hash_now(source)
        edit(source / name)
        assert (hash_now(source) == before) == (name in SHOWN), name
        assert worker("abhv_mc.io") == begun


def test_a_worker_that_imports_edited_source_later_is_nobody_else(source, worker):
    begun = worker("abhv_mc.io")
    edit(source / "kernel" / "world")
    assert worker("abhv_mc.kernel.numerics") == begun
    mixed = worker("abhv_mc.kernel.world")
    assert mixed not in (begun, hash_now(source))
