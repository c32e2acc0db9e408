"""The answer in sentences: who is better, against the strongest rival first."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from abhv_mc.flight.metrics import METRICS as RECORDS
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.comparison.sentences import closer_in, comparison_sentences
from abhv_mc.topics.topic import Models


@pytest.fixture
def models(flown):
    return Models(flown(80))


def said(models, changes):
    """The sentences where metrics of pairs are other ones: pair -> metric -> fields."""
    found = models[COMPARISON]
    pairs = {
        name: replace(
            pair, metrics={m: replace(e, **changes.get(name, {}).get(m, {})) for m, e in pair.metrics.items()}
        )
        for name, pair in found.pairs.items()
    }
    return comparison_sentences(replace(found, pairs=pairs), models.names)


def test_tails_and_lost_flights_that_contradict_the_median_make_no_winner(models):
    contradicted = {"winner": None, "mixed": True, "closer": "tlc", "loses_more": True}
    first = said(models, {key: {"sideslip_max_deg": contradicted} for key in models[COMPARISON].pairs})[0]
    assert first.startswith("Mixed: ")
    assert "undecided in max sideslip (TLC is closer on more flights but has more flights lost)" in first
    assert "no difference is shown in max altitude error" in first


def test_the_strongest_rival_comes_first(models):
    """The page began with the weakest rival: 'TLC is better', where a tuned LQR beats it in some errors."""
    won = {key: {"winner": "lqr_retuned", "mixed": False} for key in ("sideslip_max_deg", "speed_error_max_mps")}
    sentences = said(models, {"tlc - lqr_retuned": won})
    assert sentences[0].startswith("Mixed: against LQR retuned") and "worse on more flights in" in sentences[0]
    assert any(text.startswith("Against LQR, on the same") for text in sentences[1:])


def test_of_rivals_that_stand_alike_the_one_that_fails_less_comes_first(models):
    """The default campaign began with an unstable LQR where a sound one stood as well against TLC."""
    found = models[COMPARISON]
    alike = {m: {"winner": "tlc" if m == "sideslip_max_deg" else None, "mixed": False} for m in models.names.asked}
    pairs = {
        name: replace(
            pair, requirements=tuple(replace(e, both=40 * (pair.b == "lqr"), only_b=0) for e in pair.requirements)
        )
        for name, pair in found.pairs.items()
    }
    held = Models(models.results)
    held._held[COMPARISON.name] = replace(found, pairs=pairs)
    assert said(held, dict.fromkeys(pairs, alike))[0].startswith("TLC is better: against LQR retuned")


def test_each_angle_is_told_with_and_without_the_ramps():
    angles = ("angle_of_attack_error", "bank_error", "sideslip")
    whole = {record.name: record for record in RECORDS}
    settled = {f"{name}_own": replace(whole[f"{name}_rms_deg"], settled=True) for name in angles}
    windowed = {
        "late": replace(settled["bank_error_own"], start=10.0),
        "early": replace(whole["bank_error_rms_deg"], end=9.0),
    }
    pair = SimpleNamespace(metrics={name: SimpleNamespace(a_better=9, b_better=1) for name in {**whole, **settled}})
    pair.metrics["bank_error_rms_deg"] = pair.metrics["late"] = SimpleNamespace(a_better=3, b_better=7)
    pair.metrics["early"] = pair.metrics["bank_error_own"]
    found = closer_in(pair, SimpleNamespace(metrics={**whole, **settled, **windowed}))
    assert found == {(True, True): ["angle of attack", "sideslip"], (False, True): ["bank"]}
    assert closer_in(pair, SimpleNamespace(metrics=whole)) == {}
