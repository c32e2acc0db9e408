"""Tests that files, anchors, functions, tests and commands on pages exist.

The build of the site runs the examples. Facts on the project agree in all files.
"""

import ast
import importlib
import importlib.util
import re
import sys
from pathlib import Path

import pytest
import typer

from abhv_mc.cli.app import app
from abhv_mc.folder.layout import CampaignFolder

ROOT = Path(__file__).parents[2]
BUILT = ("_build", "generated", ".venv")
PAGES = sorted(
    page
    for folder in ("docs", "reports")
    for page in (ROOT / folder).rglob("*.md")
    if not set(BUILT) & set(page.relative_to(ROOT).parts)
) + [
    ROOT / name
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "paper/paper.md")
]
PAGES += sorted((ROOT / ".github").glob("*.md"))
PLACES = re.compile(
    r"`{1,2}((?:src|tests|docs|configs|campaigns|benchmarks|studies|reports/example)/[\w./*-]+)(?:::(\w+))?`"
)


def text_of(page):
    return page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "page", [page for page in PAGES if not page.is_relative_to(ROOT / "docs")], ids=str
)
def test_links_of_pages_outside_the_site(page):
    """Links and anchors of the site are checked by its build (docs/_ext/check_site.py)."""
    for target in re.findall(r"\]\(([^)\s]+)\)", text_of(page)):
        name = target.partition("#")[0]
        assert re.match(r"[a-z]+:", target) or not name or (page.parent / name).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_files_and_tests_on_pages_exist(page):
    for name, function in PLACES.findall(text_of(page)):
        if "*" in name or name.startswith("reports/s_manoeuvre"):
            assert list(ROOT.glob(name)), name
            continue
        if set(BUILT) & set(name.split("/")):
            continue
        assert (ROOT / name).exists(), name
        if function:
            tree = ast.parse(text_of(ROOT / name))
            assert function in {
                node.name for node in tree.body if isinstance(node, ast.FunctionDef)
            }, function
    for name in re.findall(r"`([\w/]+/(?!my_)\w+\.py)`", text_of(page)):  # my_law.py is a reader's
        assert any(
            (ROOT / folder / name).exists()
            for folder in ("", "src", "src/abhv_mc", "src/abhv_mc_vehicle")
        ), name


def test_generated_pages_list_every_key_metric_and_parameter(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs/_ext"), *sys.path])
    from abhv_mc.campaign.file.kinds import find_kinds
    from abhv_mc.campaign.file.schema import make_schema
    from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
    from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
    from abhv_mc_vehicle.plant.parameters import PARAMETERS

    pages = importlib.import_module("reference_pages").make_pages(
        Path(), ROOT / "docs/reference/commands"
    )
    by_name = {path.as_posix(): text for path, text in pages.items()}
    for kind in find_kinds():
        for definition in make_schema(kind)["$defs"].values():
            assert all(
                f"| `{key}` |" in by_name[f"files/{kind}.md"]
                for key in definition.get("properties", ())
            )
    assert all(f"| `{name}` |" in by_name["metrics.md"] for name in METRIC_INDEX)
    assert all(f"| `{name}` |" in by_name["channels.md"] for name in CHANNEL_INDEX)
    assert all(f"| `{p.name}` |" in by_name["parameters.md"] for p in PARAMETERS if "." in p.name)
    assert {
        f"commands/{name}.md" for name in typer.main.get_command(app).list_commands(None)
    } <= set(by_name)


def test_all_files_of_a_campaigns_folder_are_explained():
    page = text_of(ROOT / "docs/reference/results-folder.md")
    folder = CampaignFolder(Path("x"))
    for path in (*folder.contents, folder.lock):
        assert f"`{path.name}" in page, path.name


def commands_of(text):
    """Return the commands with options in code, blocks and directives of a text.

    Tables of benchmarks are excluded.
    """
    text = re.sub(r"<!-- (\w+) -->.*?<!-- /\1 -->", "", text, flags=re.DOTALL)
    blocks = re.findall(r"^[ \t]*```[^\n]*\n(.*?)^[ \t]*```", text, re.DOTALL | re.MULTILINE)
    code = re.findall(r"`([^`\n]+)`|command-output\} (abhv-mc [^\n]*)", text)
    code += re.findall(r"^[ \t$]*(abhv-mc [^\n]*)", "\n".join(blocks), re.MULTILINE)
    lines = [re.split(r"\s#\s|[|&;>]", "".join(parts))[0] for parts in code]
    matches = (re.search(r"\babhv-mc ([a-z]+)\b(.*)", line) for line in lines)
    return {
        (match[1], tuple(re.findall(r"(?<!\S)--?[a-z][a-z-]*", match[2])))
        for match in matches
        if match
    }


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_commands_and_their_options_exist(page):
    text = text_of(page)
    group = typer.main.get_command(app)
    added = set(re.findall(r'^(\w+) = "\w+:\w+"', text, re.MULTILINE))  # by the page's package
    for name, options in commands_of(text):
        if name in added:
            continue
        command = group.get_command(None, name)
        assert command is not None, f"abhv-mc {name}"
        allowed = {
            option
            for parameter in command.params
            for option in parameter.opts + parameter.secondary_opts
        }
        for inner in getattr(command, "commands", {}).values():  # commands of a command
            allowed |= {
                option
                for parameter in inner.params
                for option in parameter.opts + parameter.secondary_opts
            }
        assert set(options) <= allowed | {"--help"}, f"abhv-mc {name} {options}"
    makefile = text_of(ROOT / "Makefile")
    for target in re.findall(r"`make ([\w-]+)", text) + re.findall(
        r"^make ([\w-]+)", text, re.MULTILINE
    ):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"make {target}"
    for module in re.findall(r"python -m ((?:benchmarks|studies)[\w.]*)", text):
        module_path = ROOT / module.replace(".", "/")
        assert module_path.with_suffix(".py").exists() or (module_path / "__main__.py").exists(), (
            module
        )
    for script in re.findall(r"python ((?:benchmarks|studies|tests)/[\w/]+\.py)", text):
        assert (ROOT / script).exists(), script
