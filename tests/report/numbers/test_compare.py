import pytest
from report.synthetic import write_campaign

from abhv_mc.api import compare
from abhv_mc.io.documents import InputError
from abhv_mc.report.numbers.compare import parse_margins


def test_controllers_can_be_crossed(failing_folder, failing_numbers):
    (pair,) = compare(failing_folder, failing_folder, ("tlc", "lqr"))["paired"]
    inside = failing_numbers["comparison"]["pairs"]["tlc - lqr"]
    assert pair["requirements"] == inside["requirements"]
    metric = "bank_error_rms_deg"
    assert pair["metrics"][metric]["quantile_differences"] == inside["metrics"][metric]["quantile_differences"]


def test_a_controller_that_loses_more_flights_fails_whatever_its_metric(failing_folder):
    margins = parse_margins(["speed_error_max_mps=900 %"])
    (pair,) = compare(failing_folder, failing_folder, ("tlc", "lqr"), margins)["paired"]
    gate = pair["not_worse"]["speed_error_max_mps"]
    assert gate["loses_more"] and not gate["shown"]


@pytest.mark.parametrize(("crossed", "margin", "code", "words"), [
    ("lqr,lqr_retuned", "5%", 0, "passes: shown"),
    ("lqr_retuned,lqr", "5%", 1, "is stopped: NOT shown"),
    ("lqr_retuned,lqr", "500%", 1, "; it misses Speed error"),
])  # fmt: skip
def test_the_gate_is_the_exit_code(failing_folder, abhv_mc, crossed, margin, code, words):
    """There was no such gate: continuous integration could not ask whether a change made a metric worse."""
    gate = ["--controllers", crossed, "--fail-if-worse", f"bank_error_rms_deg={margin}"]
    found, out, _ = abhv_mc("compare", failing_folder, failing_folder, *gate)
    assert (found, words in out) == (code, True), out


@pytest.mark.parametrize(("asked", "words"), [
    ({"controllers": ("tlc", "pid")}, "pid"),
    ({"controllers": ("tlc",)}, "two"),
    ({"fail_if_worse": {"no_metric": 0.05}}, "unknown metric 'no_metric'"),
])  # fmt: skip
def test_what_cannot_be_compared_is_refused(failing_folder, asked, words):
    with pytest.raises(InputError, match=words):
        compare(failing_folder, failing_folder, **asked)


def test_other_samples_and_a_second_margin_are_refused(failing_folder, tmp_path):
    """The last one held: a gate of 1 % was passed by way of a second one of 100 %."""
    other = write_campaign(tmp_path / "other", runs=10, seed=8)
    with pytest.raises(InputError, match=r"atmosphere\.density = .* in flight 0"):
        compare(failing_folder, other)
    with pytest.raises(InputError, match="'bank_error_rms_deg' a second time"):
        parse_margins(["bank_error_rms_deg=1%", "bank_error_rms_deg = 100 %"])
