"""The tables of channels, metrics and limits: every entry has a source that the kernel knows."""

import pytest

from abhv_mc.flight.channels import CHANNELS, REFERENCE_CHANNELS, SOURCES
from abhv_mc.flight.compile_metrics import compile_metrics, known_sources
from abhv_mc.flight.metrics import METRICS
from abhv_mc.flight.outcome import LIMITS, SENTENCES, Outcome
from abhv_mc.flight.plan import NO_SOURCES
from abhv_mc.kernel.flight import derived, observe
from abhv_mc.kernel.flight.memory import Z_ROWS
from abhv_mc.kernel.plant import state as s


def test_names_are_unique():
    for table in (CHANNELS, tuple(SOURCES.values()), METRICS, REFERENCE_CHANNELS):
        assert len({signal.name for signal in table}) == len(table)


@pytest.mark.parametrize("entry", [*SOURCES.values(), *LIMITS], ids=lambda entry: getattr(entry, "name", "limit"))
def test_every_source_has_a_row(entry):
    row = observe.find_row(entry.source)
    assert s.X <= row < Z_ROWS
    derived_row = row >= derived.FIRST_DERIVED
    assert derived_row == (entry.source in observe.DERIVED) == hasattr(derived, entry.source)


def test_rows_in_radians_become_degrees_and_derived_ones_stay():
    factors = {name: known.factor for name, known in known_sources(NO_SOURCES).items()}
    assert factors["sideslip_deg"] == factors["roll_rate_dps"] == pytest.approx(57.29578)
    assert factors["bank_error_deg"] == factors["altitude_m"] == 1.0


LOST = {Outcome.LAW_FAILED, Outcome.LAW_CRASHED, Outcome.LAW_HUNG}


def test_every_outcome_has_a_sentence_and_every_limit_an_outcome():
    assert set(SENTENCES) == set(Outcome)
    ends = {limit.outcome for limit in LIMITS}  # OK: the mission's own end by condition
    assert ends == set(Outcome) - {Outcome.NOT_FINITE, Outcome.FAILED_TO_RUN, *LOST}


def test_every_built_in_metric_is_counted_in_the_lean_loop():
    counted = compile_metrics(METRICS, known_sources(NO_SOURCES))
    assert counted.lean.place.tolist() == list(range(len(METRICS))) and not counted.programs.place.size
