"""Declared files of control laws are hashed and available; others are rejected by name."""

import ctypes
from contextlib import nullcontext
from importlib import metadata

import numba
import numpy as np
import pytest

from abhv_mc.custom_code import child
from abhv_mc.custom_code.source import UserSource, find_package_versions
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.kernel.flight.interface import Z_ROWS
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.user_code import compiled
from abhv_mc_vehicle.user_code import unpack as unpacking
from abhv_mc_vehicle.user_code.compiled import compile_law
from abhv_mc_vehicle.user_code.law_source import read_law_source
from abhv_mc_vehicle.user_code.module import _run_watched, check_closure
from abhv_mc_vehicle.user_code.unpack import unpack

HEAD = (
    "from pathlib import Path\nimport numpy as np\nfrom abhv_mc.extend import Command, controller\n"
)
LAW = """
@controller
def law(measured):
    return Command(K * measured.bank, 0.0, 0.0, 0.5)
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Return the source of a law with this text, and its declared ``files``."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # A child that other tests use later would keep this cache and compile everything again.
    monkeypatch.setattr(child, "_child", None)
    (tmp_path / "tables").mkdir()
    (tmp_path / "gains.csv").write_text("2.0\n")
    (tmp_path / "tables" / "more.csv").write_text("3.0\n")
    (tmp_path / "helper.py").write_text(
        "from constants import TWO\n\ndef twice(x):\n    return TWO * x\n"
    )
    (tmp_path / "constants.py").write_text("TWO = 2.0\n")

    def write_law(text, files="[]"):
        (tmp_path / "law.py").write_text(HEAD + text)
        (tmp_path / "law.yaml").write_text(f"law: python\nfile: law.py\nfiles: {files}\n")
        return read_law_source(read_controller(tmp_path / "law.yaml"))

    return write_law


def aileron(source, bank=0.25):
    """Return the command of the compiled law in one lane."""
    law = compile_law(source, (), 1)
    Z, row = np.zeros((Z_ROWS, 1)), np.zeros(len(REFERENCE))
    Z[s.M_BANK] = bank
    kind = ctypes.CFUNCTYPE(None, *5 * [ctypes.c_void_p], ctypes.c_int64, ctypes.c_double)
    kind(law.address)(None, Z.ctypes.data, *3 * [row.ctypes.data], 0, 0.01)
    return Z[s.CMD_AILERON, 0]


READS = (
    "K = float(np.loadtxt('gains.csv')) + float(np.loadtxt(Path(__file__).parent / 'tables' / "
    "'more.csv'))\n" + LAW
)


def test_declared_files_are_read_as_they_were_hashed(write, tmp_path):
    source = write(READS, "[gains.csv, tables/*.csv]")
    check_closure(source)
    (tmp_path / "gains.csv").write_text("99.0\n")  # edited meanwhile
    (unpack(source) / "gains.csv").write_text("98.0\n")  # in the cache, too
    unpack.cache_clear()
    assert aileron(source) == 5.0 * 0.25


def test_one_changed_byte_or_name_is_another_law(write, tmp_path):
    hashes = {write(READS, "[gains.csv, tables/]").hash}
    assert write(READS, "[gains.csv, tables/]").hash in hashes
    for name in ("gains.csv", "tables/more.csv"):
        (tmp_path / name).write_text("2.1\n")
        hashes.add(write(READS, "[gains.csv, tables/]").hash)
    hashes.add(write(READS + "#", "[gains.csv, tables/]").hash)
    (tmp_path / "tables" / "more.csv").rename(tmp_path / "tables" / "other.csv")
    hashes.add(write(READS, "[gains.csv, tables/]").hash)
    assert len(hashes) == 5


@pytest.mark.parametrize("imported", ["from helper import twice", "import helper"])
def test_modules_of_its_own_compile_with_it_and_are_no_other_laws(write, tmp_path, imported):
    use = "helper.twice" if imported == "import helper" else "twice"
    text = f"{imported}\nK = 1.0\n" + LAW.replace("K * measured.bank", f"{use}(measured.bank)")
    first = write(text, "[helper.py, constants.py]")
    check_closure(first)
    assert aileron(first) == 0.5
    (tmp_path / "constants.py").write_text("TWO = -3.0\n")
    assert aileron(write(text, "[helper.py, constants.py]")) == -0.75
    assert aileron(first) == 0.5


UNDECLARED = [
    ("K = float(np.loadtxt('gains.csv'))\n", 4, "opens 'gains.csv'", "files: [gains.csv]"),
    (
        "try:\n    K = open('gains.csv')\nexcept Exception:\n    K = 1.0\n",
        5,
        "opens 'gains.csv'",
        "gains",
    ),
    ("import undeclared\nK = 1.0\n", 4, "imports 'undeclared'", "files: [undeclared.py]"),
    ("from reads import K\n", 1, "opens '/nowhere/at/all.txt'", "nowhere"),
    (
        "import ctypes\nK = 1.0\nctypes.CDLL('./libmine.so')\n",
        6,
        "loads 'libmine.so'",
        "files: [libmine.so]",
    ),
    ("import ctypes\nK = 1.0\nctypes.string_at(0)\n", None, "SIGSEGV", ""),
]


@pytest.mark.parametrize(("text", "line", "problem", "expected"), UNDECLARED)
def test_what_it_does_not_declare_or_does_to_its_process_is_refused_with_the_line(
    write, tmp_path, text, line, problem, expected
):
    (tmp_path / "undeclared.py").touch()
    (tmp_path / "reads.py").write_text("K = open('/nowhere/at/all.txt')\n")
    source = write(text + LAW, "[reads.py]")
    with pytest.raises(InputError) as refused:
        check_closure(source)
    file = source.file if line != 1 else "reads.py"
    assert str(refused.value.file).endswith(file) and refused.value.line == line
    assert problem in refused.value.found and expected in refused.value.expected


def test_packages_and_what_it_wrote_itself_are_no_files_of_its_own(write):
    text = "import json, tempfile, scipy.linalg\nwith tempfile.TemporaryDirectory() as place:\n"
    text += (
        "    file = Path(place) / 'x'\n    file.write_text('4.0')\n    K = "
        "float(file.read_text())\n"
    )
    check_closure(write(text + LAW))


@pytest.mark.parametrize("is_installed", [True, False])
def test_packages_of_any_entry_of_the_path_may_be_imported(
    write, tmp_path, monkeypatch, is_installed
):
    """Site packages, PYTHONPATH and .pth files are allowed, but not modules of a study."""
    name = f"package_{is_installed}"
    (tmp_path / "site" / name).mkdir(parents=True)
    (tmp_path / "site" / name / "__init__.py").write_text("K = 4.0\n")
    if is_installed:
        (tmp_path / "site" / f"{name}-1.0.dist-info").mkdir()
    monkeypatch.syspath_prepend(tmp_path / "site")
    source = write(f"from {name} import K\n" + LAW)
    unpacking._allowed.cache_clear()
    try:
        with nullcontext() if is_installed else pytest.raises(InputError, match=name):
            _run_watched(source)
    finally:
        unpacking._allowed.cache_clear()


@pytest.mark.parametrize("entry", ["../law.yaml", "/etc/hosts", "nothing.csv"])
def test_entries_that_name_no_file_beside_the_law_are_refused(write, tmp_path, entry):
    with pytest.raises(InputError) as refused:
        write(LAW, f"[gains.csv, {entry}]")
    assert refused.value.line == 3 and entry in refused.value.found


IMPORTS = """
import math
import numpy as np
from mylaw.gains import K
def design(model, settings):
    from scipy.linalg import solve
