"""Test of the study of `import flights`, whose conclusions hold for a few tables."""

import re

from benchmarks import table_checks


def test_the_study_accepts_honest_tables_and_detects_the_others(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["table_checks.py", "--smoke"])
    table_checks.main()
    printed = capsys.readouterr().out
    assert re.findall(r" 1e-06\b.*(\{.*\})", printed) == ["{'verdict': 30}"]
    assert re.findall(r"\b\d\.\d{3}\b", printed) == ["1.000"] * 4  # least shares found
    shares = [("30", "1.0", "1.0"), ("60", "1.0", "1.0"), ("300", "1.0", "1.0")]
    assert re.findall(r"(?m)^(\d+) \D+ ([\d.]+),\D+ ([\d.]+)$", printed) == shares
