"""Report in a browser, by mouse and by keyboard: switches, console messages and requests."""

SAID = ("Log.entryAdded", "Runtime.consoleAPICalled", "Runtime.exceptionThrown")
NAMES = "document.getElementById('plot').data.map((trace) => trace.name)"
CHANNEL = """(() => { const channel = document.getElementById("channel"); channel.value = \
"sideslip_deg";
  channel.dispatchEvent(new Event("change")); const plot = document.getElementById("plot");
  return { axis: plot.layout.yaxis.title.text, words: \
document.getElementById("plot-words").textContent,
    drawn: plot.querySelectorAll(".scatterlayer .trace").length,
    tools: [...plot.querySelectorAll(".modebar-btn")].map((button) => button.dataset.title) }; \
})()"""


def press_box(page, name):
    page.ask(f"document.querySelector('input[name=\"{name}\"]').click()")


def test_switches_work_and_nothing_is_said_or_asked_for(page, report_folder):
    path = report_folder / "report.html"
    for domain in ("Log", "Network", "Runtime"):
        page.call(f"{domain}.enable")
    page.show(path)
    assert {"TLC median", "LQR 5 %", "reference"} <= set(page.ask(NAMES))
    press_box(page, "lqr")
    names = page.ask(NAMES)
    assert any(name.startswith("LQR retuned ") for name in names)
    assert not any(name.startswith("LQR ") and "retuned" not in name for name in names)
    for name in ("all", "wide", "narrow"):
        press_box(page, name)
    assert not any("%" in name or "largest" in name for name in page.ask(NAMES))
    state = page.ask(CHANNEL)
    assert state["axis"] == "Sideslip (deg)" and "Sideslip" in state["words"]
    assert state["drawn"] == 2  # the medians of the two that are left
    assert {"Zoom in", "Reset axes"} <= set(state["tools"])
    assert not any(
        word in title for title in state["tools"] for word in ("hare", "loud", "dit")
    )  # uploads the data
    page.wait_for("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
    assert [event for event in page.told if event[0] in SAID] == []
    urls = {
        params["request"]["url"]
        for method, params in page.told
        if method == "Network.requestWillBeSent"
    }
    assert {url for url in urls if not url.startswith("data:")} == {path.as_uri()}


def test_no_other_script_runs(page, report_page, tmp_path):
    foreign = (
        "<script>document.body.dataset.foreign = 1</script><img src=x "
        "onerror='document.body.dataset.foreign = 1'>"
    )
    path = tmp_path / "foreign.html"
    path.write_text(report_page.replace("</body>", foreign + "</body>"), "utf-8")
    page.show(path)
    assert page.ask("document.body.dataset.foreign") is None
    assert "Content Security Policy" in str(page.told)


FOCUS = """(() => { const e = document.activeElement; return [e.tagName, e.id || e.name || \
e.getAttribute("aria-label")
    || e.textContent.trim(), getComputedStyle(e).outlineStyle !== "none"]; })()"""
TABLES = """[...document.querySelectorAll("section .scroll:has(> table)")].map(
    (e) => e.getAttribute("aria-label"))"""
STOPS = 90  # presses of Tab on the page; 350 if every flight of a list were a stop


def tab_to(page, target):
    """Press Tab until an element has the focus; return the elements that had it on the way."""
    passed = []
    for _ in range(STOPS):
        page.press("Tab")
        passed.append(page.ask(FOCUS))
        if passed[-1][1] == target:
            return passed
    raise AssertionError(f"{target} was never reached: {passed}")


def test_it_is_read_with_the_keyboard(page, report_folder):
    page.show(report_folder / "report.html")
    page.press("Tab")
    assert page.ask(FOCUS)[0] == "A"  # skips to the report
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
    tables = set(page.ask(TABLES)) - {"Flights, the worst first"}
    assert tables & {name for _, name, _ in passed}  # a table that scrolls takes the focus
    before = page.ask("document.getElementById('plot-words').textContent")
    page.press("ArrowDown")
    assert page.ask("document.getElementById('plot-words').textContent") != before
    names = "document.getElementById('plot').data.map((trace) => trace.name).join()"
    assert "LQR median" in page.ask(names)
    tab_to(page, "lqr")
    page.press(" ")
    assert "LQR median" not in page.ask(names)
    tab_to(page, "Provenance")
