"""The page with a keyboard alone, in a real browser: every key press goes through Chromium's own input."""

import asyncio
import json
import shutil
import subprocess
import time

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
client = pytest.importorskip("tornado.websocket", reason="needs the extra 'cluster' or 'notebook'")
http = pytest.importorskip("tornado.httpclient")

KEYS = {"Tab": (9, ""), "Enter": (13, "\r"), " ": (32, " "), "ArrowDown": (40, "")}
FOCUS = """(() => { const e = document.activeElement; return [e.tagName, e.id || e.name || e.getAttribute("aria-label")
    || e.textContent.trim(), getComputedStyle(e).outlineStyle !== "none"]; })()"""


class Page:
    """A page under the browser's debugging protocol."""

    def __init__(self, socket):
        self.socket, self.number = socket, 0

    async def call(self, method, **parameters):
        self.number += 1
        await self.socket.write_message(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            message = json.loads(await asyncio.wait_for(self.socket.read_message(), 30))
            if message.get("id") == self.number:
                return message["result"]

    async def ask(self, expression):
        found = await self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        return found["result"].get("value")

    async def press(self, key):
        code, text = KEYS[key]
        common = {"key": key, "code": "Space" if key == " " else key, "windowsVirtualKeyCode": code}
        await self.call("Input.dispatchKeyEvent", type="keyDown" if text else "rawKeyDown", text=text, **common)
        await self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    async def tab_to(self, wanted):
        """Press Tab until the element has the focus; everything that had it on the way."""
        passed = []
        for _ in range(500):
            await self.press("Tab")
            passed.append(await self.ask(FOCUS))
            if passed[-1][1] == wanted:
                return passed
        raise AssertionError(f"{wanted} was never reached: {passed}")


async def read_page(port, url):
    while True:
        try:
            listed = await http.AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}/json/list")
            (target,) = [entry for entry in json.loads(listed.body) if entry["type"] == "page"]
            break
        except (OSError, ValueError):
            await asyncio.sleep(0.1)
    page = Page(await client.websocket_connect(target["webSocketDebuggerUrl"], max_message_size=100_000_000))
    await page.call("Page.enable")
    await page.call("Page.navigate", url=url)
    for _ in range(300):
        if await page.ask("document.querySelectorAll('#plot .modebar-btn').length > 0"):
            return page
        await asyncio.sleep(0.1)
    raise AssertionError("the plot was not drawn")


async def walk(port, url):
    page = await read_page(port, url)
    try:
        await read_with_keys(page)
    finally:
        page.socket.close()
        await page.socket.read_message()  # until it is closed


async def read_with_keys(page):
    (skip,) = await page.tab_to("Skip to the report")
    assert skip[0] == "A"
    await page.press("Enter")
    assert (await page.ask(FOCUS))[:2] == ["MAIN", "main"]
    passed = await page.tab_to("channel")
    assert all(visible for _, _, visible in passed), "a focus that is not seen"
    assert "Requirements in full" in [name for _, name, _ in passed]  # a table that scrolls takes the focus
    before = await page.ask("document.getElementById('plot-words').textContent")
    await page.press("ArrowDown")
    assert await page.ask("document.getElementById('plot-words').textContent") != before
    names = "document.getElementById('plot').data.map((trace) => trace.name).join()"
    assert "LQR median" in await page.ask(names)
    await page.tab_to("lqr")
    await page.press(" ")
    assert "LQR median" not in await page.ask(names)
    await page.tab_to("Provenance")


def test_it_is_read_with_the_keyboard(report_folder, tmp_path):
    profile = tmp_path / "profile"
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage",
        "--disable-background-networking", "--disable-sync", "--disable-component-update",
        f"--user-data-dir={profile}", "--remote-debugging-port=0", "about:blank",
    ]  # fmt: skip
    browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        note = profile / "DevToolsActivePort"
        end = time.monotonic() + 60.0
        while not (note.is_file() and note.read_text(encoding="utf-8").strip()) and time.monotonic() < end:
            time.sleep(0.1)
        port = int(note.read_text(encoding="utf-8").split()[0])
        asyncio.run(asyncio.wait_for(walk(port, (report_folder / "report.html").as_uri()), 120))
    finally:
        browser.terminate()
        browser.wait(30)
