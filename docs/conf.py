"""Sphinx: how the site is made from these folders (`make docs`)."""

import importlib.util
import os
import shutil
import sys
from pathlib import Path

from abhv_mc.version import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "abhv-mc"
author = "the abhv-mc authors"
copyright = author
release = version = __version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "numpydoc",
    "myst_nb",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinxcontrib.programoutput",
    "reference_pages",
    "workspaces",
    "check_site",
]
exclude_patterns = ["_build", "_ext", "reference/commands"]
nitpicky = True
highlight_language = "text"  # what is no code of a named language
smartquotes = False  # --option stays as it is typed
suppress_warnings = ["mystnb.unknown_mime_type"]

# Pages in Markdown; cells of a page are executed at every build, and an error in one fails it.
myst_enable_extensions = [
    "amsmath",
    "attrs_inline",
    "colon_fence",
    "deflist",
    "dollarmath",
    "fieldlist",
]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_timeout = 900  # s a cell, on a busy machine
nb_execution_raise_on_error = True
nb_merge_streams = True

# The Python API
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
nitpick_ignore_regex = [
    (
        "py:.*",
        r"(os|pd|pandas|np|numpy|pathlib|matplotlib|collections|contextlib|typing|abhv_mc\w*|Figure|FigureText|Explanation|WorstFound|RareFound|TuneFound|Identification|Tightening|Records|Floats|ArrayLike|NDArray|PlantState|SavedPlant|Input|RequirementSource|xr|Any|Path|.*Literal)\b.*",
    )
]

# Commands shown on the pages run in folders of their own, as wide as the page.
os.environ |= {"COLUMNS": "96", "NO_COLOR": "1", "TERM": "dumb"}
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
programoutput_prompt_template = "$ {command}\n{output}"
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True
copybutton_only_copy_prompt_lines = True

html_theme = "pydata_sphinx_theme"
html_title = "abhv-mc"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_sidebars = {"index": [], "gallery/index": []}  # nothing below these to go to
html_copy_source = False
html_theme_options = {
    "navbar_end": ["theme-switcher"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": False,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
}
html_context = {"default_mode": "auto"}

# MathJax travels with the site: nothing is loaded from elsewhere when a page is read.
mathjax_path = "mathjax/tex-chtml.js"
mathjax3_config = {"options": {"enableMenu": False}}


def _copy_files(app, error):
    """Copy the parts of MathJax that its loader reads, and an example report."""
    if error is not None or app.builder.format != "html":
        return
    shutil.copyfile(
        HERE / "_build/flown/study/default/report.html", Path(app.outdir) / "_static/report.html"
    )
    package = importlib.util.find_spec("sphinx-mathjax-offline").submodule_search_locations[0]
    source, target = Path(package) / "static" / "mathjax", Path(app.outdir) / "_static" / "mathjax"
    for part in ("tex-chtml.js", "output/chtml/fonts", "input/tex/extensions"):
        (target / part).parent.mkdir(parents=True, exist_ok=True)
        if (source / part).is_dir():
            shutil.copytree(source / part, target / part, dirs_exist_ok=True)
        else:
            shutil.copyfile(source / part, target / part)


def setup(app):
    """Register the extension with Sphinx."""
    app.connect("build-finished", _copy_files)
