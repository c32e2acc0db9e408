"""The page in a real browser, by mouse and by keyboard alone: no message, nothing leaves, switches work."""

SAID = ("Log.entryAdded", "Runtime.consoleAPICalled", "Runtime.exceptionThrown")
NAMES = "document.getElementById('plot').data.map((trace) => trace.name)"
CHANNEL = """(() => { const channel = document.getElementById("channel"); channel.value = "sideslip_deg";
  channel.dispatchEvent(new Event("change")); const plot = document.getElementById("plot");
  return { axis: plot.layout.yaxis.title.text, words: document.getElementById("plot-words").textContent,
    drawn: plot.querySelectorAll(".scatterlayer .trace").length,
    tools: [...plot.querySelectorAll(".modebar-btn")].map((button) => button.dataset.title) }; })()"""


def press_box(page, name):
    page.ask(f"document.querySelector('input[name=\"{name}\"]').click()")


def test_switches_work_and_nothing_is_said_or_asked_for(page, report_folder):
    path = report_folder / "report.html"
    for part in ("Log", "Network", "Runtime"):
        page.call(f"{part}.enable")
    page.show(path)
    assert {"TLC median", "LQR 5 %", "reference"} <= set(page.ask(NAMES))
    press_box(page, "lqr")
    left = page.ask(NAMES)
    assert "LQR retuned median" in left
    assert not any(name.startswith("LQR ") and "retuned" not in name for name in left)
    for name in ("all", "wide", "narrow"):
        press_box(page, name)
    assert not any("%" in name or "largest" in name for name in page.ask(NAMES))
    found = page.ask(CHANNEL)
    assert found["axis"] == "Sideslip (deg)" and "Sideslip" in found["words"]
    assert found["drawn"] == 2  # the medians of the two that are left
    assert {"Zoom in", "Reset axes"} <= set(found["tools"])
    assert not any(
        part in title for title in found["tools"] for part in ("hare", "loud", "dit")
    )  # uploads the data
    page.wait_for("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
    assert [event for event in page.told if event[0] in SAID] == []
    asked = {
        params["request"]["url"]
        for method, params in page.told
        if method == "Network.requestWillBeSent"
    }
    assert {url for url in asked if not url.startswith("data:")} == {path.as_uri()}


def test_no_other_script_runs(page, report_page, tmp_path):
    foreign = (
        "<script>document.body.dataset.foreign = 1</script><img src=x "
        "onerror='document.body.dataset.foreign = 1'>"
    )
    path = tmp_path / "foreign.html"
    path.write_text(report_page.replace("</body>", foreign + "</body>"), encoding="utf-8")
    page.show(path)
    assert page.ask("document.body.dataset.foreign") is None
    assert "Content Security Policy" in str(page.told)


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


def test_it_is_read_with_the_keyboard(page, report_folder):
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
    assert page.ask("document.getElementById('flight-title').textContent").startswith(
        second.removeprefix("Show ")
    )
    assert page.ask(FOCUS)[1] == second  # the list was drawn anew
    passed += tab_to(page, "channel")
    assert all(visible for _, _, visible in passed), "a focus that is not seen"
    assert "Requirements in full" in [
        name for _, name, _ in passed
    ]  # a table that scrolls takes the focus
    before = page.ask("document.getElementById('plot-words').textContent")
    page.press("ArrowDown")
    assert page.ask("document.getElementById('plot-words').textContent") != before
    names = "document.getElementById('plot').data.map((trace) => trace.name).join()"
    assert "LQR median" in page.ask(names)
    tab_to(page, "lqr")
    page.press(" ")
    assert "LQR median" not in page.ask(names)
    tab_to(page, "Provenance")
