"""What several files say of the project is the same, and what a journal or a forge asks for is there."""

import json
import tomllib
from pathlib import Path

from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]


def test_title_licence_and_keywords_agree() -> None:
    cited = YAML(typ="safe").load(ROOT / "CITATION.cff")
    deposited = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert deposited["title"] == cited["title"] == f"{project['name']}: {project['description']}"
    assert deposited["license"] == cited["license"] == project["license"]
    assert deposited["keywords"] == cited["keywords"]
