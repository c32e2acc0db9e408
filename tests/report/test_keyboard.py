"""The page with a keyboard alone, in a real browser: every key press goes through Chromium's own input."""

from report.browser import open_browser

FOCUS = """(() => { const e = document.activeElement; return [e.tagName, e.id || e.name || e.getAttribute("aria-label")
    || e.textContent.trim(), getComputedStyle(e).outlineStyle !== "none"]; })()"""
STOPS = 90  # of the Tab key on the whole page; 350 while every flight of a list was one


def tab_to(page, wanted):
    """Press Tab until the element has the focus; everything that had it on the way."""
    passed = []
    for _ in range(STOPS):
        page.press("Tab")
        passed.append(page.ask(FOCUS))
        if passed[-1][1] == wanted:
            return passed
    raise AssertionError(f"{wanted} was never reached: {passed}")


def test_it_is_read_with_the_keyboard(report_folder, tmp_path):
    with open_browser(tmp_path / "profile") as page:
        page.show(report_folder / "report.html")
        (skip,) = tab_to(page, "Skip to the report")
        assert skip[0] == "A"
        page.press("Enter")
        assert page.ask(FOCUS)[:2] == ["MAIN", "main"]
        passed = tab_to(page, "Flights, the worst first")
        page.press("Tab")
        assert page.ask(FOCUS)[1] == "Flight"  # the heads are one stop: they sort
        page.press("Tab")
        first = page.ask(FOCUS)[1]
        assert first.startswith("Show ")
        page.press("ArrowDown")
        second = page.ask(FOCUS)[1]
        assert second.startswith("Show ") and second != first
        page.press("Enter")
        assert page.ask("document.getElementById('flight-title').textContent").startswith(second.removeprefix("Show "))
        assert page.ask(FOCUS)[1] == second  # the list was drawn anew
        passed += tab_to(page, "channel")
        assert all(visible for _, _, visible in passed), "a focus that is not seen"
        assert "Requirements in full" in [name for _, name, _ in passed]  # a table that scrolls takes the focus
        before = page.ask("document.getElementById('plot-words').textContent")
        page.press("ArrowDown")
        assert page.ask("document.getElementById('plot-words').textContent") != before
        names = "document.getElementById('plot').data.map((trace) => trace.name).join()"
        assert "LQR median" in page.ask(names)
        tab_to(page, "lqr")
        page.press(" ")
        assert "LQR median" not in page.ask(names)
        tab_to(page, "Provenance")
