"""Bad campaign files: exit code 2, the place, what was found, what is wanted; nothing written, nothing flown."""

from pathlib import Path

import pytest

BAD = Path(__file__).parent / "bad"

# File, line, column, what the message must say.
TABLE = [
    ("unknown_key", 5, 1, ["unknown key 'run'", "did you mean 'runs'?"]),
    ("duplicate_key", 7, 1, ["'seed' again", "line 6"]),
    ("wrong_unit", 11, 60, ["'30 kg'", "a length"]),
    ("missing_unit", 11, 60, ["without a unit", "a length"]),
    ("unknown_parameter", 10, 3, ["'aero.lfit'", "'aero.lift'"]),
    ("no_effect", 10, 3, ["'aero.side_force.elevator'", "changes no controller's flight"]),
    ("missing_controller", 4, 20, ["tcl.yaml", "not there"]),
    ("empty_range", 9, 63, ["empty range from 1.1 to 0.9"]),
    ("not_positive_definite", 13, 3, ["not positive definite"]),
    ("unknown_metric", 13, 14, ["'altitude_error_max'", "'altitude_error_max_m'"]),
    ("unknown_distribution", 10, 29, ["'gauss'", "normal"]),
    ("bad_tab", 10, 1, ["a tab"]),
    ("probability_in_percent", 13, 60, ["99.73", "less than 1"]),
    ("everything_at_once", 3, 10, [f":{line}: " for line in ("5:1", "6:7", "9:3", "10:50", "12:14", "13:60", "14:82")]),
    ("keep_channel", 12, 62, ["channel 'bank'", "bank_deg"]),
    ("rate", 12, 26, ["33 Hz", "divides the control rate"]),
    ("runs_negative", 5, 7, ["-5", "at least 1"]),
]


def test_the_table_holds_every_file():
    assert sorted(name for name, *_ in TABLE) == sorted(path.stem for path in BAD.glob("*.yaml"))


@pytest.mark.parametrize(("name", "line", "column", "words"), TABLE, ids=[entry[0] for entry in TABLE])
def test_refused(name, line, column, words, abhv_mc, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = BAD / f"{name}.yaml"
    code, _, said = abhv_mc("run", file)
    assert code == 2
    assert f"{file}:{line}:{column}: " in said
    for word in words:
        assert word in said
    assert not list(tmp_path.iterdir())


def test_a_controller_without_its_gains(abhv_mc, tmp_path):
    """Said with the place in the controller's own file."""
    configs = BAD.parents[3] / "configs"
    text = (configs / "control/tlc.yaml").read_text(encoding="utf-8")
    gains = "altitude: {damping: 2.4, bandwidth: 0.03 rad/s}\n"
    assert gains in text
    (tmp_path / "tlc.yaml").write_text(text.replace(gains, ""), encoding="utf-8")
    campaign = (BAD / "rate.yaml").read_text(encoding="utf-8").replace("../../../../configs", str(configs))
    campaign = campaign.replace(f"{configs}/control/tlc.yaml", "tlc.yaml").replace("33 Hz", "10 Hz")
    (tmp_path / "campaign.yaml").write_text(campaign, encoding="utf-8")
    code, _, said = abhv_mc("run", tmp_path / "campaign.yaml", "-o", tmp_path / "out")
    assert code == 2 and f"{tmp_path / 'tlc.yaml'}:" in said
    assert not (tmp_path / "out").exists()
