"""A campaign's folder made to harm its reader: refused in words, by every command, and nothing outside is touched.

Whoever writes such a folder writes its hashes too: all of them are right here.
"""

import json
import os
import shutil
import signal
import sys
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, write_campaign

from abhv_mc.cli.app import main
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.flights import read_block, write_block
from abhv_mc.folder.layout import hash_file
from abhv_mc.folder.manifest import write_manifest
from abhv_mc.folder.samples import SampleReader
from abhv_mc.io.input_error import InputError
from abhv_mc.notebook import open_results
from abhv_mc.report.numbers.results import read_results
from abhv_mc.report.pages.build import _read_pages, is_up_to_date

BLOCK = "flights/one-000000000-000000020.parquet"
LIMIT = 20  # s; a command that waits for a pipe would wait for ever


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    keep = "{envelopes: {rate: 2 Hz, channels: [altitude_m]}}"
    campaign = write_campaign(root / "f", runs="40", keep=keep, execution="{batch: 20}")
    run_campaign(Request(campaign, root / "out"), ENGINE)
    return campaign, root / "out"


@pytest.fixture
def folder(flown, tmp_path):
    return shutil.copytree(flown[1], tmp_path / "x" / "out")


@pytest.fixture
def abhv_mc(monkeypatch, capfd, tmp_path):
    """Run the program within a time limit; gives exit code and all that it said."""
    for place in ("runner", "engine"):
        monkeypatch.setattr(f"abhv_mc.execution.{place}.make_engine", lambda: ENGINE)
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["abhv-mc", *map(str, words)])
        before = signal.signal(signal.SIGALRM, stop)
        signal.alarm(LIMIT)
        try:
            with pytest.raises(SystemExit) as caught:
                main()
        finally:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)
        return caught.value.code or 0, "".join(capfd.readouterr())

    return call


def stop(number, frame):
    raise AssertionError(f"not done in {LIMIT} s")


def commands(campaign, folder):
    """What people do with a folder that they were given; writing goes elsewhere."""
    yield "status", folder
    yield "list", folder.parent
    yield "query", folder, "select * from flights"
    yield "export", folder, "-o", "csv"
    yield "verify", "campaign", folder
    yield "compare", folder, folder
    yield "whatif", folder, "--set", "aero.lift.sigma=4%"
    yield "replay", folder, "--flight", 3, "--controller", "one"
    yield "explain", folder, "--flight", 3
    yield "merge", folder, "-o", "merged", "--no-report"
    yield "run", campaign, "-o", folder, "--no-report"


def sign(folder, **entries):
    """Hashes that fit what the folder holds, and entries of its manifest."""
    manifest = json.loads((folder / "manifest.json").read_text())
    held = {name: hash_file(folder / name) for name in manifest["files"] if (folder / name).is_file()}
    manifest |= {"files": manifest["files"] | held} | entries
    write_manifest(folder / "manifest.json", {key: value for key, value in manifest.items() if value is not ...})


def refuse(abhv_mc, campaign, folder, taken=()):
    """Every command ends in words; those that are not ``taken`` with exit code 2."""
    for words in commands(campaign, folder):
        copy = shutil.copytree(folder, folder.parent / "copy" / "out", symlinks=True)
        code, said = abhv_mc(*(copy if word == folder else word for word in words))
        assert "Traceback" not in said and "\x1b" not in said, (words, said)
        assert code in ((0, 1, 2) if words[0] in (*taken, "list", "merge", "compare") else (2,)), (words, code, said)
        shutil.rmtree(folder.parent / "copy")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"a":' * 100_000, "[]", '{"runs_done": ' + "9" * 5000 + "}", "\x00", '{"seed": NaN}']
)
def test_a_manifest_that_is_none(flown, folder, abhv_mc, text):
    (folder / "manifest.json").write_text(text)
    refuse(abhv_mc, flown[0], folder)


@pytest.mark.parametrize(
    "entries",
    [
        {"controllers": ["one"]},
        {"controllers": {"one": 3}},
        {"digest": 5},
        {"shard": "abc"},
        {"shard": [0, 0]},
        {"wall_time_s": float("nan")},
        {"machine": []},
        {"inputs": {"../../../../etc/passwd": "0"}},
        {"inputs": {"/etc/passwd": "0"}},
        {"files": {"../x": "0"}},
        {"files": {"a\x00b": "0"}},
        {"name": "\x1b]0;title\x07"},
        {"name": "../../evil"},
        {"state": "\x1b[31mred"},
        {"requirements": [{}]},
        {"runs_done": "many"},
        {"warnings": 5},
        {"seed": "<script>alert(1)</script>"},
    ],
)
def test_a_manifest_of_wrong_entries(flown, folder, abhv_mc, entries):
    sign(folder, **entries)
    refuse(abhv_mc, flown[0], folder)


