import pytest
from report.synthetic import write_campaign

from abhv_mc.api import compare
from abhv_mc.io.documents import InputError
from abhv_mc.report.numbers.compare import parse_margins


def test_a_campaign_against_itself_is_a_draw(failing_folder):
    found = compare(failing_folder, failing_folder)
    assert len(found["paired"]) == 3
    for pair in found["paired"]:
        assert all(entry["ties"] == 100 for entry in pair["metrics"].values())
        assert pair["ended_early"]["only_a"] == 0


def test_controllers_can_be_crossed(failing_folder, failing_numbers):
    (pair,) = compare(failing_folder, failing_folder, ("tlc", "lqr"))["paired"]
    inside = failing_numbers["comparison"]["pairs"]["tlc - lqr"]
    assert pair["requirements"] == inside["requirements"]
    metric = "bank_error_rms_deg"
    assert pair["metrics"][metric]["quantile_differences"] == inside["metrics"][metric]["quantile_differences"]


def test_other_samples_are_refused_at_the_first_that_differs(failing_folder, tmp_path):
    other = write_campaign(tmp_path / "other", runs=10, seed=8)
    with pytest.raises(InputError, match=r"atmosphere\.density = .* in flight 0"):
        compare(failing_folder, other)


def test_an_unknown_controller_is_refused(failing_folder):
    with pytest.raises(InputError, match="pid"):
        compare(failing_folder, failing_folder, ("tlc", "pid"))
    with pytest.raises(InputError, match="two"):
        compare(failing_folder, failing_folder, ("tlc",))


def test_a_controller_that_loses_more_flights_fails_whatever_its_metric(failing_folder):
    margins = parse_margins(["speed_error_max_mps=900 %"])
    (pair,) = compare(failing_folder, failing_folder, ("tlc", "lqr"), margins)["paired"]
    gate = pair["not_worse"]["speed_error_max_mps"]
    assert gate["loses_more"] and not gate["shown"]


def test_a_metric_with_two_margins_is_refused():
    """The last one held: a gate of 1 % was passed by way of a second one of 100 %."""
    with pytest.raises(InputError, match="'bank_error_rms_deg' a second time"):
        parse_margins(["bank_error_rms_deg=1%", "bank_error_rms_deg = 100 %"])


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
