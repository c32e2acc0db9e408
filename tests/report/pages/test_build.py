"""Reports are made when something is new, and of campaigns that lost every flight."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from report.few_figures import build_with
from report.synthetic import sign, write_campaign

from abhv_mc.cli.running import finish
from abhv_mc.execution.runner import RunResult
from abhv_mc.folder.flights import flights_schema, read_pieces, write_block
from abhv_mc.folder.manifest import ControllerCount, Manifest, read_manifest
from abhv_mc.folder.samples import SampleReader
from abhv_mc.report.pages.build import build_report, is_up_to_date


@pytest.fixture(scope="module")
def lost(tmp_path_factory):
    """A campaign whose flights all ended early; no flight was there after 5 s."""
    folder = write_campaign(tmp_path_factory.mktemp("lost"), runs=30)
    names = SampleReader(folder / "samples.parquet").names
    for path in sorted((folder / "flights").glob("*.parquet")):
        ((rows, _),) = read_pieces(path, names)
        ended = replace(rows, outcome=("sideslip_limit",) * len(rows.outcome))
        write_block(folder / "flights", ended, flights_schema(names, {}))
    table = pq.read_table(folder / "envelopes.parquet")
    late = table["time"].to_numpy() > 5.0
    for i, name in enumerate(table.column_names[3:], 3):
        values = table[name].to_numpy()
        table = table.set_column(
            i, name, [np.where(late, 0 if name == "count" else np.nan, values).astype(values.dtype)]
        )
    pq.write_table(table, folder / "envelopes.parquet")
    sign(folder, read_manifest(folder / "manifest.json"))
    build_report(folder)
    return folder


def test_a_campaign_without_a_whole_flight_gets_its_report(lost):
    assert (lost / "report.html").is_file() and (lost / "figures/channels.png").is_file()


def test_a_second_run_with_nothing_new_does_not_make_the_report_again(lost, monkeypatch, capsys):
    """It took 12.5 s, almost all of them for the same report."""

    def never(*_):
        raise AssertionError("made again")

    monkeypatch.setattr("abhv_mc.report.pages.build.build_report", never)
    counts = {"tlc": ControllerCount({"sideslip_limit": 30})}
    manifest = Manifest("lost", "complete", 1, "", "", 30, 30, controllers=counts)
    finish(RunResult(lost, manifest), no_report=False)
    assert "report.html, up to date" in capsys.readouterr().out


def test_a_report_is_up_to_date_until_something_changes(lost):
    assert is_up_to_date(lost)
    for name in ("report.html", "manifest.json"):
        held = (lost / name).read_bytes()
        (lost / name).write_bytes(held + b" ")
        assert not is_up_to_date(lost), name
        (lost / name).write_bytes(held)
        assert is_up_to_date(lost)


def test_figures_are_svg_where_asked_for(lost):
    assert not list((lost / "figures").glob("*.svg"))
    build_with(lost, "channels", svg=True)
    assert [path.name for path in (lost / "figures").glob("*.svg")] == ["channels.svg"] and is_up_to_date(lost)
