"""What several files say of the project is the same, and what a journal or a forge asks for is there."""

import json
import re
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


def test_the_paper_has_the_sections_references_and_length_that_joss_asks_for() -> None:
    _, head, body = (ROOT / "paper/paper.md").read_text(encoding="utf-8").split("---\n", 2)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= YAML(typ="safe").load(head).keys()
    sections = re.findall(r"^# (.+)$", body, re.MULTILINE)
    asked = ("Summary", "Statement of need", "State of the field", "Software design", "Research impact statement")
    assert [*asked, "AI usage disclosure", "Acknowledgements", "References"] == sections
    assert 750 <= len(body.split()) <= 1750
    references = (ROOT / "paper/paper.bib").read_text(encoding="utf-8")
    assert set(re.findall(r"@(\w+)[\];]", body)) == set(re.findall(r"^@\w+\{(\w+),", references, re.MULTILINE))
