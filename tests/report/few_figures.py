"""Reports with few figures, for tests of words and numbers: drawing all sixteen takes most of a report's time."""

import itertools
from pathlib import Path

import pytest

from abhv_mc.report.pages.build import build_report
from abhv_mc.topics import registry


def build_with(folder: Path, *figures: str, baseline: Path | None = None, svg: bool = False) -> Path:
    """Build a campaign's report with these of its figures only."""
    make_figures = registry.make_figures

    def make_few(models):
        missing = set(figures)

        def few():
            for text, figure in itertools.chain.from_iterable(make_figures(models).values()):
                if text.name in missing:
                    missing.remove(text.name)
                    yield text, figure
                if not missing:
                    return
            assert not missing, missing

        return {"few": few()}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "make_figures", make_few)
        return build_report(folder, baseline=baseline, svg=svg)
