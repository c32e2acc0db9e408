import pytest
from report.synthetic import write_campaign

from abhv_mc.io.documents import InputError
from abhv_mc.report.compare import compare_folders


def test_a_campaign_against_itself_is_a_draw(failing_folder):
    found = compare_folders(failing_folder, failing_folder)
    assert len(found["paired"]) == 3
    for pair in found["paired"]:
        assert all(entry["ties"] == 100 for entry in pair["metrics"].values())
        assert pair["ended_early"]["only_a"] == 0


def test_controllers_can_be_crossed(failing_folder, failing_numbers):
    (pair,) = compare_folders(failing_folder, failing_folder, ("tlc", "lqr"))["paired"]
    inside = failing_numbers["paired"]["tlc - lqr"]
    assert pair["requirements"] == inside["requirements"]
    metric = "bank_error_rms_deg"
    assert pair["metrics"][metric]["q95"] == inside["metrics"][metric]["q95"]


def test_other_samples_are_refused_at_the_first_that_differs(failing_folder, tmp_path):
    other = write_campaign(tmp_path / "other", runs=10, seed=8)
    with pytest.raises(InputError, match=r"atmosphere\.density = .* in flight 0"):
        compare_folders(failing_folder, other)


def test_an_unknown_controller_is_refused(failing_folder):
    with pytest.raises(InputError, match="pid"):
        compare_folders(failing_folder, failing_folder, ("tlc", "pid"))
    with pytest.raises(InputError, match="two"):
        compare_folders(failing_folder, failing_folder, ("tlc",))
