"""The example notebook is the one that its script makes, executed to its end; its cells run with today's package."""

import importlib.util
import json

import matplotlib.pyplot as plt
import pytest

pytest.importorskip("nbformat", reason="needs the extra 'notebook'")


@pytest.fixture(scope="module")
def script(repository):
    spec = importlib.util.spec_from_file_location("make_example", repository / "docs/make_example.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_example_notebook_was_executed(repository, script):
    text = (repository / "docs/example.ipynb").read_text(encoding="utf-8")
    held = json.loads(text)["cells"]
    assert [(cell["cell_type"], "".join(cell["source"])) for cell in held] == list(script.CELLS)
    code = [cell for cell in held if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert all(output["output_type"] != "error" for cell in code for output in cell["outputs"])
    assert sum("image/png" in output.get("data", {}) for cell in code for output in cell["outputs"]) == 3
    assert len(text) < 1_000_000 and "/" + "home" not in text and str(repository) not in text


def test_its_cells_run(repository, script, tmp_path, monkeypatch):
    (tmp_path / "docs").mkdir()
    for name in ("campaigns", "configs"):
        (tmp_path / name).symlink_to(repository / name)
    monkeypatch.chdir(tmp_path / "docs")
    space = {}
    for kind, source in script.CELLS:
        if kind == "code":
            exec(source.replace("%matplotlib inline", ""), space)  # noqa: S102  our own script's text
    plt.close("all")
    assert space["results"].complete and len(space["history"]) == 6001
    assert space["narrower"].loc[("speed_error_max_mps", "tlc", "q50"), "after"] > 0.0
