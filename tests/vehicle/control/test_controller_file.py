"""Controller files: errors with location, and warnings about loops that are not separated."""

import re
from pathlib import Path

import pytest

from abhv_mc.io.documents import write_document
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.controller_file import LqrController, read_controller

CONFIGS = Path(__file__).parents[3] / "configs" / "control"
TLC = (CONFIGS / "tlc.yaml").read_text()


def test_the_shipped_weights_are_the_papers():
    """Zhu and Shen 2014, section 7."""
    lqr = read_controller(CONFIGS / "lqr.yaml")
    assert isinstance(lqr, LqrController)
    assert [value for _, value in lqr.guidance.states] == [0.1, 5.28e6, 1.28e6, 1.0]
    assert [value for _, value in lqr.guidance.inputs] == [1.31e4, 3.28e3, 1e4]
    assert [value for _, value in lqr.longitudinal.states] == [2.28e7, 0.0]
    assert lqr.longitudinal.inputs.elevator == 800.0
    assert [value for _, value in lqr.lateral.states] == [2.28e5, 1.28e7, 3.28e3, 3.28e4]
    assert [value for _, value in lqr.lateral.inputs] == [1e3, 3e3]


@pytest.mark.parametrize("name", ["tlc", "lqr"])
def test_a_controller_survives_writing_and_reading(name, tmp_path):
    controller = read_controller(CONFIGS / f"{name}.yaml")
    write_document(tmp_path / "again.yaml", controller.model_dump(mode="json"))
    assert read_controller(tmp_path / "again.yaml") == controller


def test_the_papers_gains_give_no_warning_and_a_fast_outer_loop_does(tmp_path):
    assert read_controller(CONFIGS / "tlc.yaml").warnings() == []
    path, bank = tmp_path / "tlc.yaml", "bank: {{damping: 3.4, bandwidth: {}}}"
    schedule = (
        "{over_time: [{time: 0 s, bandwidth: 0.1 rad/s}, {time: 9 s, bandwidth: 0.05 rad/s}]}"
    )
    for bandwidth, loops in (
        ("2 rad/s", ["attitude.bank (13.6 rad/s)", "rates.roll_rate (8.16 rad/s)"]),
        (schedule, ["velocity.heading (0.384 rad/s)", "attitude.bank (0.34 rad/s)"]),
    ):
        path.write_text(TLC.replace(bank.format("0.3 rad/s"), bank.format(bandwidth)))
        (warning,) = read_controller(path).warnings()
        assert re.findall(r"\S+\.\S+ \([^)]*\)", warning) == loops


@pytest.mark.parametrize(
    ("old", "new", "line", "fragment"),
    [
        ("law: tlc", "law: pid", 5, "expected 'tlc', 'lqr'"),
        ("law: tlc", "law: lqr", None, "guidance"),
        (
            "altitude: {damping: 2.4, bandwidth: 0.03 rad/s}",
            "",
            None,
            "the key 'altitude' is missing",
        ),
        ("0.03 rad/s", "0.03", 9, " unit"),
        ("damping: 2.4, bandwidth: 0.1", "damping: -2.4, bandwidth: 0.1", 13, "greater than 0"),
        ("[-1 deg, 12 deg]", "[12 deg, -1 deg]", None, "is empty"),
        ("0.2 rad/s}\n\n", "{over_time: [{time: 0 s, bandwidth: 1 rad/s}]}}\n\n", 15, "at least 2"),
    ],
)
def test_errors_give_their_location(tmp_path, old, new, line, fragment):
    path = tmp_path / "tlc.yaml"
    assert old in TLC
    path.write_text(TLC.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_controller(path)
    assert fragment in str(caught.value)
    if line:
        assert caught.value.line == line
