"""Test of the study of `import flights`, whose conclusions hold for a few tables."""

import re

import pytest

from benchmarks import table_checks


def test_the_study_accepts_honest_tables_and_detects_the_others(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["table_checks.py", "--smoke"])
    table_checks.main()
    printed = capsys.readouterr().out
    assert "honest tables at a risk of 1e-06: {'verdict': 30}" in printed
    assert re.findall(r"found (\S+) at least", printed) == ["1.000"] * 4
    assert printed.count("Latin hypercube 1.0, pasted four times 1.0") == 3
