"""How a report speaks of metrics and controllers."""

from abhv_mc.shipped import shipped_files
from abhv_mc.topics.names import full_labels


def test_only_the_papers_own_lqr_is_called_so(tmp_path):
    """A plain 'LQR' reads as the best one; and another controller that somebody names lqr is not the paper's."""
    paper = shipped_files("control")["lqr"].read_bytes()
    for name, text in (("lqr", paper), ("mine", paper.replace(b"800.0", b"200.0"))):
        place = tmp_path / "inputs" / "controllers" / name
        place.mkdir(parents=True)
        (place / "lqr.yaml").write_bytes(text)
    labels = full_labels(tmp_path, ["tlc", "lqr", "mine"])
    assert labels == {"tlc": "TLC", "lqr": "LQR (paper's weights)", "mine": "mine"}
