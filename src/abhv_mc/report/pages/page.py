"""The report as one HTML file that opens offline, or as Markdown: templates filled with words and numbers."""

import base64
import gzip
import hashlib
import json
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from abhv_mc.folder.results import Results
from abhv_mc.folder.seeds import name_siblings
from abhv_mc.report.numbers import tables
from abhv_mc.report.numbers.confidence import confidence_sentence
from abhv_mc.report.numbers.summary import summary_parts, summary_sentences
from abhv_mc.report.pages.first_screen import (
    LIMIT_PLACE,
    SHAPES,
    baseline_line,
    cards,
    chart_rows,
    confidence_line,
    more_words,
    sentences,
)
from abhv_mc.report.pages.flights_view import make_flights_view
from abhv_mc.report.pages.interactive import envelope_data
from abhv_mc.report.pages.packed import pack_arrays
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.labels import controller_label
from abhv_mc.topics.parameter_words import parameter_doc
from abhv_mc.topics.registry import all_topics
from abhv_mc.topics.section import FigureText
from abhv_mc.topics.section_text import as_markdown
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.words import fixed, joined, significant


@dataclass(frozen=True)
class PageFigure:
    """A figure written to disk, with its words."""

    text: FigureText
    path: Path
    width: int  # px
    height: int


def _embedded(figure: PageFigure) -> dict[str, Any]:
    image = base64.b64encode(figure.path.read_bytes()).decode("ascii")
    return {
        "name": figure.text.name,
        "file": f"figures/{figure.path.name}",
        "title": figure.text.title,
        "gallery": figure.text.gallery,
        "caption": figure.text.caption,
        "alt": f"{figure.text.title}. {figure.text.alt}",
        "source": Markup(f"data:image/png;base64,{image}"),  # noqa: S704  letters of base64 only
        "width": figure.width,
        "height": figure.height,
    }


def _script_json(data: Any) -> Markup:
    """JSON that cannot end the script element which holds it."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))  # noqa: S704  no markup is left


def _script_hashes(*scripts: str) -> Markup:
    """The sources of a content security policy that lets these scripts run and no other."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii") for script in scripts)
    return Markup(" ".join(f"'sha256-{value}'" for value in hashes))  # noqa: S704  letters of base64 only


def _dispersions(numbers: Mapping[str, Any]) -> list[dict[str, str]]:
    rows = []
    for name, entry in numbers["campaign"]["dispersions"].items():
        widths = {k: v.replace(" ", "\N{NO-BREAK SPACE}") if isinstance(v, str) else v for k, v in entry.items()}
        settings = ", ".join(f"{k.replace('_', ' ')} {v}" for k, v in widths.items() if k != "distribution")
        law = str(entry.get("distribution", "")).replace("_", " ")
        rows.append({"name": name, "doc": parameter_doc(name), "law": law, "settings": settings})
    return rows


def _provenance(results: Results) -> list[tuple[str, str]]:
    """What the manifest says, flat, as pairs of words."""
    rows = []
    for key, value in results.manifest.items():
        if key in ("controllers", "requirements", "requirements_shown", "files", "inputs"):  # in tables of their own
            continue
        label = "question hash" if key == "question" else key.replace("_", " ")
        if isinstance(value, dict):
            rows += [(f"{label}: {inner.replace('_', ' ')}", _plain_words(item)) for inner, item in value.items()]
        else:
            rows.append((label, _plain_words(value)))
    return rows