@pytest.mark.parametrize("entry", ["campaign_hash", "versions", "inputs", "source_hash"])
def test_a_manifest_without_an_entry_is_not_gone_on_with(flown, folder, abhv_mc, entry):
    sign(folder, **{entry: ...})
    code, said = abhv_mc("run", flown[0], "-o", folder, "--no-report")
    assert code == 2 and "Traceback" not in said


@pytest.mark.parametrize("name", ["manifest.json", "campaign.yaml", "samples.parquet", ".lock", BLOCK])
def test_pipes_are_refused_and_not_waited_for(flown, folder, abhv_mc, name):
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    for words in commands(flown[0], folder):
        code, said = abhv_mc(*words)
        assert "Traceback" not in said and code in (
            (0, 1, 2) if words[0] in ("status", "list", "merge", "verify") else (2,)
        )


@pytest.mark.parametrize("kind", ["symbolic", "hard"])
@pytest.mark.parametrize("fresh", [(), ("--fresh",)])
def test_the_lock_empties_no_file_that_it_leads_to(flown, folder, abhv_mc, tmp_path, kind, fresh):
    victim = tmp_path / "victim"
    victim.write_text("kept")
    (folder / ".lock").unlink(missing_ok=True)
    (os.symlink if kind == "symbolic" else os.link)(victim, folder / ".lock")
    code, said = abhv_mc("run", flown[0], "-o", folder, "--no-report", *fresh)
    assert code == 2 and "Traceback" not in said and victim.read_text() == "kept"


@pytest.mark.parametrize("name", ["flights", "figures", "campaign.yaml", "plans"])
@pytest.mark.parametrize("target", ["{name}", "/dev/zero", "../..", "nowhere"])
def test_links_in_circles_to_devices_and_to_nothing(flown, folder, abhv_mc, name, target):
    place = folder / name
    shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
    place.symlink_to(target.format(name=name))
    for words in commands(flown[0], folder):
        code, said = abhv_mc(*words)
        assert "Traceback" not in said and code in (0, 1, 2), (words, said)


@pytest.mark.parametrize("key", ["vehicle", "mission", "controllers", "sampling", "channels", "metrics"])
@pytest.mark.parametrize("place", ["{outside}", "../../../{outside.name}"])
def test_a_campaign_that_leads_out_of_its_folder(flown, folder, abhv_mc, tmp_path, key, place):
    outside = tmp_path / "secret.yaml"
    outside.write_text("gain: 1.0\n")
    text = (folder / "campaign.yaml").read_text()
    where = place.format(outside=outside)
    if key == "controllers":
        changed = text.replace("inputs/controllers/one/one.yaml", where)
    elif key == "sampling":
        changed = text.replace("sampling: random", f"sampling: {{design: file, path: {where}}}")
    elif key in ("channels", "metrics"):
        changed = f"{text}{key}: {where}\n"
    else:
        changed = text.replace(f"inputs/{key}/{key}.yaml", where)
    assert changed != text
    (folder / "campaign.yaml").write_text(changed)
    sign(folder)
    with pytest.raises(InputError):
        read_results(folder)
    for words in commands(flown[0], folder):
        if words[0] in ("compare", "whatif", "verify", "explain", "run"):
            code, said = abhv_mc(*words)
            healed = words[0] == "run" and code == 0  # the campaign's own file is put there again
            assert (code == 2 or healed) and "Traceback" not in said and "gain" not in said, (words, said)


def change(table, name, values):
    return table.set_column(table.column_names.index(name), name, values)


def no_text(table):
    """A column of words that are no UTF-8, or what has no words as it is."""
    for name in table.column_names:
        if table.schema.field(name).type == pa.string():
            yield name, pa.array([b"\xff\xfe"] * len(table)).view(pa.string())
    yield table.column_names[0], table[table.column_names[0]]


