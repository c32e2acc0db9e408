import pytest

from benchmarks.document import replace_part


def test_a_part_is_replaced_and_nothing_else(tmp_path):
    path = tmp_path / "page.md"
    path.write_text("before\n<!-- one -->\nold\n<!-- /one -->\n<!-- two -->\nkept\n<!-- /two -->\n")
    for _ in range(2):
        replace_part(path, "one", "| new |")
    assert path.read_text() == "before\n<!-- one -->\n| new |\n<!-- /one -->\n<!-- two -->\nkept\n<!-- /two -->\n"


@pytest.mark.parametrize("text", ["", "<!-- one -->\n", "<!-- /one -->\n"])
def test_a_missing_part_is_refused_and_the_page_kept(tmp_path, text):
    path = tmp_path / "page.md"
    path.write_text(text)
    with pytest.raises(ValueError, match="<!-- one -->"):
        replace_part(path, "one", "new")
    assert path.read_text() == text


def test_the_page_has_a_part_for_every_benchmark(repository):
    page = (repository / "docs" / "explanation" / "performance.md").read_text(encoding="utf-8")
    for name in ("bench", "peers", "parts", "growth", "million", "kernels"):
        assert page.index(f"<!-- {name} -->") < page.index(f"<!-- /{name} -->")
