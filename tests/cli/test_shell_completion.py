"""What a shell offers, and help without types of flags."""

import subprocess
import sys

from abhv_mc.cli.shell_completion import complete_controllers, complete_folder, complete_input, complete_metric


def test_shipped_names_come_before_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s_own.yaml").touch()
    (tmp_path / "s_notes.txt").touch()
    (tmp_path / "s_study").mkdir()
    found = complete_input("campaign")("s_")
    assert found[0] == "s_manoeuvre" and found[-2:] == ["s_own.yaml", "s_study/"]
    (tmp_path / "s_study" / "campaign.yaml").touch()
    assert complete_input("campaign")("s_study/") == ["s_study/campaign.yaml"]


def test_folders_are_those_of_campaigns_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("reports/flown", "reports/empty", "reserve"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "reports/flown/manifest.json").touch()
    assert complete_folder("re") == ["reports/flown", "reports/", "reserve/"]


def test_metrics_and_controllers():
    assert "bank_error_settled_max_deg" in complete_metric("bank_err")
    assert complete_controllers("tlc,lqr_rob") == ["tlc,lqr_robust"]


def test_a_shell_gets_them():
    program = [sys.executable, "-m", "abhv_mc"]
    asked = {"_ABHV_MC_COMPLETE": "complete_bash", "COMP_WORDS": "abhv-mc run s_man", "COMP_CWORD": "2"}
    told = subprocess.run(program, env=asked, capture_output=True, text=True, check=False)
    assert "s_manoeuvre" in told.stdout.split(), told.stderr