TABLES = {
    "texts": lambda t: change(t, t.column_names[-1], pa.array(["x"] * len(t))),
    "lists": lambda t: change(t, t.column_names[-1], pa.array([[1.0]] * len(t))),
    "nothing": lambda t: change(t, t.column_names[0], pa.nulls(len(t))),
    "missing values": lambda t: change(t, t.column_names[-1], pa.array([None] * len(t), pa.float64())),
    "no rows": lambda t: t.slice(0, 0),
    "no columns": lambda t: t.select([]),
    "half the columns": lambda t: t.select(t.column_names[: len(t.column_names) // 2]),
    "more rows": lambda t: pa.concat_tables([t, t]),
    "unknown words": lambda t: change(t, t.column_names[2], pa.array(["\x1b[2Jlanded"] * len(t))),
    "hidden names": lambda t: t.rename_columns([*t.column_names[:-1], "aero.\u202elift"]),
    "bytes that are no text": lambda t: change(t, *next(no_text(t))),
    "huge numbers": lambda t: change(t, t.column_names[0], pa.array([2**62] * len(t))),
}


@pytest.mark.parametrize("kind", TABLES)
@pytest.mark.parametrize(
    "name", [BLOCK, "samples.parquet", "envelopes.parquet", "nominal.parquet", "reference.parquet"]
)
def test_tables_of_wrong_types_and_sizes(flown, folder, abhv_mc, name, kind):
    pq.write_table(TABLES[kind](pq.read_table(folder / name, partitioning=None)), folder / name)
    sign(folder)
    for words in commands(flown[0], folder):
        if words[0] not in ("status", "list", "merge"):
            code, said = abhv_mc(*words)
            assert code in (0, 1, 2) and "Traceback" not in said and "\x1b" not in said, (words, code, said)


@pytest.mark.parametrize(
    "name", [BLOCK, "histories/one-000000.parquet", "samples.parquet", "envelopes.parquet", "nominal.parquet"]
)
def test_pages_that_cannot_be_read(flown, folder, abhv_mc, name):
    content = bytearray((folder / name).read_bytes())
    with pq.ParquetFile(folder / name) as file:
        column = file.metadata.row_group(0).column(file.metadata.num_columns - 1)  # no words, which are read first
    start = column.data_page_offset
    content[start : start + column.total_compressed_size] = bytes(column.total_compressed_size)
    (folder / name).write_bytes(content)
    sign(folder)
    table = name.partition("/")[0].removesuffix(".parquet")
    with pytest.raises(InputError):
        getattr(open_results(folder), table)
    for words in (("report", folder), *commands(flown[0], folder)):
        if words[0] not in ("status", "list", "merge"):
            code, said = abhv_mc(*words)
            assert code in (0, 1, 2) and "Traceback" not in said, (words, code, said)


def test_a_footer_that_counts_rows_which_are_not_there(flown, folder, abhv_mc):
    path = folder / "reference.parquet"
    schema, rows = pq.read_schema(path), pq.read_metadata(path).num_rows
    pq.ParquetWriter(path, schema).close()
    content = path.read_bytes()
    counted = content.index(b"\x16\x00\x19")  # the third field, of 64 bits; zero; the fourth, a list
    path.write_bytes(content[: counted + 1] + bytes([2 * rows]) + content[counted + 2 :])
    assert pq.read_metadata(path).num_rows == rows < 64
    sign(folder)
    assert_refused(abhv_mc("report", folder), "rows")


@pytest.mark.parametrize(
    ("column", "word"), [("outcome", "landed"), ("outcome", "OK"), ("controller", "two"), ("controller", "")]
)
def test_words_that_no_campaign_writes_are_refused_by_every_reader(flown, folder, abhv_mc, column, word):
    table = pq.read_table(folder / BLOCK, partitioning=None)
    values = table[column].to_pylist()
    pq.write_table(change(table, column, pa.array([*values[:-1], word])), folder / BLOCK)
    sign(folder)
    for words in commands(flown[0], folder):
        if words[0] in ("query", "export", "compare", "whatif"):
            assert_refused(abhv_mc(*words), f"the {column} '{word}'")
    assert_refused(abhv_mc("report", folder), f"the {column} '{word}'")


@pytest.mark.parametrize(
    ("kind", "alter", "options", "words"),
    [
        ("rows in small groups", lambda t: t, {"row_group_size": 3}, "rows in groups of 3"),
        ("a nan", lambda t: change(t, "aero.lift", pa.array([np.nan] * len(t))), {}, "'aero.lift' that is no number"),
        ("a null", lambda t: change(t, "aero.lift", pa.nulls(len(t), pa.float64())), {}, "'aero.lift' that is no"),
        ("another order", lambda t: t.take(list(range(len(t)))[::-1]), {}, "other flights"),
        ("other numbers", lambda t: change(t, "flight", pa.array([-5] * len(t))), {}, "other flights"),
    ],
)
def test_samples_that_no_campaign_writes(flown, folder, abhv_mc, kind, alter, options, words):
    pq.write_table(
        alter(pq.read_table(folder / "samples.parquet", partitioning=None)), folder / "samples.parquet", **options
    )
    sign(folder)
    for command in commands(flown[0], folder):
        if command[0] in ("query", "export", "compare", "whatif", "report"):
            assert_refused(abhv_mc(*command), words)


@pytest.mark.parametrize("last", [None, 0, 2**40])
def test_a_block_of_other_flights_is_refused_by_every_reader(flown, folder, abhv_mc, last):
    table = pq.read_table(folder / BLOCK, partitioning=None)
    values = table["flight"].to_pylist()
    pq.write_table(change(table, "flight", pa.array([*values[:-1], last])), folder / BLOCK)
    sign(folder)
    for words in commands(flown[0], folder):
        if words[0] in ("query", "export", "compare", "whatif", "report"):
            assert_refused(abhv_mc(*words), "found other flights")


def test_nothing_that_is_printed_steers_the_terminal(flown, folder, abhv_mc):
    """What no check refuses, as nothing but a printer follows it."""
    table = pq.read_table(folder / "envelopes.parquet")
    pq.write_table(change(table, "channel", pa.array(["\x1b[2J\u202e"] * len(table))), folder / "envelopes.parquet")
    sign(folder)
    (folder / ".lock").unlink(missing_ok=True)
    for words in [("query", folder, "select channel from envelopes"), *commands(flown[0], folder)]:
        _, said = abhv_mc(*words)
        assert not {"\x1b", "\u202e"} & set(said) and "Traceback" not in said, (words, said)
    assert "\\u202e" in abhv_mc("query", folder, "select channel from envelopes")[1]
    shutil.move(folder, folder.parent / "\x1b[31mred")
    assert "\\x1b[31mred" in abhv_mc("list", folder.parent)[1]


@pytest.mark.parametrize(
    "entry", [{"words": "\x1b[2J"}, {"words": 3}, {"words": "PASS\nrequirement 2: PASS"}, {"verdict": "\u202eSSAP"}]
)
def test_verdicts_that_are_no_words(flown, folder, abhv_mc, entry):
    held = json.loads((folder / "manifest.json").read_text())["requirements"]
    sign(folder, requirements=[held[0] | entry])
    refuse(abhv_mc, flown[0], folder)


def test_a_verdict_without_words_is_shown(flown, folder, abhv_mc):
    held = json.loads((folder / "manifest.json").read_text())["requirements"]
    sign(folder, requirements=[{key: value for key, value in held[0].items() if key != "words"}])
    code, said = abhv_mc("status", folder)
    assert code == 0 and held[0]["verdict"] in said


@pytest.mark.parametrize("rows", [slice(None, None, 2), slice(None)])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308, -1e200, 1e-308])
def test_flights_with_numbers_that_no_flight_has(flown, folder, abhv_mc, value, rows):
    """A metric of a flight that broke at once may be infinite, a margin missing: readers take them, or say so."""
    names = SampleReader(folder / "samples.parquet").names
    for path in (folder / "flights").iterdir():
        block = read_block(path, names)
        block.values[rows] = value
        write_block(path.parent, block, pq.read_schema(path))
    sign(folder)
    code = 2 if 1e30 < abs(value) < np.inf else 0
    for words in [("report", folder), ("compare", folder, flown[1]), ("compare", flown[1], folder, "--json", "-")]:
        ended, said = abhv_mc(*words)
        assert ended == code and "Traceback" not in said and "Warning" not in said, (words, said)
    assert abhv_mc("query", folder, "select avg(fuel_used_kg) from flights")[0] in (0, 2)


