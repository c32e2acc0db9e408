"""Blocks name the worker that computed them; workers with other code are rejected by name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import DENSITY, ENGINE, fly, make_plan, run, write_campaign

from abhv_mc.campaign.file.config import Execution
from abhv_mc.execution.attestation import Attestation, sign
from abhv_mc.execution.executor import open_executor
from abhv_mc.execution.retry import FlightLostError, UnusableError
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.identity import code_hash, this_flyer
from abhv_mc_vehicle.flight.fly import nominal_parameters

CHECKED = replace(ENGINE, source=code_hash(), checked=True)
ROWS = nominal_parameters(3)
ROWS[:, DENSITY] = 0.95, 1.0, 1.05


def flown(**changes):
    return replace(sign(fly(make_plan("one"), ROWS)), flown_by=(this_flyer()._replace(**changes),))


def test_a_worker_with_other_code_is_rejected_by_name():
    attestation = Attestation(CHECKED)
    attestation.check(make_plan("one"), ROWS, flown())
    with pytest.raises(UnusableError, match=r"\bnode7\b.*\b12\b.*\bold\b"):
        attestation.check(make_plan("one"), ROWS, flown(code="old", host="node7", process=12))
    with pytest.raises(UnusableError, match="version"):
        attestation.check(make_plan("one"), ROWS, fly(make_plan("one"), ROWS))


@pytest.mark.parametrize(
    ("every", "changes"), [(True, {}), (False, {"features": "other", "host": "node7"})]
)
def test_bits_are_compared_once_for_a_worker(every, changes, capfd):
    Attestation(CHECKED).check(
        make_plan("one"), ROWS, flown(host="node7")
    )  # processors of one kind are not compared
    assert not capfd.readouterr().err
    attestation, block = Attestation(CHECKED, every), flown(**changes)
    for _ in range(2):
        attestation.check(make_plan("one"), ROWS, block)
    assert capfd.readouterr().err.count("bit-identical") == 1
    other = replace(block, flown_by=(block.flown_by[0]._replace(process=1),))
    for name in ("outcome", "end_time", "metrics"):
        wrong = replace(other, **{name: np.nextafter(getattr(block, name), 9.0)})
        with pytest.raises(UnusableError, match=rf"\b{name}\b.*\bone\b"):
            Attestation(CHECKED, every).check(make_plan("one"), ROWS, wrong)


def test_the_manifest_lists_the_workers_of_all_flights(tmp_path):
    campaign = write_campaign(tmp_path / "f")
    manifest = run(campaign, tmp_path / "out", CHECKED).manifest
    (entry,) = manifest.flown_by
    flyer = this_flyer()
    assert (entry.code, entry.host, entry.versions) == (flyer.code, flyer.host, flyer.versions)
    assert entry.blocks == {"one": ((0, 300),), "two": ((0, 300),)}


def open_unsigned(engine, limit):
    """Open an executor that loses its first block and does not sign blocks."""
    lost = []

    def compute(plan, rows, recorded=None):
        if not lost:
            lost.append(rows)
            raise FlightLostError("the worker ended")
        return engine.fly(plan, rows, recorded)

    return SimpleNamespace(fly=compute, workers=1, close=lambda: None)


def test_an_executor_of_an_external_simulator_is_checked_and_may_lose_a_block():
    plan, execution = make_plan("one"), Execution()
    for checked in (False, True):
        engine = replace(CHECKED, checked=checked, close=lambda: None)
        with open_executor(engine, execution, None, open_unsigned) as executor:
            if checked:
                with pytest.raises(UnusableError, match="version"):
                    executor.fly(plan, ROWS)
            else:
                assert executor.fly(plan, ROWS).outcome.tolist() == [0, 0, 0]


@pytest.mark.parametrize(("workers", "expected"), [(None, 7), (3, 3)])
def test_the_number_of_workers_is_that_of_the_scheduler_unless_given(workers, expected):
    """Losses of an engine that records them are not divided into smaller blocks."""
    plan, sizes = make_plan("one"), []

    def open_lost(engine, limit):
        def compute(plan, rows, recorded=None):
            sizes.append(len(rows))
            raise FlightLostError("the worker ended")

        opened.append(limit)
        return SimpleNamespace(fly=compute, workers=7, close=lambda: opened.append("closed"))

    opened, execution = [], Execution(flight_time_limit="5 s")
    for records_lost, expected_sizes in ((True, [3, 3]), (False, [3, 3, 1, 1, 1, 1, 1, 1])):
        sizes.clear()
        engine = replace(ENGINE, records_lost=records_lost)
        with open_executor(engine, execution, workers, open_lost) as executor:
            assert executor.workers == expected
            if records_lost:
                with pytest.raises(UnusableError, match="the worker ended"):
                    executor.fly(plan, ROWS)
            else:
                assert (executor.fly(plan, ROWS).outcome == Outcome.FAILED_TO_RUN).all()
        assert sizes[:2] == expected_sizes[:2] and (len(sizes) == 2) == records_lost
    assert opened == [5.0, "closed"] * 2
