"""Where the program cannot run it says so in a sentence."""

import importlib
import os

import pytest

import abhv_mc.cli


def test_another_system_is_told_what_is_needed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr(os, "name", "nt")
    with pytest.raises(SystemExit) as stopped:
        importlib.reload(abhv_mc.cli)
    assert stopped.value.code == 2
    assert "Linux or macOS" in capsys.readouterr().err