LOOP = {"loop": "aileron", "stable": True, "gain_margin_low_db": -9.0, "gain_margin_high_db": 9.0}
LOOP |= {"phase_margin_deg": None, "delay_margin_ms": None}
ALL = {"loop": "all", "stable": True, "disk_gain_db": 1.0, "disk_phase_deg": 9.0, "delay_margin_ms": None}
ROWS = {"nominal": [LOOP, ALL], "corners": [], "corners_unstable": 0}


def steady(**entries):
    return {"corners": 0, "controllers": {"one": ROWS | entries}}


MARGINS = [
    [],
    {"controllers": 3},
    {"controllers": {"one": {}}},
    {"corners": 2, "controllers": {"one": {"nominal": []}}},
    {"controllers": {"one": ROWS}},
    steady(nominal=[ALL]),
    steady(nominal=[LOOP, {"loop": "all"}]),
    steady(nominal=[LOOP | {"gain_margin_low_db": "x"}, ALL]),
    steady(nominal=[LOOP, ALL | {"stable": False}]),
    steady(nominal=[LOOP, ALL | {"stable": False, "poles": [1.0]}]),
    steady(corners=[{}]),
    steady(corners=[{"loop": "all", "disk_gain_db": [1]}]),
    steady(corners_unstable=-1),
    {"corners": 0, "controllers": {"one": {"fault": "\x1b]0;title\x07"}}},
]


