"""worst, rare, tune and compare from Python."""

import pytest
from fake_flight import write_campaign
from report.synthetic import write_campaign as write_flown
from search.known_flights import METRIC

import abhv_mc
from abhv_mc.io.documents import InputError
from abhv_mc.report.numbers.compare import compare_results, read_compared
from abhv_mc.topics.plain import plain


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda file, out: abhv_mc.worst(file, out, METRIC, bad="big"), "bad: 'big'; expected 'high', 'low'"),
        (lambda file, out: abhv_mc.worst(file, out, METRIC, box=9), "box: 9; expected a number from 0.1 to 8"),
        (lambda file, out: abhv_mc.worst(file, out, METRIC, flights=0), "flights: 0; expected a whole number"),
        (lambda file, out: abhv_mc.worst(file, out, "speed"), "unknown metric 'speed'"),
        (lambda file, out: abhv_mc.rare(file, out, METRIC, target_cov="300 %"), "target_cov: 3; expected"),
        (lambda file, out: abhv_mc.rare(file, out, METRIC, flights=1.5), "flights: 1.5; expected a whole number"),
        (lambda file, out: abhv_mc.tune(file, out / "new.yaml"), "tune"),
        (lambda file, out: abhv_mc.worst("no_such", out, METRIC), "no_such"),
    ],
)
def test_what_is_wrong_is_refused_and_nothing_written(tmp_path, call, words):
    file = write_campaign(tmp_path / "files")
    with pytest.raises(InputError) as refused:
        call(file, tmp_path / "out")
    assert words in str(refused.value) and not (tmp_path / "out").exists()


def test_a_comparison_has_the_numbers_and_the_page_of_the_command(tmp_path):
    a, b = (write_flown(tmp_path / name, runs=20, failing=lost) for name, lost in (("a", 1), ("b", 3)))
    gates = {"altitude_error_max_m": "5 %"}
    found = abhv_mc.compare(abhv_mc.open_results(a), b, ("lqr", "lqr"), gates, tmp_path / "page")
    assert found == plain(compare_results(*read_compared(a, b), ("lqr", "lqr"), {"altitude_error_max_m": 0.05}))
    assert found["paired"][0]["ended_early"]["only_b"] == 2 and (tmp_path / "page/report.html").is_file()
    with pytest.raises(InputError, match="fail_if_worse"):
        abhv_mc.compare(a, b, fail_if_worse="altitude_error_max_m=5%")
