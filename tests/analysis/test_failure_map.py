"""A fake campaign's failed flights are mapped by what makes the fake flight fail."""

import json

import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, LOST_BELOW, run, write_campaign

from abhv_mc.analysis.failure_map import MOST_FLIGHTS, map_failures, read_map, write_map
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.io.documents import InputError
from abhv_mc.topics.flights.model import rank_failed

REQUIREMENTS = "[{metric: altitude_error_max_m, below: 4.9, probability: 0.9, ended_early: as_measured}]"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    run(write_campaign(folder / "f", requirements=REQUIREMENTS), folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def mapped(flown):
    results = read_flown(flown)
    failed = {name: rank_failed(results, name) for name in results.controllers}
    return failed, map_failures(flown, failed, ENGINE)


def test_the_worst_failed_flights_are_mapped_each_once(flown, mapped):
    failed, found = mapped
    table = pq.read_table(flown / "flights").to_pandas().set_index(["controller", "flight"])
    for name, part in found.controllers.items():
        early = table.loc[name].query("outcome != 'ok'").sort_values("end_time_s", kind="stable").index
        assert list(early) == failed[name][: len(early)]  # as the report ranks them
        told = [flight for group in part.groups for flight in group.flights]
        assert sorted([*told, *part.nominal, *part.unexplained]) == sorted(failed[name][:MOST_FLIGHTS])
        assert part.failed == len(failed[name]) and part.looked_at == min(part.failed, MOST_FLIGHTS)


def test_an_early_end_is_the_low_density_and_nothing_else(flown, mapped):
    samples = pq.read_table(flown / "samples.parquet").to_pandas().set_index("flight")["atmosphere.density"]
    for part in mapped[1].controllers.values():
        (group,) = [group for group in part.groups if group.failure == "ended early"]
        (density,) = group.dispersions
        assert density.parameter == "atmosphere.density" and not density.high
        values = samples.loc[list(group.flights)]
        ends = (values.min(), values.median(), values.max())
        assert (density.least, density.median, density.largest) == pytest.approx(ends, rel=1e-12)
        assert density.largest < LOST_BELOW


def test_a_map_is_kept_for_its_flights_alone(flown, mapped):
    digest = read_manifest(CampaignFolder(flown).manifest).digest
    path = write_map(flown, mapped[1])
    assert read_map(flown, digest) == mapped[1] and read_map(flown, "another") is None
    held = path.read_text(encoding="utf-8")
    path.write_text(held.replace('"failed"', '"broken"'), encoding="utf-8")
    with pytest.raises(InputError, match="explain"):
        read_map(flown, digest)
    path.unlink()
    assert read_map(flown, digest) is None


@pytest.mark.thorough
def test_the_command_keeps_it_and_the_report_shows_it(flown, monkeypatch):
    from report.synthetic import build_with
    from typer.testing import CliRunner

    from abhv_mc.cli.app import app
    from abhv_mc.report.pages.build import is_up_to_date

    monkeypatch.setattr("abhv_mc.simulators.engine.make_engine", lambda: ENGINE)
    build_with(flown)
    assert is_up_to_date(flown)
    told = CliRunner().invoke(app, ["explain", str(flown), "--all", "--json", "-"])
    assert told.exit_code == 0, told.exception
    numbers = json.loads(told.stdout)
    assert not is_up_to_date(flown)
    page = build_with(flown).read_text(encoding="utf-8")
    assert json.loads((flown / "report.json").read_text(encoding="utf-8"))["failures"]["map"] == numbers
    flight = numbers["two"]["groups"][0]["flights"][0]
    assert "density low" in page and "--controller two --flight NUMBER</code>" in page
    assert f'data-show="two {flight}"' in page
    words = CliRunner().invoke(app, ["explain", str(flown), "--all", "--controller", "two"])
    assert "density low" in words.stdout
    assert list(json.loads((flown / "explained/failures.json").read_text(encoding="utf-8"))["controllers"]) == ["two"]
    for wrong in (["--all", "--flight", "1"], [], ["--all", "--controller", "three"]):
        assert CliRunner().invoke(app, ["explain", str(flown), *wrong]).exit_code != 0
