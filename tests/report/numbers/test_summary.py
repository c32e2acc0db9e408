import copy
from dataclasses import replace

from topics.changed import changed

from abhv_mc.report.numbers.summary import summary_sentences
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.words import significant


def judged(models, **statuses):
    """The models with other verdicts of controllers."""

    def of(entry):
        told = {name: replace(entry.controllers[name], status=status) for name, status in statuses.items()}
        return replace(entry, controllers={**entry.controllers, **told})

    verdicts = models[VERDICTS]
    requirements = tuple(of(entry) for entry in verdicts.requirements)
    return changed(models, {VERDICTS: replace(verdicts, requirements=requirements)})


def test_the_first_sentence_says_who_wins_and_at_what_usage(models, report_json):
    numbers = copy.deepcopy(report_json)
    models = judged(models, lqr="NOT SHOWN")  # as its rival's: the campaign's order holds
    first = summary_sentences(models, numbers)[0]
    assert first.startswith("TLC is better: against LQR, on the same")
    cells = report_json["metrics"]["speed_error_max_mps"]["controllers"]
    worst = " and ".join(significant(cells[name]["worst"]) for name in ("tlc", "lqr"))
    assert "TLC is better on more flights in max speed error (closer on" in first
    assert f"; worst {worst} m/s)" in first
    assert "no difference is shown in max altitude error" in first
    usage = "TLC uses 10\u202f% more aileron, 10\u202f% more elevator and 10\u202f% more rudder"
    assert f"{usage} (rms, median of the flights' ratios)" in first


def test_tails_and_lost_flights_that_contradict_the_median_make_no_winner(models, report_json):
    numbers = copy.deepcopy(report_json)
    for pair in numbers["paired"].values():
        pair["metrics"]["sideslip_max_deg"] |= {"winner": None, "mixed": True, "closer": "tlc", "loses_more": True}
    first = summary_sentences(models, numbers)[0]
    assert first.startswith("Mixed: ")
    assert "undecided in max sideslip (TLC is closer on more flights but has more flights lost)" in first
    assert "no difference is shown in max altitude error" in first


def test_the_strongest_rival_comes_first(models, report_json):
    """The page began with the weakest rival: 'TLC is better', where a tuned LQR beats it in some errors."""
    numbers = copy.deepcopy(report_json)
    pair = numbers["paired"]["tlc - lqr_retuned"]
    for metric in ("sideslip_max_deg", "speed_error_max_mps"):
        pair["metrics"][metric] |= {"winner": "lqr_retuned", "mixed": False}
    sentences = summary_sentences(models, numbers)
    assert sentences[0].startswith("Mixed: against LQR retuned") and "worse on more flights in" in sentences[0]
    assert any(text.startswith("Against LQR, on the same") for text in sentences[1:])


def test_of_rivals_that_stand_alike_the_one_that_fails_less_comes_first(models, report_json):
    """The default campaign began with an unstable LQR where a sound one stood as well against TLC."""
    numbers = copy.deepcopy(report_json)
    for pair in numbers["paired"].values():
        for metric, entry in pair["metrics"].items():
            entry |= {"winner": "tlc" if metric == "sideslip_max_deg" else None, "mixed": False}
    models = judged(models, lqr="FAIL", lqr_retuned="NOT SHOWN")
    assert summary_sentences(models, numbers)[0].startswith("TLC is better: against LQR retuned")