"""


def test_packages_are_found_in_the_law_and_in_the_modules_that_it_declares():
    content = b"import yaml\nfrom . import more\n"
    files = ("law.py", IMPORTS.encode()), ("mylaw/gains.py", content), ("odd.py", b"print 1")
    sources = (
        UserSource(IMPORTS, "law.py", files),
        UserSource('{"law": "c", "library": null}', "law.c"),
    )
    versions = find_package_versions(sources)
    assert versions == {name: metadata.version(name) for name in ("numpy", "scipy", "PyYAML")}


def test_a_flipped_bit_of_a_compiled_law_is_not_executed(tmp_path, monkeypatch):
    """Regression: it ran another law, or crashed the process."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiled, "laws_folder", lambda: tmp_path / "laws")
    (tmp_path / "laws").mkdir()
    source = UserSource(HEAD + "K = 1.0\n" + LAW, str(tmp_path / "law.py"))

    def compile_it():
        compile_law.__wrapped__(source, (), 8)
        (cached,) = tmp_path.rglob("law_*.nbc")
        return cached, cached.read_bytes()

    cached, content = compile_it()
    assert compile_it() == (cached, content), "found in the cache"
    damaged = content[:-2000] + bytes([content[-2000] ^ 1]) + content[-1999:]
    cached.write_bytes(damaged)
    assert compile_it()[1] != damaged
