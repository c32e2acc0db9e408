"""Headless Chromium under its debugging protocol, with clicks, keys and printing."""

import asyncio
import contextlib
import json
import shutil
import subprocess
import time

import pytest

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
KEYS = {"Tab": (9, ""), "Enter": (13, "\r"), " ": (32, " "), "ArrowDown": (40, "")}


class Page:
    """Browser tab; each call waits for its reply and stores events that arrive meanwhile."""

    def __init__(self, loop, socket):
        self.loop, self.socket, self.number, self.told = loop, socket, 0, []

    def call(self, method, **parameters):
        return self.loop.run_until_complete(self._call(method, parameters))

    async def _call(self, method, parameters):
        self.number += 1
        await self.socket.write_message(
            json.dumps({"id": self.number, "method": method, "params": parameters})
        )
        while True:
            message = json.loads(await asyncio.wait_for(self.socket.read_message(), 180))
            if message.get("id") == self.number:
                return message["result"]
            self.told.append((message.get("method"), message.get("params")))

    def ask(self, expression, wait=False):
        """Return the value of an expression, or of its promise with ``wait``."""
        reply = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=wait
        )
        assert "exceptionDetails" not in reply, reply["exceptionDetails"]
        return reply["result"].get("value")

    def show(self, path, width=1400, height=900, dark=False):
        """Load a report and wait until it is drawn."""
        preferences = {
            "prefers-color-scheme": "dark" if dark else "light",
            "prefers-reduced-motion": "reduce",
        }
        self.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": k, "value": v} for k, v in preferences.items()],
        )
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.call("Page.navigate", url=path.as_uri())
        drawn = "document.querySelectorAll('#plot .modebar-btn').length > 0"
        self.wait_for(f"location.href === {json.dumps(path.as_uri())} && {drawn}")

    def wait_for(self, expression):
        """Wait until an expression is true."""
        for _ in range(600):
            if self.ask(expression):
                return
            time.sleep(0.1)
        raise AssertionError(f"{expression} never came true")

    def press(self, key):
        code, text = KEYS[key]
        common = {"key": key, "code": "Space" if key == " " else key, "windowsVirtualKeyCode": code}
        self.call(
            "Input.dispatchKeyEvent", type="keyDown" if text else "rawKeyDown", text=text, **common
        )
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def move(self, x, y):
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def click(self, x, y):
        self.move(x, y)
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def drag(self, x0, y0, x1, y1):
        for kind, x, y in (
            ("mousePressed", x0, y0),
            ("mouseMoved", x1, y1),
            ("mouseReleased", x1, y1),
        ):
            self.call(
                "Input.dispatchMouseEvent",
                type=kind,
                x=x,
                y=y,
                button="left",
                buttons=1,
                clickCount=1,
            )


@contextlib.contextmanager
def open_browser(profile):
    """Open a page in a new browser; skip the test without Chromium."""
    if BROWSER is None:
        pytest.skip("no Chromium is installed")
    client = pytest.importorskip(
        "tornado.websocket", reason="needs the extra 'cluster' or 'notebook'"
    )
    http = pytest.importorskip("tornado.httpclient")
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
        "--disable-dev-shm-usage",
        "--disable-background-networking", "--disable-sync", "--disable-component-update",
        f"--user-data-dir={profile}", "--remote-debugging-port=0", "about:blank",
    ]  # fmt: skip
    browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    async def connect():
        while True:
            try:
                port = (profile / "DevToolsActivePort").read_text("utf-8").split()[0]
                listed = await http.AsyncHTTPClient().fetch(f"http://127.0.0.1:{port}/json/list")
                (target,) = [entry for entry in json.loads(listed.body) if entry["type"] == "page"]
                return await client.websocket_connect(
                    target["webSocketDebuggerUrl"], max_message_size=100_000_000
                )
            except (OSError, ValueError, IndexError):
                await asyncio.sleep(0.1)

    async def closed(socket):
        while await socket.read_message() is not None:
            pass

    loop = asyncio.new_event_loop()
    try:
        page = Page(loop, loop.run_until_complete(asyncio.wait_for(connect(), 60)))
        page.call("Page.enable")
        yield page
        page.socket.close()
        loop.run_until_complete(asyncio.wait_for(closed(page.socket), 30))
    finally:
        loop.close()
        browser.terminate()
        browser.wait(30)
