"""Shipped files by name, also if a folder has the same name."""

import os

from abhv_mc.shipped import find_input, shipped_campaigns


def test_a_folder_named_like_a_shipped_file_is_no_input(tmp_path, monkeypatch):
    """Regression: `abhv-mc run s_manoeuvre -o s_manoeuvre` could not be resumed."""
    monkeypatch.chdir(tmp_path)
    shipped = shipped_campaigns() / "s_manoeuvre.yaml"
    (tmp_path / "s_manoeuvre").mkdir()
    assert find_input("s_manoeuvre", "campaign") == shipped
    (tmp_path / "s_manoeuvre").rmdir()
    os.mkfifo("s_manoeuvre")
    assert find_input("s_manoeuvre", "campaign").name == "s_manoeuvre"