def _plain_words(value: Any) -> str:
    if isinstance(value, float):
        return significant(value, 4)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain_words(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return " ".join(map(_plain_words, value)) or "none"
    return "\N{EM DASH}" if value is None else str(value)


def _context(models: Models, numbers: Mapping[str, Any]) -> dict[str, Any]:
    results = models.results
    campaign = numbers["campaign"]
    folder = shlex.quote(results.folder.as_posix())
    parts = summary_parts(models, numbers)
    return {
        "campaign": campaign,
        "numbers": numbers,
        "labels": list(campaign["labels"].values()),
        "rivals": list(campaign["labels"].values())[1:],
        "title": campaign["name"].replace("_", " "),
        "question": campaign["question"] or f"What does the campaign {campaign['name']} show?",
        "answers": parts.known,
        "wins": [*parts.lost, *parts.wins],
        "summary": summary_sentences(models, numbers),
        "confidence": confidence_sentence(models, numbers),
        "verdicts": models[VERDICTS].requirements,
        "headline": tables.headline_rows(numbers),
        "groups": list(tables.metric_groups(numbers)),
        "pairs": tables.pair_tables(numbers, [entry.words for entry in models[VERDICTS].requirements]),
        "sections": {topic.name: found for topic in all_topics() if (found := models.section(topic))},
        "worst": tables.worst_tables(numbers, folder),
        "worst_heads": [numbers["metrics"][m]["label_with_unit"] for m in numbers["asked"][: tables.WORST_COLUMNS]],
        "dispersions": _dispersions(numbers),
        "outcomes": [
            {
                **counts,
                "label": controller_label(name),
                "outcomes": joined([f"{count} {code.replace('_', ' ')}" for code, count in counts["outcomes"].items()]),
            }
            for name, counts in numbers["flights"].items()
        ],
        "state": numbers["state"],
        "provenance": _provenance(results),
        "folder": folder,
        "siblings": name_siblings(results.folder, results.manifest),
    }


def _environment(html: bool) -> Environment:
    environment = Environment(
        loader=PackageLoader("abhv_mc.report.pages", "template"),
        autoescape=select_autoescape(["html", "j2"]) if html else False,  # noqa: S701  finalize escapes Markdown
        finalize=None if html else _escape_markdown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["group"] = lambda value: fixed(float(value), 0)
    environment.filters["code"] = _code
    environment.filters["kind"] = lambda item: type(item).__name__
    environment.filters["typed"] = _typed
    environment.filters["markdown"] = lambda section: Markup(as_markdown(section))  # noqa: S704  escaped there
    return environment


def _escape_markdown(value: Any) -> str:
    """A value as text that no Markdown reader takes for markup: of tables, links, code or HTML."""
    if isinstance(value, Markup):
        return value
    text = re.sub(r"([\\`*\[\]|])", r"\\\1", str(value))
    return re.sub(r"\s*[\r\n]+\s*", " ", text.replace("<", "&lt;"))


def _typed(text: str) -> Markup:
    """A text whose parts between backticks are typed as they stand."""
    parts = [escape(part) for part in text.split("`")]
    return Markup("").join(  # nothing but escaped text and our own tags
        Markup('<code class="command">{}</code>').format(part) if i % 2 else part for i, part in enumerate(parts)
    )


def _code(text: str) -> Markup:
    """A command as code, whatever is in it."""
    line = " ".join(text.split("\n"))
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", line)), default=0))
    pad = " " if len(fence) > 1 else ""
    return Markup(f"{fence}{pad}{line}{pad}{fence}")  # noqa: S704  nothing in code is markup


def make_page(models: Models, numbers: Mapping[str, Any], figures: Sequence[PageFigure]) -> str:
    """The whole report as one HTML file: no request leaves it, and no script runs in it but its own."""
    environment, results = _environment(html=True), models.results
    labels = numbers["campaign"]["labels"]
    colors = controller_colors(results.controllers)
    template = files("abhv_mc.report.pages") / "template"
    embedded = [_embedded(figure) for figure in figures]
    script = "".join((template / name).read_text("utf-8") for name in ("flights.js", "page.js"))
    packed_library = (template / "plotly-basic.min.js.gz").read_bytes()
    envelopes, arrays = envelope_data(results, labels, colors)
    view = make_flights_view(results, labels, colors)
    places, packed = pack_arrays({**arrays, **view.arrays})
    return environment.get_template("page.html.j2").render(
        **_context(models, numbers),
        figures=embedded,
        figure_of={figure["name"]: figure for figure in embedded},
        style=Markup((template / "style.css").read_text("utf-8")),  # noqa: S704  our own files
        script=Markup(script),  # noqa: S704
        script_hashes=_script_hashes(script, gzip.decompress(packed_library).decode()),
        plotly=Markup(base64.b64encode(packed_library).decode()),  # noqa: S704  letters of base64 only
        packed=Markup(packed),  # noqa: S704  letters of base64 only
        data=_script_json({"envelopes": envelopes, "flights": view.data, "places": places}),
        strips=view.strips,
        chart=chart_rows(models[VERDICTS].glance, labels, colors),
        cards=cards(models, numbers, colors),
        sentences=sentences(models, numbers),
        confidence_line=confidence_line(models[VERDICTS], numbers["state"]),
        baseline_line=baseline_line(numbers),
        limit_place=LIMIT_PLACE,
        shapes=SHAPES,
        more_rows=more_words(models[VERDICTS].glance),
        flight_heads=[numbers["metrics"][name]["label_with_unit"] for name in view.data["headed"]],
    )


def make_markdown(models: Models, numbers: Mapping[str, Any], figures: Sequence[PageFigure]) -> str:
    """The report's words, tables and links to its figures as Markdown."""
    template = _environment(html=False).get_template("page.md.j2")
    return template.render(**_context(models, numbers), figures=[_embedded(figure) for figure in figures])
