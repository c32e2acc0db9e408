"""What commands print."""

from typer.testing import CliRunner

from abhv_mc.cli.app import app
from abhv_mc.cli.printing import say


def test_a_secret_in_an_address_is_not_repeated(capsys):
    """Logs are kept, and shown to others."""
    say("found 's3://KEY:SECRET/+@bucket/folder', 25 km/s at 1:2@3")
    said = CliRunner().invoke(app, ["report", "s3://KEY:SECRET@bucket/none?endpoint_override=127.0.0.1:9&scheme=http"])
    assert "s3://KEY:...@bucket" in capsys.readouterr().out and "SECRET" not in said.output
