import copy

from abhv_mc.report.numbers.confidence import sureness_sentence
from abhv_mc.report.numbers.summary import summary_sentences


def test_the_first_sentence_says_who_wins_and_at_what_usage(report_json):
    numbers = copy.deepcopy(report_json)
    for entry in numbers["requirements"]:
        entry["controllers"]["lqr"]["status"] = "NOT SHOWN"  # as its rival's: the campaign's order holds
    first = summary_sentences(numbers)[0]
    assert first.startswith("TLC is better: against LQR, on the same")
    medians = {
        name: cell["q50"]["value"]
        for name, cell in report_json["metrics"]["speed_error_max_mps"]["controllers"].items()
    }
    assert "TLC is better on more flights in max speed error (closer on" in first
    assert f"medians {medians['tlc']:.1f} and {medians['lqr']:.1f} m/s)" in first
    assert "no difference is shown in max altitude error" in first
    usage = "TLC uses 10\u202f% more aileron, 10\u202f% more elevator and 10\u202f% more rudder"
    assert f"{usage} (rms, median of the flights' ratios)" in first


def test_early_ends_are_told(failing_numbers):
    sentences = summary_sentences(failing_numbers)
    assert sentences[0].startswith(
        "TLC loses fewer flights than LQR: 0 of 100 ended early against 12 (0 under TLC alone"
    )
    (lqr,) = (text for text in sentences if text.startswith("LQR: "))
    assert "12 of 100 flights ended early, 100\u202f% of them where density > +" in lqr


def test_tails_and_lost_flights_that_contradict_the_median_make_no_winner(report_json):
    numbers = copy.deepcopy(report_json)
    for pair in numbers["paired"].values():
        pair["metrics"]["sideslip_max_deg"] |= {"winner": None, "mixed": True, "closer": "tlc", "loses_more": True}
    first = summary_sentences(numbers)[0]
    assert first.startswith("Mixed: ")
    assert "undecided in max sideslip (TLC is closer on more flights but has more flights lost)" in first
    assert "no difference is shown in max altitude error" in first


def test_the_risk_is_of_the_rule_not_of_the_result(report_json):
    text = sureness_sentence(report_json)
    assert "A system that just misses a requirement would ever PASS with a probability of at most 10\u202f%" in text
    assert "wrong" not in text


def test_an_unfinished_campaign_is_preliminary(report_json):
    assert "preliminary" not in sureness_sentence(report_json)
    assert "preliminary" in sureness_sentence({**report_json, "state": "interrupted"})


def test_dependent_flights_are_told(report_json):
    campaign = {**report_json["campaign"], "independent_flights": False, "sampling": "sobol"}
    assert "no verdict" in sureness_sentence({**report_json, "campaign": campaign})


def test_the_strongest_rival_comes_first(report_json):
    """The page began with the weakest rival: 'TLC is better', where a tuned LQR beats it in some errors."""
    numbers = copy.deepcopy(report_json)
    pair = numbers["paired"]["tlc - lqr_retuned"]
    for metric in ("sideslip_max_deg", "speed_error_max_mps"):
        pair["metrics"][metric] |= {"winner": "lqr_retuned", "mixed": False}
    sentences = summary_sentences(numbers)
    assert sentences[0].startswith("Mixed: against LQR retuned") and "worse on more flights in" in sentences[0]
    assert any(text.startswith("Against LQR, on the same") for text in sentences[1:])


def test_of_rivals_that_stand_alike_the_one_that_fails_less_comes_first(report_json):
    """The default campaign began with an unstable LQR where a sound one stood as well against TLC."""
    numbers = copy.deepcopy(report_json)
    for pair in numbers["paired"].values():
        for metric, entry in pair["metrics"].items():
            entry |= {"winner": "tlc" if metric == "sideslip_max_deg" else None, "mixed": False}
    for entry in numbers["requirements"]:
        entry["controllers"]["lqr"]["status"] = "FAIL"
        entry["controllers"]["lqr_retuned"]["status"] = "NOT SHOWN"
    assert summary_sentences(numbers)[0].startswith("TLC is better: against LQR retuned")


def test_saturation_and_cycles_are_told(report_json):
    """Of 1000 TLC flights all saturate their surfaces, and no sentence said so."""
    numbers = copy.deepcopy(report_json)
    numbers["findings"]["tlc"] |= {"saturated": 80}
    numbers["findings"]["lqr"] |= {"cycling": {"angle_of_attack": 7, "bank": 0}}
    text = " ".join(summary_sentences(numbers))
    assert "TLC: surfaces reach a limit of deflection or rate in 80 of 80 flights." in text
    assert "LQR: limit cycle (> 5 deg) in angle of attack in 7 of 80 flights" in text
    assert "in bank in" not in text


def test_the_answer_says_which_verdicts_do_not_stand_together(report_json):
    numbers = copy.deepcopy(report_json)
    words = numbers["requirements"][0]["words"]
    numbers["held_together"] = {"risk": 0.1, "verdicts": 9, "stand": 2, "dropped": [[0, "tlc"]]}
    text = " ".join(summary_sentences(numbers))
    assert "2 of the 3 PASS would stand" in text and f"; not {words} (TLC)" in text
    numbers["held_together"] |= {"stand": 3, "dropped": []}
    assert "All PASS also hold together" in " ".join(summary_sentences(numbers))