@pytest.mark.parametrize("margins", MARGINS)
def test_margins_that_no_campaign_wrote(flown, folder, abhv_mc, margins):
    (folder / "margins.json").write_text(json.dumps(margins))
    sign(folder, files=json.loads((folder / "manifest.json").read_text())["files"] | {"margins.json": ""})
    sign(folder)
    assert_refused(abhv_mc("report", folder), "margins.json")
    assert_refused(abhv_mc("compare", folder, folder), "margins.json")


@pytest.mark.parametrize("text", ["[" * 100_000, "NaN", '{"controllers": ' + "9" * 5000 + "}"])
def test_margins_that_are_no_json(flown, folder, abhv_mc, text):
    (folder / "margins.json").write_text(text)
    sign(folder, files=json.loads((folder / "manifest.json").read_text())["files"] | {"margins.json": ""})
    sign(folder)
    assert_refused(abhv_mc("report", folder), "margins.json")


@pytest.mark.parametrize("margins", [{}, steady(nominal=[LOOP, ALL | {"stable": False, "poles": [[1, 0]]}])])
def test_odd_margins_that_a_campaign_may_have(flown, folder, abhv_mc, margins):
    (folder / "margins.json").write_text(json.dumps(margins))
    sign(folder, files=json.loads((folder / "manifest.json").read_text())["files"] | {"margins.json": ""})
    sign(folder)
    assert abhv_mc("report", folder)[0] == 0


NO_REPORTS = ["[" * 100_000, "3", '{"pages": 5}', '{"files": {"../x": {}}}', "{}", '{"pages": ["/dev/zero"]}', "[]"]


def test_a_report_json_that_is_none(flown, folder, abhv_mc):
    for text in NO_REPORTS:
        (folder / "report.json").write_text(text)
        code, said = abhv_mc("verify", "campaign", folder)
        assert code in (1, 2) and "Traceback" not in said, text
        assert _read_pages(folder / "report.json", {}) == {} and not is_up_to_date(folder), text
    assert abhv_mc("report", folder)[0] == 0
    assert abhv_mc("verify", "campaign", folder)[0] == 0


def assert_refused(ended, words):
    code, said = ended
    assert code == 2 and words in said and "Traceback" not in said and "\x1b" not in said, said


def test_a_plan_that_unpacks_to_gigabytes_or_runs_code(flown, folder, abhv_mc, monkeypatch):
    monkeypatch.setattr("abhv_mc.folder.packed.MAX_BYTES", 2**20)
    plan = folder / "plans/one.npz"
    parts = dict(np.load(plan, allow_pickle=False))

    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(folder.parent / "executed"),)

    def bomb():
        with zipfile.ZipFile(plan, "w", zipfile.ZIP_DEFLATED) as packed, packed.open("gains.npy", "w") as member:
            for _ in range(2):
                member.write(bytes(2**20))

    def pickled():
        np.savez(plan, **parts | {"gains": np.array([Evil()], object)})

    def huge():
        header = (
            b"\x93NUMPY\x01\x00v\x00"
            + b"{'descr': '<f8', 'fortran_order': False, 'shape': (999999999999,), }".ljust(117)
            + b"\n"
        )
        with zipfile.ZipFile(plan, "w") as packed:
            packed.writestr("gains.npy", header)

    for damage in (bomb, pickled, huge):
        damage()
        sign(folder)
        code, said = abhv_mc("replay", folder, "--flight", 3, "--controller", "one")
        assert code == 2 and "damaged plan" in said and "Traceback" not in said
    assert not (folder.parent / "executed").exists()
